#!/usr/bin/env bash
# ezdxf 1.4.5, Python 3.11.
#
# A DXF file may consist of its ENTITIES section alone; small exporters write it so.  Such a file says nothing of its units.
# One would swear that ezdxf reports it as unitless, $INSUNITS = 0, as it does for a file whose HEADER section has no
# $INSUNITS.  It does not: where there is no HEADER section, ezdxf gives the document a header of its own, in which $INSUNITS is 6,
# metres.  A reader that believes document.units makes a line of 10 a path of 10 m.  ezdxf's own dxf_file_info, which looks at
# the file, says 0 for both.
#
# Seen:  without HEADER: document.units 6, dxf_file_info 0; HEADER without $INSUNITS: document.units 0, dxf_file_info 0
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q ezdxf==1.4.5
cd "$work"
entities='0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0\n20\n0\n11\n10\n21\n0\n0\nENDSEC\n0\nEOF\n'
printf "$entities" > bare.dxf
printf '0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n'"$entities" > header.dxf

cat > units.py <<'PY'
from ezdxf.filemanagement import dxf_file_info, readfile

seen = {name: (readfile(name).units, dxf_file_info(name).insert_units) for name in ("bare.dxf", "header.dxf")}
print(f"without HEADER: document.units {seen['bare.dxf'][0]}, dxf_file_info {seen['bare.dxf'][1]}")
print(f"HEADER without $INSUNITS: document.units {seen['header.dxf'][0]}, dxf_file_info {seen['header.dxf'][1]}")
assert seen == {"bare.dxf": (6, 0), "header.dxf": (0, 0)}, "changed"
PY
"$work/venv/bin/python" units.py

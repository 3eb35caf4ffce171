#!/usr/bin/env bash
# numpy 2.4.6, Python 3.11.
#
# import numpy leaves out what few programs need: numpy.ma, the masked arrays, loads when somebody asks for it.  One would
# swear that sorting a few plain numbers does not.  numpy.unique does: it asks whether its array is a masked one by means of
# numpy.ma, and so do union1d and isin, which call it.  A command that starts, plans and ends pays for the import (some
# 8 ms); a sort and a comparison of neighbours does the same without.
#
# Seen:  numpy.ma loaded: after import numpy False, after sort False, after unique True
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q numpy==2.4.6
cat > "$work/seen.py" <<'PY'
import sys

import numpy as np


def loaded() -> bool:
    return "numpy.ma" in sys.modules


numbers = np.array([2.0, 1.0, 2.0])
seen = [loaded()]
np.sort(numbers)
seen.append(loaded())
np.unique(numbers)
seen.append(loaded())
print("numpy.ma loaded: after import numpy {}, after sort {}, after unique {}".format(*seen))
assert seen == [False, False, True], "changed"
PY
"$work/venv/bin/python" "$work/seen.py"

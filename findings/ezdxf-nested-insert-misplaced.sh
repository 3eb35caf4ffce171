#!/usr/bin/env bash
# ezdxf 1.4.5, Python 3.11.
#
# A DXF drawing may insert a block into a block, turned and stretched by different factors along X and Y.  ezdxf takes such
# nests apart with recursive_decompose, and raises or falls back where a result cannot be expressed (an arc that becomes part
# of an ellipse).  One would swear that a plain LINE two levels down ends up where the matrices of the two INSERTs, which ezdxf
# itself gives (Insert.matrix44), take it.  It does not, where the inner block is turned and the outer one stretched unequally:
# the INSERT in between, which would have to be sheared, is made one without shear, and the line is longer and elsewhere.  Nothing
# is raised or logged.  Who cuts what recursive_decompose gives cuts another part.
#
# Seen:  by the matrices      (13.754, -0.535) to (36.619, 18.367)
#        recursive_decompose  (16.704, 2.485) to (44.213, 25.728)
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q ezdxf==1.4.5
cat > "$work/nested.py" <<'PY'
import ezdxf
from ezdxf.disassemble import recursive_decompose

drawing = ezdxf.new()
space = drawing.modelspace()
drawing.blocks.new("part").add_line((1, 2), (10, 3))
inner = drawing.blocks.new("group").add_blockref("part", (3, 4), {"xscale": 2, "yscale": 2, "zscale": 2, "rotation": 30})
outer = space.add_blockref("group", (7, -2), {"xscale": 2, "yscale": -0.5, "zscale": 1, "rotation": 50})

expected = [outer.matrix44().transform(inner.matrix44().transform(point)) for point in ((1, 2, 0), (10, 3, 0))]
(line,) = recursive_decompose(space)
found = [line.dxf.start, line.dxf.end]
for name, (start, end) in (("by the matrices", expected), ("recursive_decompose", found)):
    print(f"{name:20} ({start.x:.3f}, {start.y:.3f}) to ({end.x:.3f}, {end.y:.3f})")
assert [point.round(3).vec2 for point in found] == [ezdxf.math.Vec2(16.704, 2.485), ezdxf.math.Vec2(44.213, 25.728)], "changed"
assert [point.round(3).vec2 for point in expected] == [ezdxf.math.Vec2(13.754, -0.535), ezdxf.math.Vec2(36.619, 18.367)]
PY
"$work/venv/bin/python" "$work/nested.py"

#!/usr/bin/env bash
# matplotlib 3.11.2, Python 3.11.
#
# A figure is made inside rc_context({"ytick.labelsize": 6}) and drawn later, outside.  One would swear that what the axes
# look like was settled when they were made: their tick labels do keep size 6.  The number of ticks does not: how many fit is
# reckoned with the rcParams of the moment of drawing.  The same figure has five ticks or two, by the style of whoever
# draws it, and labels may run into each other or off the page in a notebook with a style of its own.
#
# What helps: tick_params(labelsize=6) on the axes; then the number no longer depends on the style.
#
# Seen: drawn with labelsize 4, 6, 16: ticks 5 3 2, labels of size 6 each time
#       with tick_params of its own:   ticks 3 3 3
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q matplotlib==3.11.2
cat > "$work/ticks.py" <<'PY'
import matplotlib as mpl
from matplotlib.figure import Figure


def ticks(drawn_with, own):
    with mpl.rc_context({"ytick.labelsize": 6}):
        figure = Figure(figsize=(2.0, 0.7))
        axes = figure.add_subplot()
        axes.set_ylim(0.0, 1.0)
        if own:
            axes.tick_params(labelsize=6)
    with mpl.rc_context({"ytick.labelsize": drawn_with}):
        figure.canvas.draw()
        assert axes.get_yticklabels()[0].get_size() == 6.0
        return len(axes.get_yticks())


for own in (False, True):
    print("own" if own else "style", *(ticks(size, own) for size in (4, 6, 16)))
PY
cd "$work"
MPLBACKEND=agg MPLCONFIGDIR="$work" "$work/venv/bin/python" ticks.py | tee seen
[ "$(sed -n 1p seen)" = "style 5 3 2" ] || { echo "changed: the number of ticks"; exit 1; }
[ "$(sed -n 2p seen)" = "own 3 3 3" ] || { echo "changed: ticks of axes with a label size of their own"; exit 1; }

"""What every figure shares: its style and width, how lines are thinned out, and how a file is written.

Figures are made and saved without pyplot, under a style of their own: neither a user's settings nor the time of day
changes them.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from planner.errors import InputError
from planner.files.whole_file import whole_file
from planner.inputs import require_instance, require_path
from planner.output.palette import INK
from planner.types import FloatArray

LINE_MM, CHARACTER_MM = 4.2, 1.5  # of a title of 8 points: from line to line, and a letter on average
DASHED = (0, (4, 2))
_MM_PER_INCH = 25.4
_PIXELS_PER_INCH = 200
_COLUMNS = 1200  # of a panel; each keeps the smallest and the largest value it covers
_STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "figure.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 0.9,
    "lines.solid_joinstyle": "round",
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "path",
    "svg.hashsalt": "feedplan",
}
# What says when a file was made, or by which version of what, would make every file another one.
_NO_DATES: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}


def save_plot(path: str | Path, figure: Figure) -> None:
    """Write a figure as PNG, PDF or SVG, whole or not at all; the same figure gives the same bytes.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.
    """
    suffix = figure_format(path)
    require_instance(figure, Figure, "figure")
    with whole_file(path) as file:
        _write(figure, file, suffix)


def svg_of(figure: Figure) -> bytes:
    """Return a figure as what ``save_plot`` writes into an .svg file."""
    file = io.BytesIO()
    _write(figure, file, ".svg")
    return file.getvalue()


def _write(figure: Figure, file: IO[bytes], suffix: str) -> None:
    with figure_style():
        figure.savefig(file, format=suffix[1:], dpi=_PIXELS_PER_INCH, metadata=_NO_DATES[suffix])


def figure_format(path: str | Path) -> str:
    """Return the suffix .png, .pdf or .svg of a file name; raise InputError for another one."""
    suffix = require_path(path).suffix.lower()
    if suffix not in _NO_DATES:
        raise InputError(f'{path}: the suffix "{suffix}" must be one of {", ".join(_NO_DATES)}')
    return suffix


def inches(millimetres: float) -> float:
    """What matplotlib measures figures in."""
    return millimetres / _MM_PER_INCH


@contextmanager
def figure_style() -> Iterator[None]:
    """The style of all figures, in place of the user's."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def place_panels(figure: Figure) -> None:
    """Lay a figure out, under its style and once for all: it then looks the same wherever it is drawn.

    Every later drawing would start from the layout before it, and end a little elsewhere; and how many numbers fit beside
    axes follows from the style at the time of drawing, unless the axes say how large they are.
    """
    for axes in figure.axes:
        axes.tick_params(labelsize=_STYLE["xtick.labelsize"])
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


def envelope(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thin out a line to the first, smallest, largest and last value of each column of the panel."""
    if x.size <= 4 * _COLUMNS:
        return x, y
    column = np.minimum(((x - x[0]) / (x[-1] - x[0]) * _COLUMNS).astype(np.intp), _COLUMNS - 1)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    last = np.append(first[1:], x.size) - 1
    order = np.lexsort((y, column))
    ends = np.stack([first, order[first], order[last], last])
    keep = np.unique(ends)
    return x[keep], y[keep]

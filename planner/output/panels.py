"""Figures made of panels of lines: what the benchmarks show of feeds, accelerations and errors.

The style, and how a figure is saved, are those of ``planner.output.figures``.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from planner.errors import InputError
from planner.output.figures import CHARACTER_MM, DASHED, LINE_MM, envelope, figure_style, inches, place_panels
from planner.output.palette import FAINT, INK, SERIES
from planner.output.panel_choice import NARROW_MM, PAGE_MM, require_width
from planner.types import FloatArray

_HEAD_MM, _ROW_MM = 10.0, 44.5
_ROOM = 1.12
_DECADE_ROOM = 1.4
_SHORT_LABEL = 6  # letters: three labels fit beside each other above a panel


@dataclass(frozen=True, eq=False)
class Line:
    """One curve of a panel: label, two (n,) arrays, x increasing, and its width in points."""

    label: str
    x: FloatArray
    y: FloatArray
    width: float = 0.7


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    title, x_label, y_label : str
        With units.
    lines : sequence of Line
    bounds : sequence of float
        Values of y at which a dashed line marks a limit.
    equal : bool
        Whether x and y have the same scale, as on a path.
    log : bool
        Whether y is drawn on a logarithmic scale; all its values are positive then.
    legend : {"best", "above", "none"}
        Where the labels of two or more lines stand: in the emptiest corner, or between title and axes.
    zero : bool
        Whether the y axis has 0 in it.
    """

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    bounds: Sequence[float] = field(default=())
    equal: bool = False
    log: bool = False
    legend: Literal["best", "above", "none"] = "best"
    zero: bool = True


def plot_panels(title: str, panels: Sequence[Panel], *, columns: int = 2, width_mm: float = PAGE_MM) -> Figure:
    """Draw panels row by row on one page.

    Parameters
    ----------
    title : str
    panels : sequence of Panel
        Those of one row with the same y label share their y axis, so that they can be compared.
    columns : int
        Panels in a row; in a figure below 130 mm they stand one under the other.
    width_mm : float
        80 to 420.

    Returns
    -------
    matplotlib.figure.Figure
        ``planner.output.figures.save_plot`` writes it.

    Raises
    ------
    InputError
        If there is no panel or no column, or the width is out of range.
    """
    if not panels or columns < 1:
        raise InputError(f"{len(panels)} panels in {columns} columns: both must be at least 1")
    width = require_width(width_mm)
    columns = 1 if width < NARROW_MM else columns
    rows = -(-len(panels) // columns)
    with figure_style():
        text = textwrap.fill(title, int(width / CHARACTER_MM))
        height = _HEAD_MM + LINE_MM * text.count("\n") + _ROW_MM * rows
        figure = Figure(figsize=(inches(width), inches(height)), layout="constrained")
        figure.suptitle(text, x=0.01, ha="left")
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            for line, colour in zip(panel.lines, SERIES * (1 + len(panel.lines) // len(SERIES)), strict=False):
                x, y = (line.x, line.y) if panel.equal else envelope(line.x, line.y)
                axes.plot(x, y, color=colour, lw=line.width, label=line.label)
            for bound in panel.bounds:
                axes.axhline(bound, color=INK, lw=0.6, ls=DASHED)
            if panel.equal:
                axes.set_aspect("equal", adjustable="datalim")
            elif panel.log:
                axes.set_yscale("log")
            elif _lowest(panel) < 0.0:
                axes.axhline(0.0, color=FAINT, lw=0.4)
            axes.set_xlabel(panel.x_label)
            axes.set_ylabel(panel.y_label)
            if panel.legend == "above":
                place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
                ncols = 3 if max(len(line.label) for line in panel.lines) <= _SHORT_LABEL else 2
                axes.legend(title=panel.title, alignment="left", ncols=ncols, columnspacing=1.2, **place)
                continue
            axes.set_title(panel.title, loc="left")
            if len(panel.lines) > 1 and panel.legend == "best":
                axes.legend(loc="best")
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_axis_off()
        for row in range(rows):
            _share_heights(grid[row], panels[row * columns : (row + 1) * columns])
        place_panels(figure)
    return figure


def _lowest(panel: Panel) -> float:
    return min((float(np.min(line.y)) for line in panel.lines), default=0.0)


def _share_heights(row: Sequence[object], panels: Sequence[Panel]) -> None:
    """Give panels of a row that show the same quantity the same y axis."""
    for label in {panel.y_label for panel in panels if not panel.equal}:
        alike = [i for i, panel in enumerate(panels) if panel.y_label == label and not panel.equal]
        low, high = np.inf, -np.inf
        for i in alike:
            values = [float(v) for line in panels[i].lines for v in (np.min(line.y), np.max(line.y))]
            low, high = min([low, *values, *panels[i].bounds]), max([high, *values, *panels[i].bounds])
        if low < high:
            for i in alike:
                if panels[i].log:
                    row[i].set_ylim(low / _DECADE_ROOM, high * _DECADE_ROOM)  # type: ignore[attr-defined]
                    continue
                if not panels[i].zero:
                    room = (_ROOM - 1.0) * (high - low)
                    row[i].set_ylim(low - room, high + room)  # type: ignore[attr-defined]
                    continue
                row[i].set_ylim(_ROOM * low if low < 0.0 else 0.0, _ROOM * high)  # type: ignore[attr-defined]

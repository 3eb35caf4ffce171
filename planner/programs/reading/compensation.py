"""Cutter compensation, G41 and G42: the path of the tool beside the programmed one, as LinuxCNC makes it.

With r the radius of the tool and n the unit normal of a move on the tool's side, the tool goes from start + r n to
end + r n: along a line, or along an arc of the same centre whose radius is r larger or smaller.  Between two moves, with the
angle by which the path turns away from the tool:

1. beyond 0.05 rad, an outside corner: an arc of radius r about the programmed corner; of a rapid a line, since there
   are no rapid arcs;
2. within 0.05 rad, none: the tool goes on from where it is;
3. below -0.05 rad, an inside corner: the first move is cut where the path of the second crosses it.

The first move, the entry, leads from where the machine stands to end + r n; after the last one the machine goes on from
there to programmed points, but a tool change before that makes where the tool is the programmed point.  So a move is known
when the next one is: it waits, and with it those along the normal of the plane, which belong to the same corner.  An inside
corner that cuts more from a move than there is of it is refused.

Limitation: only moves that follow each other are looked at; a slot narrower than the tool is not seen, and an entry, or a
line before a corner that needs no cut, may come to lead back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.programs.reading.program import ARC, LINE, RAPID, SPLINE
from planner.programs.reading.tool_guide import GougeError, ToolGuide
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

# By orientation of a lathe tool, where its control point lies from the centre of its nose: along Z and X, in radii.
_CONTROL_POINTS = {1: 1 - 1j, 2: -1 - 1j, 3: -1 + 1j, 4: 1 + 1j, 5: 1 + 0j, 6: -1j, 7: -1 + 0j, 8: 1j}
LATHE_ORIENTATIONS = tuple(_CONTROL_POINTS)


@dataclass(frozen=True)
class CompensatedTool:
    """The tool of a G41 or G42: its radius in mm, > 0 to the left of the path, and of a lathe tool the orientation."""

    radius: float
    orientation: int = 0


@dataclass(frozen=True, eq=False)
class ProgrammedPath:
    """Programmed moves, columns as in Program, and of each the number of its tool, from 1; 0 without compensation."""

    source: str
    line: LineArray
    kind: NDArray[np.uint8]
    start: FloatArray
    end: FloatArray
    centre: FloatArray
    normal: NDArray[np.uint8]
    sweep: FloatArray
    tool: LineArray


@dataclass(frozen=True, eq=False)
class ToolPath:
    """The moves of the tool: of each the index of the programmed one that it belongs to, and columns as in Program."""

    row: LineArray
    kind: NDArray[np.uint8]
    end: FloatArray
    centre: FloatArray
    sweep: FloatArray


def compensate(path: ProgrammedPath, tools: Sequence[CompensatedTool]) -> ToolPath:
    """Lead the tools beside the path; moves without one, or with one of radius 0, stay as they are.

    Raises
    ------
    InputError
        ``file:line: word: reason`` where a tool would cut into what it shall leave.
    """
    radius = np.array([0.0, *(tool.radius for tool in tools)])[path.tool]
    apart = np.flatnonzero((np.diff(path.tool) != 0) & ((radius[1:] != 0.0) | (radius[:-1] != 0.0))) + 1
    parts: list[ToolPath] = []
    for rows in np.split(np.arange(path.line.size), apart):
        if parts and radius[rows[0] - 1] != 0.0 and path.kind[rows[0]] >= ARC:
            what = "arc" if path.kind[rows[0]] == ARC else "spline"
            reason = f"the move after G40 must be straight; write G0 or G1 before the {what}"
            raise _refusal(path, int(rows[0]), reason)
        if radius[rows[:1]].any():
            parts.append(_beside(path, rows, tools[int(path.tool[rows[0]]) - 1]))
        else:
            parts.append(ToolPath(rows, path.kind[rows], path.end[rows], path.centre[rows], path.sweep[rows]))
    return ToolPath(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(ToolPath)))


def end_beside(tool: CompensatedTool, start: complex, end: complex, centre: complex, *, sweep: float) -> complex:
    """From the programmed end of a move to that of the tool where nothing follows, in the plane, mm; a line has no sweep."""
    along = end - start if sweep == 0.0 else 1j * np.copysign(1.0, sweep) * (end - centre)
    return tool.radius * 1j * along / abs(along) + abs(tool.radius) * _CONTROL_POINTS.get(tool.orientation, 0j)


def _refusal(path: ProgrammedPath, row: int, reason: str) -> InputError:
    kind, clockwise = int(path.kind[row]), path.sweep[row] < 0.0
    name = {RAPID: "G0", LINE: "G1", SPLINE: "spline"}.get(kind, "G2" if clockwise else "G3")
    return InputError(f"{path.source}:{path.line[row]}: {name}: {reason}")


def _beside(path: ProgrammedPath, rows: LineArray, tool: CompensatedTool) -> ToolPath:
    """The moves from a G41 or G42 to where it ends, all in one plane."""
    normal = int(path.normal[rows[0]])
    first, second = (normal + 1) % 3, (normal + 2) % 3

    def in_plane(points: FloatArray) -> list[complex]:
        return (points[rows, first] + 1j * points[rows, second]).tolist()

    guide = ToolGuide(tool.radius, complex(path.start[rows[0], first], path.start[rows[0], second]))
    columns = (
        rows.tolist(),
        path.kind[rows].tolist(),
        in_plane(path.end),
        in_plane(path.centre),
        path.sweep[rows].tolist(),
    )
    try:
        for row, kind, end, centre, sweep in zip(*columns, strict=True):
            if kind == ARC:
                if row == rows[0] and tool.orientation in LATHE_ORIENTATIONS:
                    raise GougeError(row, "the first move beside which a lathe tool goes must be straight: G0 or G1")
                guide.arc(row, end, centre, sweep)
            else:
                guide.line(row, kind, end)
        moves = guide.finish()
    except GougeError as problem:
        raise _refusal(path, problem.row, problem.reason) from None
    row = np.array([move.row for move in moves])
    kind = np.array([move.kind for move in moves], dtype=np.uint8)
    shift = abs(tool.radius) * _CONTROL_POINTS.get(tool.orientation, 0j)
    points, middles = np.array([(move.end, move.centre) for move in moves]).T + shift
    out, about = path.end[row], np.full((row.size, path.centre.shape[1]), np.nan)
    out[:, first], out[:, second] = points.real, points.imag
    corner = ~np.array([move.level for move in moves])
    out[corner, normal] = path.start[row[corner], normal]
    arcs = kind == ARC
    about[arcs, first], about[arcs, second] = middles.real[arcs], middles.imag[arcs]
    about[arcs, normal] = path.start[row[arcs], normal]
    return ToolPath(row, kind, out, about, np.array([move.sweep for move in moves]))

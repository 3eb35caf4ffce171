"""NURBS of several blocks: their control points, weights and knots.

    G5.2 X Y P L ... G5.3   of order L (3): where the machine stands, with weight 1 (or P of a first block without X Y), then
                            a control point a block with its weight P; knots clamped and evenly spaced; ends with G5.3
    G6.2 P K X Y Z R ...    of order P (4): a control point a block with its knot K and weight R (1), the first where the
                            machine stands, then a block with K alone for every further knot, which ends it

The former is LinuxCNC's, under G91 with control points that count from the start; the latter is Fanuc's.
"""

from __future__ import annotations

import numpy as np

from planner.programs.reading.language import DISTANCE, FEED_MODE, MOTION, NURBS_BEGIN, NURBS_END, NURBS_KNOTS
from planner.programs.reading.modal import OpenNurbs
from planner.programs.reading.positions import NurbsMove, ProgramTrack, block_numbers
from planner.types import FloatArray

_MAX_ORDER = 10  # a bound on the work; posts write 3 and 4
_MIN_ORDER = {NURBS_BEGIN: 3, NURBS_KNOTS: 2}
_START_MM = 0.002  # the first control point of G6.2, from where the machine stands: digits


def run_nurbs(track: ProgramTrack, row: int) -> None:
    """Take a block of a NURBS: a control point, a knot, or its end."""
    state, blocks = track.state, track.blocks
    code = int(track.modal[MOTION][row])
    track.points[row + 1] = state.programmed[: state.carried]
    if track.modal[FEED_MODE][row] != 940:
        _refuse(track, row, "a NURBS needs a feed in units a minute, G94")
    elif code == NURBS_END:
        _end(track, row)
    elif state.nurbs is None and not blocks.g[MOTION].given[row]:
        _refuse(track, row, "the spline before it is complete; begin another with its G word")
    elif code == NURBS_BEGIN:
        _add_point(track, row)
    else:
        _add_knot(track, row)


def require_closed(track: ProgramTrack, row: int) -> None:
    """Refuse a block of another kind within a NURBS."""
    state, begun = track.state, track.state.nurbs
    if begun is None:
        return
    state.nurbs = None
    if begun.code == NURBS_BEGIN:
        _refuse(track, row, f"stands within the spline that begins in line {begun.line}; end it with G5.3")
    else:
        _refuse(track, row, _knots_missing(begun))


def _knots_missing(begun: OpenNurbs) -> str:
    needed = len(begun.points) + begun.order
    return (
        f"the spline that begins in line {begun.line} has {len(begun.knots)} knots; {len(begun.points)} control points "
        f"of order {begun.order} need {needed}, the last {begun.order} in blocks with K alone"
    )


def _refuse(track: ProgramTrack, row: int, reason: str, letters: str = "") -> None:
    """Refuse a block at the first of the letters in it, or at its motion word, or at its first word."""
    blocks = track.blocks
    word = blocks.first[row]
    if blocks.g[MOTION].given[row]:
        word = blocks.g[MOTION].word[row]
    named = [blocks.letters[name] for name in letters if blocks.letters[name].given[row]]
    blocks.faults.add(np.array([named[0].word[row] if named else word]), reason)


def _begun(track: ProgramTrack, row: int, code: int, letter: str, default: int) -> OpenNurbs:
    """The NURBS that this block goes on with, or begins."""
    state = track.state
    if state.nurbs is None:
        state.nurbs = OpenNurbs(code, int(track.blocks.line[row]), default, state.programmed[:3].copy())
    begun = state.nurbs
    given = track.blocks.number(row, letter)
    if given is not None and (code == NURBS_BEGIN or not begun.points):
        least = _MIN_ORDER[code]
        if given != int(given) or not least <= given <= _MAX_ORDER:
            _refuse(track, row, f"the order of a spline is a whole number from {least} to {_MAX_ORDER}", letter)
        else:
            begun.order = int(given)
    return begun


def _place(track: ProgramTrack, row: int, begun: OpenNurbs) -> FloatArray | None:
    """The control point in a block, on the machine, mm; None where it names no axis."""
    state = track.state
    numbers = block_numbers(track.blocks, row, float(track.unit[row]))[:3]
    if all(number is None for number in numbers):
        return None
    relative = track.modal[DISTANCE][row] != 900
    at = begun.points[-1].copy() if begun.points and not relative else begun.start.copy()
    for axis, number in enumerate(numbers):
        if number is None:
            continue
        if not state.axis_lines[axis]:
            state.axis_lines[axis] = track.blocks.line[row]
        at[axis] = number + (begun.start[axis] if relative else state.offsets.total[axis])
    return at


def _add_point(track: ProgramTrack, row: int) -> None:
    """G5.2: a control point and its weight."""
    blocks = track.blocks
    begun = _begun(track, row, NURBS_BEGIN, "L", 3)
    x, y = (blocks.letters[name].given[row] for name in "XY")
    weight = blocks.number(row, "P")
    line = int(blocks.line[row])
    if not begun.points:
        alone = not x and not y
        begun.points.append(begun.start.copy())
        begun.weights.append(weight if alone and weight is not None else 1.0)
        begun.lines.append(line)
        if alone:
            if weight is not None and weight <= 0.0:
                _refuse(track, row, "a weight must be > 0", "P")
            return
    point = _place(track, row, begun)
    if point is None or not x or not y:
        _refuse(track, row, "a control point needs X and Y", "XYPL")
    elif weight is None or weight <= 0.0:
        _refuse(track, row, "a control point needs its weight P > 0", "P" if weight is not None else "X")
    else:
        begun.points.append(point)
        begun.weights.append(weight)
        begun.lines.append(line)


def _end(track: ProgramTrack, row: int) -> None:
    """G5.3: the NURBS of G5.2 is complete."""
    begun = track.state.nurbs
    if begun is None:
        _refuse(track, row, "ends a spline that no G5.2 begins")
        return
    track.state.nurbs = None
    if track.blocks.any_of("XYZPL")[row]:
        _refuse(track, row, "the block of G5.3 has no control point; write it before", "XYZPL")
        return
    count, order = len(begun.points), begun.order
    if count < order:
        _refuse(track, row, f"a spline of order {order} needs {order} control points; it has {count}")
        return
    inner = np.arange(1.0, count - order + 1)
    begun.knots = [*np.zeros(order), *inner, *np.full(order, count - order + 1.0)]
    _complete(track, row, begun)


def _add_knot(track: ProgramTrack, row: int) -> None:
    """G6.2: a knot, with a control point and its weight, or alone."""
    begun = _begun(track, row, NURBS_KNOTS, "P", 4)
    point = _place(track, row, begun)
    if point is None and not begun.points:
        point = begun.start.copy()
    knot, weight = (track.blocks.number(row, letter) for letter in "KR")
    refused = _knot_refused(track, row, begun, point)
    if refused:
        _refuse(track, row, *refused)
        return
    if point is not None:
        begun.points.append(point if begun.points else begun.start.copy())
        begun.weights.append(1.0 if weight is None else weight)
        begun.lines.append(int(track.blocks.line[row]))
    begun.knots.append(knot or 0.0)
    if len(begun.knots) == len(begun.points) + begun.order:
        track.state.nurbs = None
        if _knots_fit(track, row, begun):
            _complete(track, row, begun)


def _knot_refused(
    track: ProgramTrack, row: int, begun: OpenNurbs, point: FloatArray | None
) -> tuple[str, str] | tuple[()]:
    """What is wrong with a block of G6.2, and with which of its letters; nothing if it is right."""
    blocks = track.blocks
    knot, weight = blocks.number(row, "K"), blocks.number(row, "R")
    away = 0.0 if point is None else float(np.sqrt(np.sum((point - begun.start) ** 2)))
    rules = (
        (
            blocks.letters["P"].given[row] and bool(begun.points),
            "the order P belongs to the first block of a spline",
            "P",
        ),
        (track.modal[DISTANCE][row] != 900, "control points of G6.2 are absolute; write G90", ""),
        (knot is None, "a block of G6.2 needs its knot K", "XYZR"),
        (
            knot is not None and bool(begun.knots) and knot < begun.knots[-1],
            "the knot is less than the one before; knots must not decrease",
            "K",
        ),
        (weight is not None and weight <= 0.0, "a weight must be > 0", "R"),
        (
            weight is not None and point is None,
            "a weight belongs to a control point; X, Y or Z is missing",
            "R",
        ),
        (
            not begun.points and away > _START_MM,
            f"the first control point lies {away:.6g} mm from where the machine stands; a spline begins there",
            "XYZ",
        ),
        (
            point is not None and len(begun.knots) > len(begun.points),
            "a control point after a block with K alone; these come last",
            "XYZ",
        ),
    )
    return next(((reason, letters) for wrong, reason, letters in rules if wrong), ())


def _knots_fit(track: ProgramTrack, row: int, begun: OpenNurbs) -> bool:
    """Whether the knots are those of a spline from its first control point to its last; else refuse."""
    knots, order, count = np.array(begun.knots), begun.order, len(begun.points)
    if count < order:
        _refuse(track, row, f"a spline of order {order} needs {order} control points; it has {count}")
        return False
    inner, times = np.unique(knots, return_counts=True)
    over = (times > order - 1) & (inner > knots[0]) & (inner < knots[-1])
    reason = ""
    if inner.size == 1:
        reason = f"all knots are equal; the first {order} and the last {order} must differ"
    elif knots[0] != knots[order - 1] or knots[-order] != knots[-1]:
        reason = (
            f"the first {order} knots must be equal, and the last {order}: the spline begins and ends in control points"
        )
    elif over.any():
        at, often = float(inner[np.argmax(over)]), int(times[np.argmax(over)])
        reason = f"the knot {at:g} appears {often} times; inside a spline of order {order} it may {order - 1} times"
    if reason:
        _refuse(track, row, reason, "K")
    return not reason


def _complete(track: ProgramTrack, row: int, begun: OpenNurbs) -> None:
    """Note the move of a NURBS."""
    state, control = track.state, np.array(begun.points)
    state.programmed[:3] = control[-1]
    shape = np.array(begun.weights), np.array(begun.knots), begun.order - 1
    track.nurbs.append(NurbsMove(row, begun.lines, control, *shape, state.programmed.copy()))
    track.points[row + 1] = state.programmed[: state.carried]

"""Threads as the moves that LinuxCNC makes of them: the cycle G76, and tapping with a reversed spindle, G33.1.

G76 starts on the drive line, at the X and Z where the machine stands, and cuts to the crest, I away from it, and from there
to the depth K, by the passes

    depth_n = |I| + J n^(1/R),  n = 1, 2, ...  as long as less than |I| + K,

then 1 + H passes at that depth.  Q is the angle along which the passes go down; at the ends where L asks for it, 1 the
begin and 2 the end, the tool goes in or out over a length E in Z.  Each pass goes by rapid back over the drive line.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from planner.programs.reading.language import DIAMETER, DISTANCE, MOTION, TAP, THREADING
from planner.programs.reading.positions import ProgramTrack, SideMove, block_numbers
from planner.programs.reading.program import LINE, RAPID
from planner.types import FloatArray

_MAX_PASSES = 100_000


def _end(track: ProgramTrack, row: int) -> FloatArray:
    """Where the words of the block lead."""
    state = track.state
    end = state.programmed.copy()
    relative = track.modal[DISTANCE][row] != 900
    for axis, number in enumerate(block_numbers(track.blocks, row, float(track.unit[row]))):
        if number is not None:
            if state.axis_lines[axis] == 0:
                state.axis_lines[axis] = track.blocks.line[row]
            end[axis] = end[axis] + number if relative else number + state.offsets.total[axis]
    return end


def _tap(track: ProgramTrack, row: int) -> None:
    """G33.1: down with the pitch K, and back, I times as fast."""
    start, end = track.state.programmed.copy(), _end(track, row)
    pitch = abs(track.blocks.number(row, "K") or 0.0) * float(track.unit[row])
    back = max(track.blocks.number(row, "I") or 1.0, 1.0)
    track.side += [SideMove(row, LINE, end, pitch=pitch), SideMove(row, LINE, start, pitch=back * pitch)]
    track.points[row + 1] = start[: track.points.shape[1]]


@dataclass(frozen=True)
class _Thread:
    """What the words of a G76 say, mm; ``side`` is 1 where X grows towards the thread, and -1 where it falls."""

    start: FloatArray
    end: FloatArray
    side: float
    crest: float
    first_cut: float
    height: float
    pitch: float
    degression: float
    slope: float
    spring_passes: int
    taper: float
    tapers: int


def _read_thread(track: ProgramTrack, row: int) -> _Thread | None:
    """The words of a G76; None where something is refused."""
    unit = float(track.unit[row])
    numbers = {name: track.blocks.number(row, name) for name in "IJKPQRHEL"}
    scale = unit * (0.5 if track.modal[DIAMETER][row] == 70 else 1.0)
    i, j, k, pitch = (numbers[name] or 0.0 for name in "IJKP")
    lacking = [name for name in "PIJK" if numbers[name] is None]
    reason = ""
    if lacking:
        reason = f"needs {' and '.join(lacking)} beside it"
    elif i == 0.0:
        reason = "the way I from the drive line to the crest must not be 0"
    elif pitch <= 0.0:
        reason = "the pitch P must be > 0"
    elif j <= 0.0 or k <= j:
        reason = "the first depth J must be > 0, and the full depth K larger"
    degression = max(numbers["R"] or 1.0, 1.0)
    if not reason and degression * math.log(k / j) > math.log(_MAX_PASSES):
        reason = f"makes more than {_MAX_PASSES} passes; look at J, K and R"
    if reason:
        word = track.blocks.g[MOTION]
        index = word.word[row] if word.given[row] else track.blocks.first[row]
        track.blocks.faults.add(index.reshape(1), reason)
        return None
    start, end = track.state.programmed.copy(), _end(track, row)
    upwards = -1.0 if end[2] > start[2] else 1.0
    slope = upwards * math.tan(math.radians(numbers["Q"] or 0.0))
    taper = upwards * max(numbers["E"] or 0.0, 0.0) * unit
    return _Thread(
        start, end, math.copysign(1.0, i), abs(i) * scale, j * scale, k * scale, pitch * unit, degression, slope,
        int(numbers["H"] or 0), taper, int(numbers["L"] or 0) if taper else 0,
    )  # fmt: skip


def _cut_thread(track: ProgramTrack, row: int) -> None:
    """G76."""
    thread = _read_thread(track, row)
    track.points[row + 1] = track.state.programmed[: track.points.shape[1]]
    if thread is None:
        return
    bottom = thread.crest + thread.height
    depth, count = thread.crest + thread.first_cut, 1
    while depth < bottom:
        _pass(track, row, thread, depth)
        count += 1
        depth = thread.crest + thread.first_cut * count ** (1.0 / thread.degression)
    for _ in range(1 + thread.spring_passes):
        _pass(track, row, thread, bottom)
    track.side.append(SideMove(row, RAPID, thread.end))
    track.state.programmed = thread.end.copy()
    track.points[row + 1] = thread.end[: track.points.shape[1]]


def _pass(track: ProgramTrack, row: int, thread: _Thread, depth: float) -> None:
    """One pass at a depth from the drive line."""
    shift = (depth - thread.crest) * thread.slope
    begin = thread.start[2] - shift
    stop = thread.end[2] + thread.height * thread.slope - shift
    back = depth - thread.crest - thread.height
    rise = thread.pitch * math.hypot(thread.taper, thread.height) / abs(thread.taper) if thread.taper else thread.pitch

    def go(away: float, z: float, pitch: float | None = None) -> None:
        at = thread.start.copy()
        at[0], at[2] = at[0] + thread.side * away, z
        kind = RAPID if pitch is None else LINE
        track.side.append(SideMove(row, kind, at, pitch=math.nan if pitch is None else pitch))

    go(back, begin)
    if thread.tapers & 1:
        go(depth - thread.height, begin, rise)
        go(depth, begin - thread.taper, rise)
    else:
        go(depth, begin)
    if thread.tapers & 2:
        go(depth, stop + thread.taper, thread.pitch)
        go(depth - thread.height, stop, rise)
    else:
        go(depth, stop, thread.pitch)
    go(back, stop)


THREADS: dict[int, Callable[[ProgramTrack, int], None]] = {TAP: _tap, THREADING: _cut_thread}

"""How long every line of a part program takes, when it begins, and what holds it back.

The time of a line is the time law of the plan between the curve parameters at which its block begins and ends, so the
lines add up to the duration.  What happens while the machine rests is not in the plan: dwells, with their seconds, and
tool changes, whose time no program says, are columns of their own, and count in when a line begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.frames import Tabular
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import require_instance
from planner.machine.program_setup import NO_RESTS, RestTimes
from planner.profile import FeedrateProfile
from planner.programs.path.smooth_path import ProgramPath
from planner.programs.reading.program import ARC, LINE, RAPID, SPLINE, Program
from planner.programs.reading.words import LineArray
from planner.programs.schedule import Schedule
from planner.types import FloatArray

KINDS = ("none", "rapid", "line", "arc", "spline")
_KIND_OF_MOVE = np.zeros(4, dtype=np.int8)
_KIND_OF_MOVE[[RAPID, LINE, ARC, SPLINE]] = 1, 2, 3, 4
_MINUTE = 60.0  # s
_LINEAR = 3  # X Y Z are always shown
# Newton's steps to a time within an interval; next to a rest, where u goes with the cube of time, each leaves 2/3.
_MAX_STEPS = 100
_ROUNDING = 4.0 * np.finfo(np.float64).eps


@dataclass(frozen=True, eq=False, repr=False)
class LineTimes(Tabular):
    """The time of every line that moves, or would but for its length, or dwells, or changes the tool; read-only arrays.

    Attributes
    ----------
    line : (m,) int64 array
        Line number in the file, from 1; strictly increasing.
    kind : (m,) int8 array
        Index into ``KINDS``: none, rapid, line, arc, spline; of several moves that of the longest.
    length : (m,) array
        Programmed path length, mm; of all its moves together, as the times are.
    u_start, u_end : (m,) arrays
        Curve parameters between which the plan runs the line, from its first move to its last; equal where it does not
        move.
    seconds : (m,) array
        Time of the motion, s; they add up to the duration of the plan.
    binding : (m,) int8 array
        Index into ``limit_names`` of the limit that holds the line back for the largest share of its time; 0 where none
        does at any time.
    share : (m,) array
        That share, 0 to 1.
    dwell : (m,) array
        Seconds of G4.
    tool_changes : (m,) int64 array
        Number of tool changes.
    rest : (m,) array
        Seconds for which the axes stand on it: dwells, and tool changes and spindle starts where their time is known.
    limit_names : tuple of str
        As in the profile; "none" first.
    start : (m,) array
        When the line begins, s from the start of the run; of one that is run again the first time.
    end : (m, 9) array
        Where it ends, in the axes of :data:`~planner.geometry.curve.AXES`, mm and degrees, on the machine.
    feed : (m,) array
        Programmed feed, mm/s or degrees/s; inf on rapids, nan where it does not move.
    highest_feed : (m,) array
        Largest feed of the tool tip that the plan has on it, mm/s; nan where that was not looked for.
    """

    line: NDArray[np.int64]
    kind: NDArray[np.int8]
    length: FloatArray
    u_start: FloatArray
    u_end: FloatArray
    seconds: FloatArray
    binding: NDArray[np.int8]
    share: FloatArray
    dwell: FloatArray
    tool_changes: NDArray[np.int64]
    rest: FloatArray
    limit_names: tuple[str, ...]
    start: FloatArray
    end: FloatArray
    feed: FloatArray
    highest_feed: FloatArray

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of the file that :func:`write_line_times` writes, but its text; kinds and limits as words.

        Feeds are in mm/min here; 0 where there is none.
        """
        return {
            "line": self.line,
            "kind": np.array(KINDS, dtype=object)[self.kind],
            "start_s": self.start,
            "seconds": self.seconds,
            "length_mm": self.length,
            **{f"{axis.lower()}_{unit}": self.end[:, k] for k, axis, unit in _axes_of(self.end)},
            "feed_mm_min": np.where(np.isfinite(self.feed), _MINUTE * self.feed, 0.0),
            "mean_feed_mm_min": _MINUTE * self.mean_feed,
            **({} if np.isnan(self.highest_feed).any() else {"highest_feed_mm_min": _MINUTE * self.highest_feed}),
            "held_back_by": np.array(self.limit_names, dtype=object)[self.binding],
            "share": self.share,
            "dwell_s": self.dwell,
            "tool_changes": self.tool_changes,
            "rest_s": self.rest,
            "u_start": self.u_start,
            "u_end": self.u_end,
        }

    def __repr__(self) -> str:
        parts = [f"{self.line.size} lines", f"{self.moving:.6g} s of motion"]
        parts += [f"{self.dwelling:.6g} s of dwells"] if self.dwelling else []
        parts += [f"{self.changes} tool changes"] if self.changes else []
        return f"LineTimes({', '.join(parts)})"

    @property
    def mean_feed(self) -> FloatArray:
        """Programmed length over time, mm/s or degrees/s; 0 where the line does not move."""
        return np.divide(self.length, self.seconds, out=np.zeros(self.seconds.size), where=self.seconds > 0.0)

    @property
    def moving(self) -> float:
        """Time of all motion, s."""
        return math.fsum(self.seconds)

    @property
    def total(self) -> float:
        """Time of the run, s: motion, dwells, and what is known of tool changes and spindle starts."""
        return math.fsum([*self.seconds, *self.rest])

    @property
    def dwelling(self) -> float:
        """Time of all dwells, s."""
        return math.fsum(self.dwell)

    @property
    def changes(self) -> int:
        """Number of tool changes."""
        return int(self.tool_changes.sum())


def _axes_of(end: FloatArray) -> list[tuple[int, str, str]]:
    """Place, name and unit of the axes that are shown: X Y Z, and the others that leave 0."""
    return [
        (k, axis, "deg" if axis in ROTARY_AXES else "mm")
        for k, axis in enumerate(AXES)
        if k < _LINEAR or bool(end[:, k].any())
    ]


def line_times(program: Program, path: ProgramPath, profile: FeedrateProfile, rests: RestTimes = NO_RESTS) -> LineTimes:
    """Share the time of a plan out among the lines of its program.

    Parameters
    ----------
    program : Program
    path : ProgramPath
        The path of that program.
    profile : FeedrateProfile
        A plan for the curve of that path.
    rests : RestTimes
        Seconds of tool changes and spindle starts, for when a line begins; left out, they take no time.

    Returns
    -------
    LineTimes

    Raises
    ------
    InputError
        If the plan is for another curve.
    """
    require_instance(program, Program, "program")
    require_instance(path, ProgramPath, "path")
    require_instance(profile, FeedrateProfile, "profile")
    if profile.curve is not path.curve and profile.curve.fingerprint != path.curve.fingerprint:
        raise InputError(f"the plan is for the curve {profile.curve.name}, not for the path of {program.source}")
    edges = move_edges(path, profile)
    run = Schedule.of(program, np.diff(edges), rests)
    limit = (*largest_share(profile, edges), profile.limit_names)
    return combined(program, run, path.u, limit, highest_feed=_highest_feed(profile, edges))


def move_edges(path: ProgramPath, profile: FeedrateProfile) -> FloatArray:
    """Times at which the moves with a length begin and end, (m + 1,), s; not decreasing, from 0 to the duration."""
    edges = times_at(profile, path.u)
    edges[0], edges[-1] = 0.0, profile.duration
    return np.maximum.accumulate(edges)


def _highest_feed(profile: FeedrateProfile, edges: FloatArray) -> FloatArray:
    """The largest feed at the ends of moves and at the nodes in them, mm/s."""
    at = profile.at(np.minimum(edges, profile.duration)).feed
    highest = np.maximum(at[1:], at[:-1])
    row = np.clip(np.searchsorted(edges, profile.t, side="right") - 1, 0, highest.size - 1)
    np.maximum.at(highest, row, profile.feed)
    return highest


def combined(
    program: Program,
    run: Schedule,
    u: FloatArray,
    binding: tuple[NDArray[np.int8], FloatArray, tuple[str, ...]],
    *,
    highest_feed: FloatArray | None = None,
) -> LineTimes:
    """Put the lines that move together with those that do not.

    Parameters
    ----------
    program : Program
    run : Schedule
        Of its moves with a length, m of them; a line may have several.
    u : (m + 1,) array
        Curve parameters at which these begin and end.
    binding : tuple
        The limit that holds each back for longest (m,), for how long, s, (m,), and the names of the limits.  Of a line with
        several moves it is that of the longest of them.
    highest_feed : (m,) array, optional
        Largest feed on each, mm/s.
    """
    limit, held, names = binding
    moving, seconds = program.line[run.row], run.seconds
    rests = [rest for rest in run.rests if rest.seconds or rest.kind != "spindle"]
    resting = np.array([rest.line for rest in rests], dtype=np.int64)
    line = np.unique(np.concatenate([moving, program.zero_lines, resting]))
    columns: dict[str, FloatArray] = {
        name: np.zeros(line.size) for name in ("length", "seconds", "share", "dwell", "rest")
    }
    kind, named = (np.zeros(line.size, dtype=np.int8) for _ in range(2))
    tools = np.zeros(line.size, dtype=np.int64)
    at = np.searchsorted(line, moving)
    np.add.at(columns["length"], at, program.lengths[run.row])
    np.add.at(columns["seconds"], at, seconds)
    longest = np.argsort(seconds, kind="stable")  # of several moves of a line the last to be assigned stays
    on = at[longest]
    kind[on], named[on] = _KIND_OF_MOVE[program.kind[run.row[longest]]], limit[longest]
    columns["share"][on] = np.divide(held, seconds, out=np.zeros(seconds.size), where=seconds > 0.0)[longest]
    columns["feed"] = np.full(line.size, np.nan)
    columns["feed"][on] = program.feed[run.row[longest]]
    at_rest = np.searchsorted(line, resting)
    for place, rest in zip(at_rest.tolist(), rests, strict=True):
        columns["rest"][place] += rest.seconds
        columns["dwell"][place] += rest.seconds if rest.kind == "dwell" else 0.0
        tools[place] += rest.kind == "tool_change"
    before = np.searchsorted(np.maximum.accumulate(moving), line, side="left")
    after = before.copy()
    after[at] = 0
    np.maximum.at(after, at, np.arange(1, moving.size + 1))
    before[at] = after[at] - 1
    np.minimum.at(before, at, np.arange(moving.size))
    columns["highest_feed"] = np.zeros(line.size) if highest_feed is not None else np.full(line.size, np.nan)
    if highest_feed is not None:
        np.maximum.at(columns["highest_feed"], at, highest_feed)
    return LineTimes(
        line=line,
        kind=kind,
        u_start=u[before],
        u_end=u[after],
        binding=named,
        tool_changes=tools,
        limit_names=names,
        start=_starts(run, line, before, at),
        end=np.vstack([program.start[run.row[:1]], program.end[run.row]])[after],
        **columns,
    )


def _starts(run: Schedule, line: LineArray, before: LineArray, at: LineArray) -> FloatArray:
    """When each line begins: its first move or rest; of one that does neither, when it is reached."""
    acts = np.full(line.size, np.inf)
    np.minimum.at(acts, at, run.start)
    of_rest = np.array([rest.line for rest in run.rests], dtype=np.int64)
    place = np.minimum(np.searchsorted(line, of_rest), line.size - 1)
    here = line[place] == of_rest
    np.minimum.at(acts, place[here], run.rest_start[here])
    start = run.reached(before, line)
    return np.where(np.isfinite(acts), acts, start)


def times_at(profile: FeedrateProfile, u: ArrayLike) -> FloatArray:
    """Find the times at which a plan first reaches curve parameters.

    Parameters
    ----------
    profile : FeedrateProfile
    u : (n,) array_like
        Curve parameters from end to end of the plan.

    Returns
    -------
    (n,) array
        s.  On a node its own time, elsewhere the root of the quintic between two nodes, to rounding.
    """
    wanted = np.asarray(u, dtype=np.float64)
    node = np.minimum(np.searchsorted(profile.u, wanted, side="left"), profile.u.size - 1)
    out = profile.t[node].copy()
    inside = np.flatnonzero((profile.u[node] > wanted) & (node > 0))
    if not inside.size:
        return out
    i = node[inside] - 1
    h = profile.t[i + 1] - profile.t[i]
    c = profile.law.coefficients(i)
    c[0] -= wanted[inside]
    out[inside] = profile.t[i] + _roots(c, h)
    return out


def _roots(c: FloatArray, h: FloatArray) -> FloatArray:
    """Roots in [0, h] of quintics c (6, n) that rise from below 0 to above, by Newton's method within a bracket."""
    lo, hi = np.zeros(h.size), h.copy()
    w = 0.5 * h
    todo = np.arange(h.size)
    for _ in range(_MAX_STEPS):
        x, k = w[todo], c[:, todo]
        value = k[0] + x * (k[1] + x * (k[2] + x * (k[3] + x * (k[4] + x * k[5]))))
        slope = k[1] + x * (2.0 * k[2] + x * (3.0 * k[3] + x * (4.0 * k[4] + x * 5.0 * k[5])))
        lo[todo], hi[todo] = np.where(value <= 0.0, x, lo[todo]), np.where(value > 0.0, x, hi[todo])
        with np.errstate(divide="ignore", invalid="ignore"):
            new = x - value / slope
        new = np.where((new >= lo[todo]) & (new <= hi[todo]), new, 0.5 * (lo[todo] + hi[todo]))
        w[todo] = new
        todo = todo[np.abs(new - x) > _ROUNDING * h[todo]]
        if not todo.size:
            break
    return w


def largest_share(profile: FeedrateProfile, edges: FloatArray) -> tuple[NDArray[np.int8], FloatArray]:
    """Between neighbouring times, the limit that binds for longest and for how long, s."""
    longest, held = np.zeros(edges.size - 1, dtype=np.int8), np.zeros(edges.size - 1)
    for name, seconds in _held(profile, edges):
        longest, held = np.where(seconds > held, np.int8(name), longest), np.maximum(seconds, held)
    return longest, held


def held_seconds(profile: FeedrateProfile, edges: FloatArray, group: LineArray, groups: int) -> dict[str, FloatArray]:
    """For how long each limit binds in groups of the moves between neighbouring times, s, (groups,) by its name."""
    names = profile.limit_names
    return {names[name]: _sums(group, seconds, groups) for name, seconds in _held(profile, edges)}


def _sums(group: LineArray, seconds: FloatArray, groups: int) -> FloatArray:
    return np.bincount(group, seconds, groups).astype(np.float64)


def _held(profile: FeedrateProfile, edges: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Limit by limit, for how long it binds between neighbouring times, s.

    A node speaks for the time from the middle of the interval before it to the middle of the one after it.
    """
    middle = 0.5 * (profile.t[1:] + profile.t[:-1])
    cuts = np.sort(np.concatenate([edges, middle]))
    width = np.diff(cuts)
    centre = 0.5 * (cuts[1:] + cuts[:-1])
    limit = profile.binding[np.searchsorted(middle, centre)]
    row = np.clip(np.searchsorted(edges, centre, side="right") - 1, 0, edges.size - 2)
    for name in range(1, len(profile.limit_names)):
        of_this = limit == name
        if of_this.any():
            yield name, _sums(row[of_this], width[of_this], edges.size - 1)

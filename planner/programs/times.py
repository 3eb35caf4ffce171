"""How long every line of a part program takes, and what holds it back.

The time of a line is the time law of the plan between the curve parameters at which its block begins and ends, so the
lines add up to the duration.  What happens while the machine rests is not in the plan: dwells, with their seconds, and
tool changes, whose time no program says, are columns of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.frames import Tabular
from planner.inputs import require_instance
from planner.profile import FeedrateProfile
from planner.programs.path.smooth_path import ProgramPath
from planner.programs.reading.program import ARC, LINE, RAPID, SPLINE, Program
from planner.types import FloatArray

KINDS = ("none", "rapid", "line", "arc", "spline")
_KIND_OF_MOVE = np.zeros(4, dtype=np.int8)
_KIND_OF_MOVE[[RAPID, LINE, ARC, SPLINE]] = 1, 2, 3, 4
_FORMAT = "feedplan-lines 1"
_UNITS = "mm, s; share is the part of the line's time for which the limit beside it holds it back"
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
    limit_names : tuple of str
        As in the profile; "none" first.
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
    limit_names: tuple[str, ...]

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of the file that :func:`write_line_times` writes, kinds and limits as words."""
        return {
            "line": self.line,
            "kind": np.array(KINDS, dtype=object)[self.kind],
            "length_mm": self.length,
            "seconds": self.seconds,
            "held_back_by": np.array(self.limit_names, dtype=object)[self.binding],
            "share": self.share,
            "dwell_s": self.dwell,
            "tool_changes": self.tool_changes,
            "u_start": self.u_start,
            "u_end": self.u_end,
        }

    def __repr__(self) -> str:
        parts = [f"{self.line.size} lines", f"{self.moving:.6g} s of motion"]
        parts += [f"{self.dwelling:.6g} s of dwells"] if self.dwelling else []
        parts += [f"{self.changes} tool changes"] if self.changes else []
        return f"LineTimes({', '.join(parts)})"

    @property
    def moving(self) -> float:
        """Time of all motion, s."""
        return math.fsum(self.seconds)

    @property
    def dwelling(self) -> float:
        """Time of all dwells, s."""
        return math.fsum(self.dwell)

    @property
    def changes(self) -> int:
        """Number of tool changes."""
        return int(self.tool_changes.sum())


def line_times(program: Program, path: ProgramPath, profile: FeedrateProfile) -> LineTimes:
    """Share the time of a plan out among the lines of its program.

    Parameters
    ----------
    program : Program
    path : ProgramPath
        The path of that program.
    profile : FeedrateProfile
        A plan for the curve of that path.

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
    edges = times_at(profile, path.u)
    edges[0], edges[-1] = 0.0, profile.duration
    edges = np.maximum.accumulate(edges)
    binding, held = largest_share(profile, edges)
    return combined(program, path.line, path.u, np.diff(edges), (binding, held, profile.limit_names))


def combined(
    program: Program,
    moving: NDArray[np.int64],
    u: FloatArray,
    seconds: FloatArray,
    binding: tuple[NDArray[np.int8], FloatArray, tuple[str, ...]],
) -> LineTimes:
    """Put the lines that move together with those that do not.

    Parameters
    ----------
    program : Program
    moving : (m,) int array
        Lines of the moves with a length; a line may have several.
    u : (m + 1,) array
        Curve parameters at which these begin and end.
    seconds : (m,) array
        Their times.
    binding : tuple
        The limit that holds each back for longest (m,), for how long, s, (m,), and the names of the limits.  Of a line with
        several moves it is that of the longest of them.
    """
    limit, held, names = binding
    dwells = [(event.line, event.seconds) for event in program.events if event.kind == "dwell"]
    changes = [event.line for event in program.events if event.kind == "tool_change"]
    others = [program.zero_lines, np.array([line for line, _ in dwells] + changes, dtype=np.int64)]
    line = np.unique(np.concatenate([moving, *others]))
    columns: dict[str, FloatArray] = {name: np.zeros(line.size) for name in ("length", "seconds", "share", "dwell")}
    kind, named = (np.zeros(line.size, dtype=np.int8) for _ in range(2))
    tools = np.zeros(line.size, dtype=np.int64)
    at = np.searchsorted(line, moving)
    move = np.flatnonzero(program.lengths > 0.0)
    np.add.at(columns["length"], at, program.lengths[move])
    np.add.at(columns["seconds"], at, seconds)
    longest = np.argsort(seconds, kind="stable")  # of several moves of a line the last to be assigned stays
    on = at[longest]
    kind[on], named[on] = _KIND_OF_MOVE[program.kind[move[longest]]], limit[longest]
    columns["share"][on] = np.divide(held, seconds, out=np.zeros(seconds.size), where=seconds > 0.0)[longest]
    for number, length in dwells:
        columns["dwell"][np.searchsorted(line, number)] += length
    np.add.at(tools, np.searchsorted(line, changes), 1)
    before = np.searchsorted(np.maximum.accumulate(moving), line, side="left")
    after = before.copy()
    after[at] = 0
    np.maximum.at(after, at, np.arange(1, moving.size + 1))
    before[at] = after[at] - 1
    np.minimum.at(before, at, np.arange(moving.size))
    return LineTimes(
        line=line,
        kind=kind,
        u_start=u[before],
        u_end=u[after],
        binding=named,
        tool_changes=tools,
        limit_names=names,
        **columns,
    )


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
    """Between neighbouring times, the limit that binds for longest and for how long, s.

    A node speaks for the time from the middle of the interval before it to the middle of the one after it.
    """
    middle = 0.5 * (profile.t[1:] + profile.t[:-1])
    cuts = np.sort(np.concatenate([edges, middle]))
    width = np.diff(cuts)
    centre = 0.5 * (cuts[1:] + cuts[:-1])
    limit = profile.binding[np.searchsorted(middle, centre)]
    row = np.clip(np.searchsorted(edges, centre, side="right") - 1, 0, edges.size - 2)
    longest, held = np.zeros(edges.size - 1, dtype=np.int8), np.zeros(edges.size - 1)
    for name in range(1, len(profile.limit_names)):
        of_this = limit == name
        seconds = np.bincount(row[of_this], width[of_this], edges.size - 1)
        longest, held = np.where(seconds > held, np.int8(name), longest), np.maximum(seconds, held)
    return longest, held


def write_line_times(
    path: str | Path, times: LineTimes, source: str, verdict: str, *, without_jerk: LineTimes | None = None
) -> None:
    """Write the lines as CSV or NPZ, a row each.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (also without a suffix) or ``.npz``.
    times : LineTimes
    source : str
        Name of the program, for the header.
    verdict : str
        What the check says of the plan, for the header.
    without_jerk : LineTimes, optional
        The same lines planned without a jerk limit: a column more.

    Raises
    ------
    InputError
        If the file cannot be written; then none is left behind.
    """
    from planner.files.columns import write_columns

    columns = times.columns() | {"kind": times.kind, "held_back_by": times.binding}  # as indices into words
    header = {
        "format": _FORMAT,
        "units": _UNITS,
        "program": " ".join(source.split()),
        "verdict": verdict,
        "seconds": repr(times.moving),
        "dwell_s": repr(times.dwelling),
        "tool_changes": str(times.changes),
    }
    if without_jerk is not None:
        columns["without_jerk_limit_s"] = without_jerk.seconds
        header["without_jerk_limit_s"] = repr(without_jerk.moving)
    header["rows"] = str(times.line.size)
    write_columns(path, header, columns, {"kind": KINDS, "held_back_by": times.limit_names})

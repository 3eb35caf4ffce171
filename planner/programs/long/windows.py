"""Plan a program of any length in windows, with the memory of one.

::

    program      |----|----|----|----|----|----|----|   parts of its path (``parts``), each within tolerance
    window k     |=================....|                planned from the state before, at rest at its far end
    window k+1                    |=================....|

1.  A window is a stretch of path of some thousand intervals and a length ahead of it.  It ends at an exact stop where one is
    near; else anywhere, and is planned to end at rest there.
2.  Of a window that ends at rest because it must, only what lies before the length ahead is kept.  That length is several
    times what stopping and getting up to speed again take, so what is kept is what a plan of the whole would do, but for
    little.
3.  The next window begins where the kept part ends, with its feed and its tangential acceleration.  The path ahead is the
    same, piece by piece, so the plan before could go on from there, and a plan exists.  To a solver such a state may be no
    start, being on the very edge of what can be held: from shortly before the end of what is kept, a window leaves half a
    percent of its limits unused.
4.  A window counts only when the next one was planned.  Until then its end is moved on by some pieces; if no end serves, the
    window is taken with its stop, and said so.
5.  Every window is checked by :mod:`planner.verify` as any plan is; the joints are measured in feed and acceleration.

What a window needs of the past is small; it is on disk (``journal``) after each window, so an interrupted run goes on, once
what it left has been verified (``restore``).
"""

from __future__ import annotations

import gc
import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from planner.errors import InputError
from planner.files.whole_file import require_writable
from planner.geometry.tolerance import PathKind
from planner.inputs import positive_number, require_path
from planner.machine.limits import SCALARS, Limits
from planner.programs.line_table import write_line_times
from planner.programs.long.done import Done
from planner.programs.long.journal import FORMAT, Journal
from planner.programs.long.path_ahead import PathAhead
from planner.programs.long.path_source import PathSource
from planner.programs.long.restore import restored
from planner.programs.long.window import Planner
from planner.programs.path.joint_runs import reason_of_machine
from planner.programs.path.moves import ProgramAxes
from planner.programs.reading.program import Program
from planner.programs.reading.reader import read_program
from planner.programs.schedule import Schedule
from planner.programs.times import LineTimes, combined
from planner.quantity import AXIS
from planner.types import FloatArray, Progress
from planner.verify.findings import BREAKS, HOLDS

_COLUMNS = ("t", "u", "u_rate", "u_acceleration", "feed", "position")


@dataclass(frozen=True)
class ProgramPlan:
    """The plan of a long program, which lies on disk.

    Attributes
    ----------
    table : Path
        NPZ with the nodes of all windows end to end: ``t`` and ``u`` (from the start of each window), ``u_rate``,
        ``u_acceleration``, ``feed`` and ``position``; ``first`` (w + 1,) tells which nodes a window has, ``t_start`` and
        ``u_start`` (w,) what to add to its t and u; ``axes``; ``verdict``, what the check says.  The last node of a window
        and the first of the next are the same state.
    lines : Path
        The time of every line, as :func:`~planner.programs.times.write_line_times` writes it.
    duration, dwell : float
        Time of the motion, and of the dwells beside it, s.
    length : float
        Of the path, mm.
    blocks, windows, resumed : int
        Blocks, windows, and those of the windows that an earlier run had finished.
    stops : int
        Windows that end at rest where the path would not need it.
    deviation, deviation_share : float
        The largest deviation of the path from the program, mm, and the largest against the tolerance in force there.
    deviation_line : int
        The line the largest deviation was found at.
    worst : float
        The largest use of any limit in any window, as the check measures it.
    worst_limit : str
        Which limit that is.
    joint_feed, joint_acceleration : float
        The largest steps of feed (mm/s) and tangential acceleration (mm/s^2) between windows.
    violations : tuple of str
        Limits that do not hold, with the line; empty where the plan is sound.
    notes : tuple of str
        What a reader of the verdict should know.
    runs, joint : int
        Runs of the path from stop to stop, and those of them of which path and feed were found together; 0 where all of the
        path was to be made separately.
    """

    table: Path
    lines: Path
    duration: float
    dwell: float
    length: float
    blocks: int
    windows: int
    resumed: int
    stops: int
    deviation: float
    deviation_share: float
    deviation_line: int
    worst: float
    worst_limit: str
    joint_feed: float
    joint_acceleration: float
    violations: tuple[str, ...]
    notes: tuple[str, ...]
    runs: int
    joint: int

    @property
    def ok(self) -> bool:
        """Every limit holds in every window, and the path keeps its tolerance."""
        return not self.violations and self.deviation_share <= 1.0


def plan_program(
    source: str | Path | Program,
    limits: Limits,
    tolerance: float | None = None,
    *,
    output: str | Path,
    path: PathKind = "joint",
    progress: Progress | None = None,
    resume: bool = True,
    cores: int = 1,
) -> ProgramPlan:
    """Plan a program in windows; write its nodes and the time of every line.

    Parameters
    ----------
    source : str, Path or Program
    limits : Limits
        Of the machine; jerk must be limited.
    tolerance : float or None
        Largest distance between path and program, mm, in place of the program's own.
    output : str or Path
        The table, ``.npz``; the times go to the same name with ``.lines.csv``, the work in progress to a directory beside
        it.
    path : {"joint", "separate"}
        Find path and feed as one problem, run by run from stop to stop, as :func:`~planner.program_path` does, or the path
        first.  Of a run of some thousand blocks or more without a stop the path is made first.
    progress : callable, optional
        Called with a message and the share done (or None).
    resume : bool
        Go on where an interrupted run of the same program, tolerance and limits to this output ended; else what such a run
        left is deleted.
    cores : int
        How many processors to use.  With more than one, another process makes the path beside the plan, a thread checks a
        window while the next one is planned, and two processes find the runs of which path and feed are one problem.  More
        are of no more use; the files are the same to the last bit.

    Returns
    -------
    ProgramPlan

    Raises
    ------
    InputError, SolverError, InfeasibleError
        As :func:`~planner.program_path` and :func:`~planner.plan_feedrate` do; and if what an earlier run
        left is damaged, of another version or of other inputs.
    """
    table = require_path(output, name="output")
    if table.suffix.lower() != ".npz":
        raise InputError(f"{output}: the plan of a long program is an NPZ table; give a name that ends in .npz")
    lines = table.with_suffix(".lines.csv")
    for file in (table, lines):
        require_writable(file)
    if progress is not None:
        progress("reading the program", None)
    program = source if isinstance(source, Program) else read_program(source)
    built, why = _path_source(program, limits, tolerance, path)
    journal = Journal.beside(table, _identity(built, limits), resume=resume)
    with PathAhead(built, cores) as ahead, ThreadPoolExecutor(1) as thread:
        planner = Planner(built, limits, ahead.next, thread if cores > 1 else None)
        done, resumed = _planned(journal, planner, progress)
    if progress is not None:
        progress(f"writing {table}", None)
    verdict = _verdict(done)
    write_line_times(lines, _line_times(journal, done, program), program.source, verdict)
    starts = np.array(list(journal.column(done.windows, "start")))
    arrays = {"format": np.array(FORMAT), "verdict": np.array(verdict), "axes": np.array(built.limits.axes)}
    arrays |= {"t_start": starts[:, 0], "u_start": starts[:, 1]}
    journal.join(table, done.windows, _COLUMNS, arrays)
    journal.remove()
    lost = (f"{ahead.lost}; from there on the path was made by the one of the plan",) if ahead.lost else ()
    return _outcome(done, program, (table, lines), resumed, (*program.notes, *why, *lost))


def _planned(journal: Journal, planner: Planner, progress: Progress | None) -> tuple[Done, int]:
    """Plan window after window into a journal; what they amount to, and how many an earlier run had finished."""
    if progress is not None:
        progress("verifying what an earlier run left", None)
    done, state = restored(journal, planner)
    resumed, rows = done.windows, len(planner.path.program)
    window = None if state is None else planner.plan(state)
    while window is not None:
        if progress is not None:
            progress(f"window {done.windows + 1}", window.state.first_row / rows)
        kept, window = planner.keep(window)
        journal.save_window(done.windows, kept.columns)
        done = done.with_window(kept)
        header = {"done": asdict(done), "state": None if window is None else window.state.header()}
        journal.save_state(header, {} if window is None else window.state.arrays())
        # A curve and its arc length hold each other, and the collector does not count what their arrays take.
        gc.collect()
    return done, resumed


def _path_source(
    program: Program, limits: Limits, tolerance: float | None, path: PathKind
) -> tuple[PathSource, tuple[str, ...]]:
    """The program with the limits of the axes that it moves; and a note where the machine allows no joint path."""
    if path not in get_args(PathKind):
        raise InputError(f"path = {path!r} must be one of {', '.join(get_args(PathKind))}")
    if tolerance is not None:
        tolerance = positive_number(tolerance, "tolerance")
        if not np.isfinite(tolerance):
            raise InputError("tolerance = inf mm must be finite")
    limits = program.require_axes(limits)
    if not (program.lengths > 0.0).any():
        raise InputError(
            f"{program.source}: the program moves nothing, in the digits of its numbers; a plan needs a move"
        )
    used = ProgramAxes.of(program)
    axes = used.names
    missing = [name for name in axes if name not in limits.axes]
    if missing:
        raise InputError(f"the machine has no axis {missing[0]}; its axes are {', '.join(limits.axes)}")
    at = [limits.axes.index(axis) for axis in axes]
    rows: dict[str, Any] = {q.key: getattr(limits, q.key)[at] for q in AXIS}
    if not all(np.isfinite(row).all() for row in rows.values()):
        raise InputError(
            "a program is planned in windows only where velocity, acceleration and jerk of every axis that moves are finite"
        )
    shaped = Limits(limits.feed, **rows, axes=axes, rapid=limits.rapid)
    whole = limits.for_axes(axes, program.source)
    # Of its slowest move: the others are looked at run by run.
    slowest = float(min(program.feed[program.lengths > 0.0].min(), whole.rapid))
    reason = reason_of_machine(whole, min(slowest, whole.feed)) if path == "joint" else ""
    joint = whole if path == "joint" and not reason else None
    why = (f"the path is made separately from the feed: {reason}",) if reason else ()
    return PathSource(program, used, tolerance, shaped, joint), why


def _identity(path: PathSource, limits: Limits) -> str:
    """What a plan depends on, as a hash."""
    made = "separate" if path.joint is None else "joint"
    digest = hashlib.sha256(f"{FORMAT}, blocks absorbed, path {made}".encode())
    program = path.program
    for name in ("kind", "start", "end", "centre", "normal", "sweep", "feed", "stop_after", "tolerance", "line"):
        digest.update(np.ascontiguousarray(getattr(program, name)).data)
    words = [repr(getattr(limits, name)) for name in SCALARS]
    words += [repr(limits.of(q)) for q in AXIS]
    digest.update(" ".join([*words, *limits.axes, repr(path.tolerance)]).encode())
    return digest.hexdigest()


def _line_times(journal: Journal, done: Done, program: Program) -> LineTimes:
    """The time of every line; that of one which two windows share is the sum."""
    size = len(program)
    moving = program.lengths > 0.0
    seconds, held, binding = np.zeros(size), np.zeros(size), np.zeros(size, dtype=np.int8)
    u = np.full((2, size), np.nan)
    names = ("row", "seconds", "held", "binding", "edges", "start")
    for row, taken, longest, limit, edges, start in zip(
        *(journal.column(done.windows, name) for name in names), strict=True
    ):
        seconds[row] += taken
        more = longest > held[row]
        held[row], binding[row] = np.where(more, longest, held[row]), np.where(more, limit, binding[row])
        u[0, row] = np.fmin(u[0, row], start[1] + edges[:-1])
        u[1, row] = np.fmax(u[1, row], start[1] + edges[1:])
    edges = _filled(np.append(u[0, moving], np.nanmax(u[1])))
    limit = binding[moving], held[moving], done.limit_names
    return combined(program, Schedule.of(program, seconds[moving]), edges, limit)


def _verdict(done: Done) -> str:
    """What the checks of the windows say, for the heads of files."""
    if done.violations:
        return f"{BREAKS}: {len(done.violations)} checks fail, the first is {done.violations[0]}"
    if done.share > 1.0:
        return f"{BREAKS}: the path leaves its tolerance by {done.share - 1.0:.3g} of it"
    return HOLDS


def _filled(edges: FloatArray) -> FloatArray:
    """Edges of blocks of which some, absorbed where a window ends, have none: they are at the next."""
    at = np.where(np.isnan(edges), edges.size, np.arange(edges.size))
    return edges[np.minimum.accumulate(at[::-1])[::-1]]


def _outcome(
    done: Done, program: Program, files: tuple[Path, Path], resumed: int, notes: tuple[str, ...]
) -> ProgramPlan:
    more = done.made_separately - len(done.separate)
    said = (*done.separate, *([f"and so are {more} runs more"] if more else []))
    return ProgramPlan(
        table=files[0],
        lines=files[1],
        duration=done.t,
        dwell=float(sum(event.seconds for event in program.events)),
        length=done.u,
        blocks=len(program),
        windows=done.windows,
        resumed=resumed,
        stops=done.stops,
        deviation=done.deviation,
        deviation_share=done.share,
        deviation_line=int(program.line[done.deviation_row]),
        worst=done.worst,
        worst_limit=done.worst_limit,
        joint_feed=done.joint_feed,
        joint_acceleration=done.joint_acceleration,
        violations=done.violations,
        notes=(*notes, *done.notes, *said),
        runs=done.runs,
        joint=done.runs - done.made_separately,
    )

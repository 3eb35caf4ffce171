"""A window of a long program: where it begins, how it is planned, and what is kept of it.

Rules 1 to 4 of :mod:`planner.programs.long.windows` are here.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import FeedrateError, InfeasibleError, SolverError
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.profile import FeedrateProfile
from planner.programs.long.path_ahead import MakePart
from planner.programs.long.path_source import Cursor, PathSource
from planner.programs.long.run import Run
from planner.programs.path.feeds import caps_of_blocks
from planner.programs.path.smooth_path import MIN_INTERVALS
from planner.programs.times import largest_share, times_at
from planner.types import FloatArray
from planner.verify import Report, check

_WINDOW = 8000  # intervals of a plan that are kept
_SEVERAL = 3.0  # times stopping and getting up to speed again
_MIN_KEPT = 0.5  # of a window's length
_RESERVE = 5e-3  # of the limits, left unused from shortly before the end of what is kept
_MARGIN = 2e-4
_RESERVE_PIECES = 2  # from so many pieces before the end of what is kept
_ENDS = (0, 2, 4, 8)  # pieces after that, at which the kept part may end as well
_NUMBERS = ("rests", "feed", "acceleration", "t", "u", "share", "deviation", "deviation_row", "runs")


@dataclass(frozen=True, eq=False)
class WindowStart:
    """From where a window begins.

    Attributes
    ----------
    queue : Run or None
        Path that is built and not yet kept; begins where the window does.
    rests : bool
        The path rests at the end of the queue.
    cursor : Cursor or None
        Where the next part of the path begins; None when the program has none.
    feed, acceleration : float
        At the start of the window, mm/s and mm/s^2, along the path.
    t, u : float
        Time and parameter of the start, s and mm.
    share, deviation, deviation_row
        Largest deviation of parts that no window has counted yet: against its tolerance, in mm, and where.
    notes : tuple of str
        Exact stops that no window has counted yet.
    runs : int
        Runs of which path and feed were to be found together, of these parts.
    separate : tuple of str
        Those of them that were made separately, and why.
    """

    queue: Run | None
    rests: bool
    cursor: Cursor | None
    feed: float = 0.0
    acceleration: float = 0.0
    t: float = 0.0
    u: float = 0.0
    share: float = 0.0
    deviation: float = 0.0
    deviation_row: int = 0
    notes: tuple[str, ...] = ()
    runs: int = 0
    separate: tuple[str, ...] = ()

    @property
    def first_row(self) -> int:
        """Row of the program at which the window begins, nearly."""
        if self.queue is not None:
            return int(self.queue.row[0])
        return 0 if self.cursor is None else self.cursor.row

    def header(self) -> dict[str, Any]:
        """Everything that is no array."""
        out = {name: getattr(self, name) for name in (*_NUMBERS, "notes", "separate")}
        if self.cursor is not None:
            cursor = self.cursor
            out["cursor"] = {name: getattr(cursor, name) for name in ("row", "offset", "rests", "blocks", "deferred")}
        runs = {"queue": self.queue, "tail": None if self.cursor is None else self.cursor.tail}
        out["axes"] = {name: list(run.curve.axes) for name, run in runs.items() if run is not None}
        return out

    def arrays(self) -> dict[str, FloatArray]:
        """Everything that is."""
        out: dict[str, FloatArray] = {}
        runs = {"queue": self.queue, "tail": None if self.cursor is None else self.cursor.tail}
        for name, run in runs.items():
            if run is not None:
                out |= {f"{name}.{key}": value for key, value in run.arrays().items()}
        if self.cursor is not None and self.cursor.entry is not None:
            out["entry"] = self.cursor.entry
        return out

    @classmethod
    def of(cls, header: dict[str, Any], arrays: dict[str, NDArray[Any]], limits: Limits | None) -> WindowStart:
        """The state that header and arrays came from; ``limits``: those for which path and feed are found together."""
        runs: dict[str, Run | None] = {"queue": None, "tail": None}
        for name, axes in header["axes"].items():
            own = {key.removeprefix(f"{name}."): value for key, value in arrays.items() if key.startswith(f"{name}.")}
            runs[name] = Run.of_arrays(own, tuple(axes), "program", limits)
        cursor = None
        if "cursor" in header:
            cursor = Cursor(entry=arrays.get("entry"), tail=runs["tail"], **header["cursor"])
        values = {name: header[name] for name in _NUMBERS}
        values |= {name: tuple(header[name]) for name in ("notes", "separate")}
        return cls(runs["queue"], cursor=cursor, **values)


@dataclass(frozen=True, eq=False)
class Window:
    """A planned window: the state it began from with all parts it needed, its path and its plan.

    ``reserve_edge`` is the edge of the path from which on a reserve is left; ``ends_at_stop``: none is, all is kept.
    ``report`` waits for what the check says.
    """

    state: WindowStart
    path: Run
    ends_at_stop: bool
    reserve_edge: int
    curve: Curve
    profile: FeedrateProfile
    report: Callable[[], Report]


@dataclass(frozen=True, eq=False)
class Kept:
    """What is kept of a window: columns for the journal, time and parameter at its end, and what was found.

    ``stopped``: it ends at rest where the path would not need it; ``joint``: steps of feed and tangential acceleration
    against the window before; ``runs`` and ``separate`` as of the state.
    """

    columns: dict[str, NDArray[Any]]
    t: float
    u: float
    report: Report
    limit_names: tuple[str, ...]
    stopped: bool
    joint: tuple[float, float]
    share: float
    deviation: float
    deviation_row: int
    violations: tuple[str, ...]
    notes: tuple[str, ...]
    runs: int
    separate: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans windows of one program; ``parts`` makes the part of its path at a cursor.

    ``beside``: a thread that checks a window while the next one is planned; None where there is no processor for it.
    """

    path: PathSource
    limits: Limits
    parts: MakePart
    beside: Executor | None = None

    def plan(self, state: WindowStart) -> Window:
        """Plan the window that begins at a state."""
        state = self.filled(state)
        queue = state.queue
        assert queue is not None
        last, ends_at_stop = self.end_of(state, queue)
        run = queue.pieces(0, last)
        curve, limits = self.limited(run)
        edge = last if ends_at_stop else self._reserve_edge(run)
        profile = plan_feedrate(
            curve,
            limits,
            reserve=self._reserve(state, None if ends_at_stop else float(run.curve.edges[edge])),
            start_feed=state.feed,
            start_acceleration=state.acceleration if state.feed > 0.0 else None,
            # What was found with its path has a grid; the rest of such a window gets what it needs.
            intervals=None if run.laws else max(MIN_INTERVALS, int(run.intervals.sum())),
        )
        return Window(state, run, ends_at_stop, edge, curve, profile, self._checked(curve, limits, profile))

    def _checked(self, curve: Curve, limits: Limits, profile: FeedrateProfile) -> Callable[[], Report]:
        """Check a plan; returns what waits for the report."""
        if self.beside is None:
            return partial(check, curve, limits, profile)
        return self.beside.submit(check, curve, limits, profile).result

    def limited(self, run: Run) -> tuple[Curve, Limits]:
        """Curve and limits of a run.

        Where one cap is the lowest everywhere, it is the feed of the limits, and neither planned nor checked twice.
        Rapids, of which the cap is inf, have a limit of their own.  What was found with its feed keeps the limits it was
        found for.
        """
        if run.laws or run.angular.any():  # of the latter the feed of the limits says nothing
            return run.with_caps(), self.limits.for_curve(run.curve)
        feed = min(self.limits.feed, float(run.feed.max()))
        curve = run.curve if feed <= run.feed.min() < np.inf else run.with_caps()
        return curve, self.limits.for_curve(curve).with_feed(feed)

    def filled(self, state: WindowStart) -> WindowStart:
        """Add parts of the path until there is enough for a window and what lies ahead of it."""
        while state.cursor is not None:
            queue = state.queue
            if queue is not None and self._enough(state, queue):
                break
            part, cursor = self.parts(state.cursor)
            state = replace(
                state,
                queue=part.run if queue is None else queue.joined(part.run, rests=state.rests),
                rests=part.rests,
                cursor=cursor,
                share=max(state.share, part.share),
                notes=state.notes + tuple(self._stop(row, reason) for row, reason in part.stops),
                runs=state.runs + part.runs,
                separate=state.separate + tuple(self._separate(row, reason) for row, reason in part.separate),
            )
            if part.deviation > state.deviation:
                state = replace(state, deviation=part.deviation, deviation_row=part.deviation_row)
        return state

    def _stop(self, row: int, reason: str) -> str:
        return f"exact stop after line {self.path.program.line[row]}: {reason}"

    def _separate(self, row: int, reason: str) -> str:
        return f"from line {self.path.program.line[row]} to the next stop the path is made separately: {reason}"

    def _enough(self, state: WindowStart, queue: Run) -> bool:
        reach = self._reach(queue)
        if reach is None:
            return False
        # Where the window ends at a stop that is known already, nothing ahead of that matters.
        return queue.length >= reach[0] + reach[1] or self._stop_near(state, queue)[1] is not None

    def _stop_near(self, state: WindowStart, queue: Run) -> tuple[NDArray[np.intp], int | None]:
        """Edges at which the path rests, from half of a window on; and the last of them that is within one, if any is."""
        size = queue.curve.kind.size
        stops = np.append(queue.stops, size) if state.rests else queue.stops
        enough = int(np.searchsorted(np.cumsum(queue.intervals), _WINDOW)) + 1
        near = stops[stops >= min(enough, size) // 2]
        within = near[near <= enough]
        return near, int(within[-1]) if within.size else None

    def _reach(self, queue: Run) -> tuple[float, float] | None:
        """Lengths of what a window keeps and of what lies ahead of that, mm; None where the queue is shorter."""
        count = np.cumsum(queue.intervals)
        if count[-1] < _WINDOW:
            return None
        kept = float(queue.curve.edges[np.searchsorted(count, _WINDOW) + 1])
        ahead = self.ahead(queue)
        return max(kept, ahead), ahead

    def ahead(self, run: Run) -> float:
        """Length ahead of what is kept of a window, mm: several times stopping and getting up to speed again."""
        limits = self.path.limits
        commanded = caps_of_blocks(run.u, run.feed, run.angular).commanded(limits.feed, limits.rapid)
        scale = self.path.used.scale
        feed = min(float(commanded.max()), float(np.sqrt(np.sum((scale * limits.velocity) ** 2))))
        acceleration, jerk = (float((scale * row).min()) for row in (limits.acceleration, limits.jerk))
        acceleration = min(acceleration, float(np.sqrt(feed * jerk)))
        return _SEVERAL * 2.0 * 0.5 * feed * (feed / acceleration + acceleration / jerk)

    def end_of(self, state: WindowStart, queue: Run) -> tuple[int, bool]:
        """Piece before which the window ends, and whether the path rests there anyway."""
        last, at_stop = self._usual_end(state, queue)
        timed = queue.timed
        before = timed[timed[:, 0] < last]
        if not before.size:
            return last, at_stop
        # Laws begin at rest, and leave nothing of their limits to make up for a beginning of the window that does not.
        if state.feed > 0.0:
            return int(before[0, 0]), True
        if at_stop and last >= before[-1, 1]:
            return last, True
        # Inside of a law, or somewhere behind one: the end of that law.
        return int(before[-1, 1]), True

    def _usual_end(self, state: WindowStart, queue: Run) -> tuple[int, bool]:
        """As :meth:`end_of`, as if nothing had been found with its feed."""
        size = queue.curve.kind.size
        near, within = self._stop_near(state, queue)
        if within is not None:
            return within, True
        reach = self._reach(queue)
        last = size if reach is None else min(size, int(np.searchsorted(queue.curve.edges, reach[0] + reach[1])))
        if near.size and near[0] <= last:
            return int(near[0]), True
        return last, False

    def keep(self, window: Window) -> tuple[Kept, Window | None]:
        """Decide how much of a window is kept, and plan the next."""
        run = window.path
        end = run.curve.kind.size
        follower = replace(self, parts=cache(self.parts))  # another try needs the parts of the one before again
        if not window.ends_at_stop:
            for edge in window.reserve_edge + _RESERVE_PIECES + np.array(_ENDS):
                if edge >= end:
                    break
                following = self._after(window, int(edge))
                try:
                    planned = follower.plan(following)
                except (InfeasibleError, SolverError):
                    continue
                return self._kept(window, int(edge), stopped=False), planned
        following = self._after(window, end)
        kept = self._kept(window, end, stopped=not window.ends_at_stop)
        if following.queue is None and following.cursor is None:
            return kept, None
        return kept, follower.plan(following)

    @staticmethod
    def _reserve(state: WindowStart, end: float | None) -> list[tuple[float, float]]:
        """Shares of the limits that a window leaves unused.

        One that begins with a feed cannot be slowed down as a whole to make up for what its limits are exceeded by between
        the points of its grid; a little of them throughout is no more than that would cost.
        """
        steps = [(0.0, _MARGIN)] if state.feed > 0.0 else []
        return steps if end is None else [*steps, (end, _RESERVE)]

    def _reserve_edge(self, run: Run) -> int:
        """Edge from which on a window leaves a reserve; its kept part ends ``_RESERVE_PIECES`` later or more."""
        edges = run.curve.edges
        kept = max(run.length - self.ahead(run), _MIN_KEPT * run.length)
        return max(int(np.searchsorted(edges, kept, side="right")) - 1 - _RESERVE_PIECES, 0)

    def _after(self, window: Window, edge: int) -> WindowStart:
        """The state behind a window that ends at an edge."""
        at_rest = edge == window.path.curve.kind.size
        return self.state_after(window.state, window.path, edge, window.profile, at_rest=at_rest)

    @staticmethod
    def state_after(
        state: WindowStart, path: Run, edge: int, profile: FeedrateProfile, *, at_rest: bool
    ) -> WindowStart:
        """The state behind an edge of a path that was planned from a state."""
        queue = state.queue
        assert queue is not None
        size = queue.curve.kind.size
        node = int(_nodes_at(profile, path.curve.edges[[edge]])[0])
        return WindowStart(
            queue=queue.pieces(edge, size) if edge < size else None,
            rests=state.rests,
            cursor=state.cursor,
            feed=0.0 if at_rest else float(profile.feed[node]),
            acceleration=0.0 if at_rest else float(profile.acceleration[node]),
            t=state.t + float(profile.t[node]),
            u=state.u + float(path.curve.edges[edge]),
        )

    def _kept(self, window: Window, edge: int, *, stopped: bool) -> Kept:
        """Columns of a window up to an edge, and what was found in it."""
        profile, run, state = window.profile, window.path, window.state
        node = int(_nodes_at(profile, run.curve.edges[[edge]])[0])
        inside = slice(0, node + 1)
        columns: dict[str, NDArray[Any]] = {
            name: np.array(getattr(profile, name)[inside]) for name in ("t", "u", "u_rate", "u_acceleration", "feed")
        }
        columns["position"] = window.curve.derivatives(columns["u"], 0)[0]
        columns["start"] = np.array([state.t, state.u])
        u_end = float(run.curve.edges[edge])
        ends = np.append(run.u[run.u < u_end], u_end)
        count = ends.size - 1
        times = times_at(profile, np.concatenate([ends, run.u[run.u > u_end]]))
        longest, held = largest_share(profile, times)
        columns |= {"row": run.row[:count], "edges": ends, "seconds": np.diff(times)[:count]}
        columns |= {"binding": longest[:count], "held": held[:count]}
        return self.kept_of(state, run, profile, window.report(), columns, stopped=stopped)

    def kept_of(
        self,
        state: WindowStart,
        run: Run,
        profile: FeedrateProfile,
        report: Report,
        columns: dict[str, NDArray[Any]],
        *,
        stopped: bool,
    ) -> Kept:
        """What is kept of a plan of a run that begins in a state: the columns, up to the last of their edges."""
        return Kept(
            columns=columns,
            t=state.t + float(columns["t"][-1]),
            u=state.u + float(columns["edges"][-1]),
            report=report,
            limit_names=profile.limit_names,
            stopped=stopped,
            joint=(abs(float(profile.feed[0]) - state.feed), abs(float(profile.acceleration[0]) - state.acceleration)),
            share=state.share,
            deviation=state.deviation,
            deviation_row=state.deviation_row,
            violations=violations_of(report, run, self.path.program.line),
            notes=self._notes_of(state, run, stopped=stopped),
            runs=state.runs,
            separate=state.separate,
        )

    def _notes_of(self, state: WindowStart, run: Run, *, stopped: bool) -> tuple[str, ...]:
        """What is to be said of a window, whose path is the run."""
        if not stopped:
            return state.notes
        line = self.path.program.line[run.row[-1]]
        return (*state.notes, f"the plan rests after line {line}: no state before it served to go on from")


def violations_of(report: Report, run: Run, line: NDArray[np.int64]) -> tuple[str, ...]:
    """The limits that do not hold, each with the line of the program."""
    at = [min(int(np.searchsorted(run.u, row.u, side="right")) - 1, run.row.size - 1) for row in report.violations]
    return tuple(
        f"line {line[run.row[k]]}: {row.limit} {row.axis} {row.worst:.6g} of {row.allowed:.6g} {row.unit}"
        for k, row in zip(at, report.violations, strict=True)
    )


def _nodes_at(profile: FeedrateProfile, u: FloatArray) -> NDArray[np.intp]:
    """The first node at each parameter, which must be that of a node."""
    node = np.minimum(np.searchsorted(profile.u, u, side="left"), profile.u.size - 1)
    if (profile.u[node] != u).any():
        raise FeedrateError("a plan has no node at an edge of its path")
    return np.asarray(node)

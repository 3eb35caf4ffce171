"""What an interrupted run left is verified before it counts.

Of the journal only the time law of each window is taken.  The path is built again from the program, part after part, as the
run before did; every window's law is checked on it against the limits as any plan is, and must begin in the state in which
the one before it ended.  Everything else in the files (positions, lines and their seconds, totals, and the state from which
to go on) follows, and must be what they say.  What a file alone can say is what of the discarded end of a window was found;
it may be worse than what is found again, not better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.law import TimeLaw
from planner.profile import FeedrateProfile, make_profile
from planner.programs.long.done import Done
from planner.programs.long.journal import Journal
from planner.programs.long.parts import first_cursor
from planner.programs.long.run import Run
from planner.programs.long.window import Kept, Planner, WindowStart
from planner.programs.times import largest_share, times_at
from planner.verify import check

_NAMES = (
    "t",
    "u",
    "u_rate",
    "u_acceleration",
    "feed",
    "position",
    "start",
    "row",
    "edges",
    "seconds",
    "binding",
    "held",
)
_SAME = 1e-9  # of sizes, mm and s: what the rounding of another build of the path may change
_JOINT_FEED, _JOINT_ACCELERATION = 1e-6, 1e-4  # of the largest feed and acceleration


@dataclass(frozen=True, eq=False)
class _Restored:
    """A window of the journal on its path: what is kept of it, the state behind it."""

    kept: Kept
    after: WindowStart


def restored(journal: Journal, planner: Planner) -> tuple[Done, WindowStart | None]:
    """Verify the windows of a journal.

    Returns
    -------
    done : Done
        What they amount to.
    state : State or None
        From which to go on; None where nothing is left to plan.

    Raises
    ------
    InputError
        Naming the file, if one is damaged, of another version, of other inputs, or says what does not follow.
    """
    state: WindowStart | None = WindowStart(None, True, first_cursor())
    saved = journal.state()
    if saved is None:
        return Done(), state
    header, arrays = saved
    said = _totals(journal, header)
    states: Any = header.get("state")
    done = Done()
    for index in range(said.windows):
        if state is None:
            raise journal.refusal(
                journal.state_path, f"it counts {said.windows} windows, but the program ends after {index}"
            )
        window = _window(journal, planner, index, planner.filled(state), said)
        done = done.with_window(window.kept)
        state = window.after
        state = None if state.queue is None and state.cursor is None else planner.filled(state)
    _require_totals(journal, done, said)
    _require_state(journal, state, states, arrays)
    return said, None if state is None else WindowStart.of(states, arrays, planner.path.joint)


def _totals(journal: Journal, header: Mapping[str, Any]) -> Done:
    """The totals that a journal claims, each of its type."""
    found = header.get("done")
    names = {field.name: type(getattr(Done(), field.name)) for field in fields(Done)}
    if not isinstance(found, dict) or set(found) != set(names):
        raise journal.refusal(journal.state_path, "its totals are not those of this version")
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}
    for name, kind in names.items():
        if type(values[name]) is not kind or (
            kind is tuple and not all(isinstance(item, str) for item in values[name])
        ):
            raise journal.refusal(journal.state_path, f"{name} is no {kind.__name__}")
    return Done(**values)


def _window(journal: Journal, planner: Planner, index: int, state: WindowStart, said: Done) -> _Restored:
    """Check one window on the path that begins in a state."""
    path, columns = journal.window_path(index), journal.window(index, _NAMES)
    queue = state.queue
    assert queue is not None
    last, ends_at_stop = planner.end_of(state, queue)
    end = columns["edges"][-1] if columns["edges"].size else np.nan
    edge = int(np.searchsorted(queue.curve.edges, end))
    if not 0 < edge <= last or queue.curve.edges[edge] != end:
        raise journal.refusal(path, f"it ends at u = {end!r}, where no piece of the path does")
    run = queue.pieces(0, edge)
    profile = _profile(journal, planner, run, columns, index)
    curve, limits = planner.limited(run)
    report = check(curve, limits, profile)
    kept = planner.kept_of(state, run, profile, report, columns, stopped=edge == last and not ends_at_stop)
    if len(kept.violations) > len(said.violations):
        broken = kept.violations[0]
        raise journal.refusal(path, f"it breaks a limit, which the run that wrote it did not say ({broken})")
    start = np.array([state.t, state.u])
    count = columns["edges"].size - 1
    ends = np.append(run.u[run.u < end], end)
    longest, held = largest_share(profile, times_at(profile, ends))
    expected = {
        "position": curve.derivatives(profile.u, 0)[0],
        "start": start,
        "row": run.row[:count],
        "edges": ends,
        "seconds": np.diff(times_at(profile, ends)),
    }
    for name, values in expected.items():
        if columns[name].shape != values.shape or not np.allclose(columns[name], values, rtol=_SAME, atol=_SAME):
            raise journal.refusal(path, f"its column {name} does not follow from its time law and the program")
    # The last node of a window belongs to the next one as well; the limit that it names may be either's.
    inner = slice(0, max(count - 1, 0))
    slack = _SAME + 2.0 * float(np.diff(profile.t).max())
    if (columns["binding"][inner] != longest[inner]).any() or not np.allclose(columns["held"], held, atol=slack):
        raise journal.refusal(path, "it names other limits than those that hold its lines back")
    largest = float(np.min(limits.acceleration))
    if kept.joint[0] > _JOINT_FEED * float(profile.feed.max()) or kept.joint[1] > _JOINT_ACCELERATION * largest:
        raise journal.refusal(
            path,
            f"it begins with {kept.joint[0]:.3g} mm/s and {kept.joint[1]:.3g} mm/s^2 off the state of the window before it",
        )
    return _Restored(kept, planner.state_after(state, run, edge, profile, at_rest=edge == last))


def _profile(
    journal: Journal, planner: Planner, run: Run, columns: Mapping[str, NDArray[Any]], index: int
) -> FeedrateProfile:
    """The time law of a window as a plan of the path that is kept, with the feed that the file says."""
    path = journal.window_path(index)
    law = [columns[name] for name in ("t", "u", "u_rate", "u_acceleration", "feed")]
    t, u = law[:2]
    if t.ndim != 1 or t.size < 2 or any(column.shape != t.shape or column.dtype != np.float64 for column in law):
        raise journal.refusal(path, "its columns t, u, u_rate, u_acceleration and feed have no common length")
    if not all(np.isfinite(column).all() for column in law) or t[0] != 0.0 or (np.diff(t) < 0.0).any() or t[-1] <= 0.0:
        raise journal.refusal(path, "its numbers must be finite, and its times increase from 0")
    if u[0] != 0.0 or u[-1] != run.length or (np.diff(u) < 0.0).any():
        raise journal.refusal(path, f"its parameter must increase from 0 to {run.length!r}")
    curve, limits = planner.limited(run)
    profile = make_profile(curve, limits, TimeLaw(*law[:4]), method="optimal")
    return replace(profile, feed=law[4])


def _require_totals(journal: Journal, done: Done, said: Done) -> None:
    for name, value in asdict(done).items():
        claim = getattr(said, name)
        if name in ("worst", "worst_limit", "violations"):
            continue
        near = isinstance(value, float) and np.isclose(claim, value, rtol=_SAME, atol=1e3 * _SAME)
        if not near and claim != value:
            raise journal.refusal(journal.state_path, f"{name} = {claim!r}, but the windows give {value!r}")
    if not said.worst >= done.worst * (1.0 - _SAME) - _SAME or len(said.violations) < len(done.violations):
        raise journal.refusal(
            journal.state_path,
            f"it says that {said.worst:.9g} of a limit is used at most, but the windows use {done.worst:.9g}"
            + (f" ({done.violations[0]})" if done.violations else ""),
        )


def _require_state(
    journal: Journal, state: WindowStart | None, header: Any, arrays: Mapping[str, NDArray[Any]]
) -> None:
    """The state to go on from must be the one behind the last window."""
    if state is None or header is None:
        if state is not None or header is not None or arrays:
            raise journal.refusal(journal.state_path, "it does not end where the program does")
        return
    if not _alike(state.header(), header):
        raise journal.refusal(journal.state_path, "the state to go on from is not the one behind its windows")
    expected = state.arrays()
    if set(expected) != set(arrays):
        raise journal.refusal(journal.state_path, "the path ahead is not that of the program")
    for name, values in expected.items():
        found = arrays[name]
        if found.dtype != values.dtype or found.shape != values.shape:
            raise journal.refusal(journal.state_path, f"{name} is not that of the program")
        if not np.allclose(found, values, rtol=_SAME, atol=_SAME, equal_nan=True):
            raise journal.refusal(journal.state_path, f"{name} is not that of the program")


def _alike(one: Any, other: Any) -> bool:
    """Equal but for the rounding of numbers, and for tuples that became lists on the way."""
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(_alike(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple):
        return isinstance(other, list) and len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, rtol=_SAME, atol=1e3 * _SAME, equal_nan=True))
    return type(one) is type(other) and bool(one == other)

"""A plan replayed by the other step formulas of the literature, beside ``interp.replay``.

All follow du/dt = V / |C'| with the plan's feed V; they differ in where they take it and in how they step:

- "Taylor 1", "Taylor 2", "Taylor 3"                  V, A, J at the time k T: ``replay`` with order 1 to 3
- "Taylor 1 V(u)", "Taylor 2 V(u)", "Taylor 3 V(u)"   V, A, J at the parameter reached, u_k
- "RK2"                                               Runge-Kutta predictor and corrector, V(k T) and V((k + 1) T)
- "chord"                                             a prediction scaled twice to the chord of the mean feed
- "quintic"                                           the plan's own time law: ``replay`` with order 5

With V(t) an error of the parameter stays, and what is missing at the plan's last sample is jumped.  With V(u) the feed
fits the place but the plan's time does not count: the end is reached some periods early or late.  At rest V(u) is 0 for
good, so that the first sample has to be the plan's.

Known limitation: a plan that rests on its way stops a replay with V(u) there, or is passed, as the step happens to fall.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Literal, get_args

import numpy as np

from interp import stepping
from interp.periods import MAX_SAMPLES
from interp.replay import replay
from interp.taylor import InterpolatorTable, TaylorTable, runner, start
from planner.compiled import core
from planner.errors import InputError, StalledError
from planner.geometry.curve import Curve
from planner.inputs import require_instance
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray

FormName = Literal[
    "Taylor 1",
    "Taylor 2",
    "Taylor 3",
    "RK2",
    "chord",
    "Taylor 1 V(u)",
    "Taylor 2 V(u)",
    "Taylor 3 V(u)",
    "quintic",
]
FORMS: tuple[FormName, ...] = get_args(FormName)
# Forms as ``form_run`` counts them.
_TAYLOR_BY_PARAMETER, _RUNGE_KUTTA, _CHORD = 0, 1, 2
# The compiled form and its order (of the chord: corrections); the others are orders of ``replay``.
_COMPILED: dict[FormName, tuple[int, int]] = {
    "RK2": (_RUNGE_KUTTA, 2),
    "chord": (_CHORD, 2),
    "Taylor 1 V(u)": (_TAYLOR_BY_PARAMETER, 1),
    "Taylor 2 V(u)": (_TAYLOR_BY_PARAMETER, 2),
    "Taylor 3 V(u)": (_TAYLOR_BY_PARAMETER, 3),
}
_ORDERS: dict[FormName, int] = {"Taylor 1": 1, "Taylor 2": 2, "Taylor 3": 3, "quintic": 5}
# A replay with V(u) may take this much longer than the plan, and as many periods.
_LATE_SHARE, _LATE_PERIODS = 1.5, 1000


@dataclass(frozen=True, eq=False)
class Replayer:
    """A form on its tables, ready to run.

    Attributes
    ----------
    state : (11 + 2 dim,) array
        At the first sample; a run works on a copy.
    count : int
        Steps to the plan's last sample.
    room : int
        Steps after which the end must have been reached.
    run : callable
        ``run(state, u, positions)`` takes up to ``u.size`` steps and returns how many it took.
    """

    state: FloatArray
    count: int
    room: int
    run: Callable[[FloatArray, FloatArray, FloatArray], int]


def replay_form(curve: Curve, profile: FeedrateProfile, form: FormName, period: float | None = None) -> Samples:
    """Sample a plan once a period by one of the :data:`FORMS`.

    Parameters
    ----------
    curve : Curve
        The curve of the plan.
    profile : FeedrateProfile
    form : str
        See above.
    period : float, optional
        Time T between two samples, s; the period the plan was made for if left out.

    Returns
    -------
    Samples
        The last one is the end of the curve; with V(u) not at the time of the plan's end.

    Raises
    ------
    InputError
        If the form is unknown, or for the reasons of ``replay``.
    StalledError
        If a replay with V(u) does not arrive.
    """
    require_instance(curve, Curve, "curve")
    require_instance(profile, FeedrateProfile, "profile")
    if form not in FORMS:
        raise InputError(f"form = {form!r} must be one of {', '.join(FORMS)}")
    step = float(profile.origin.period if period is None else period)
    if form in _ORDERS:
        return replay(curve, profile, step, order=_ORDERS[form])
    if curve is not profile.curve and curve.fingerprint != profile.curve.fingerprint:
        raise InputError(
            f"the plan was made for {profile.curve.name}, not for {curve.name}; replay it on its own curve"
        )
    replayer = prepare(profile, form, step)
    if replayer.room > MAX_SAMPLES:
        raise InputError(f"period = {step!r} s makes {replayer.count} samples; at most {MAX_SAMPLES} are allowed")
    state = replayer.state.copy()
    dim = curve.dim
    u, position = np.empty(replayer.room + 2), np.empty((replayer.room + 2, dim))
    u[0], position[0] = profile.u[0], curve.derivatives(profile.u[0], 0)[0]
    first = 1
    if state[stepping.SAMPLE] > 0.0:
        u[1], position[1] = state[stepping.U], state[-dim:]
        first = 2
    taken = replayer.run(state, u[first:], position[first:].reshape(-1))
    count = first + taken
    if u[count - 1] < profile.u[-1]:
        raise StalledError(
            f"{curve.name}: {form} has got to u = {float(u[count - 1])!r} of {float(profile.u[-1])!r} after {count - 1} "
            f"periods; the plan takes {replayer.count}: its feed is 0 there; replay it with V(t) or as a quintic"
        )
    ends = profile.feed[[0, -1]]
    t = step * np.arange(count, dtype=np.float64)
    return Samples(step, t, u[:count].copy(), position[:count].copy(), float(ends[0]), float(ends[1]), curve.axes)


def prepare(profile: FeedrateProfile, form: FormName, period: float) -> Replayer:
    """Build the tables of a form and its state at the first sample.

    Raises InputError for an unknown form or a period that is not positive and finite.
    """
    require_instance(profile, FeedrateProfile, "profile")
    if form not in FORMS:
        raise InputError(f"form = {form!r} must be one of {', '.join(FORMS)}")
    if form in _ORDERS:
        order = _ORDERS[form]
        table = InterpolatorTable.from_profile(profile) if order == 5 else TaylorTable.from_profile(profile)
        state = start(table, period)
        count = int(state[stepping.LAST])
        whole = runner(table, order)

        def run_all(state: FloatArray, u: FloatArray, positions: FloatArray) -> int:
            whole(state, u, positions)
            return u.size

        return Replayer(state, count, count, run_all)
    which, order = _COMPILED[form]
    taylor = TaylorTable.from_profile(profile)
    feed, pieces = taylor.arrays
    state = start(taylor, period)
    room = count = int(state[stepping.LAST])
    course = np.empty((0, 7))
    if which == _TAYLOR_BY_PARAMETER:
        course = _course(InterpolatorTable.from_profile(profile))
        room = ceil(_LATE_SHARE * count) + _LATE_PERIODS
        if profile.feed[0] <= 0.0:
            _take_first(profile, period, pieces, state)

    def run(state: FloatArray, u: FloatArray, positions: FloatArray) -> int:
        taken = core.form_run(which, order, feed, course, pieces, profile.duration, state, u.size, u, positions)
        return int(taken)

    return Replayer(state, count, room, run)


def _course(table: InterpolatorTable) -> FloatArray:
    """The plan's segments as quintics of u itself, (n + 1, 7): start time and coefficients, closed by a row at inf."""
    piece = table.segments[:-1, 7].astype(np.intp)
    begin, width = table.pieces[piece, 0, 0], table.pieces[piece, 0, 1]
    course = table.segments[:, :7].copy()
    course[:-1, 1:] *= width[:, None]
    course[:-1, 1] += begin
    return course


def _take_first(profile: FeedrateProfile, period: float, pieces: FloatArray, state: FloatArray) -> None:
    """Go to the plan's first sample after the start, where V(u) is no longer 0."""
    u = float(profile.at(min(period, profile.duration)).u)
    state[stepping.SAMPLE], state[stepping.U] = 1.0, u
    state[stepping.PIECE] = min(int(np.searchsorted(pieces[:, 0, 0], u, side="right")) - 1, len(pieces) - 2)
    state[-profile.curve.dim :] = profile.curve.derivatives(u, 0)[0]

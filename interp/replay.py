"""From a plan to samples: one point of the machine axes a period."""

from __future__ import annotations

from math import ceil, floor, isfinite
from typing import TYPE_CHECKING

import numpy as np

from interp.periods import MAX_SAMPLES, WHOLE_PERIOD
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import require_instance
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray

if TYPE_CHECKING:
    from interp.taylor import InterpolatorTable, PlaceRun, TaylorTable

ORDERS = (1, 2, 3, 5)
_CHUNK = 1 << 16


def replay(
    curve: Curve,
    profile: FeedrateProfile,
    period: float | None = None,
    *,
    order: int = 5,
    start: float = 0.0,
    stop: float | None = None,
) -> Samples:
    """Sample a plan once a period, as the real-time interpolator does.

    Order 5 follows the plan: sample k is C(u(k T)), the quintic time law of the profile evaluated at k T.  Since the
    third difference of a sampled q(t), divided by T^3, is an average of its jerk, the differences of these samples stay
    within what the plan's velocity, acceleration and jerk stay within.  Orders 1 to 3 are the Taylor interpolators of
    the literature (see ``interp.taylor``), kept for comparison: their error accumulates.

    Parameters
    ----------
    curve : Curve
        The curve of the plan.
    profile : FeedrateProfile
    period : float, optional
        Time T between two samples, s; the period the plan was made for if left out.
    order : int
        1, 2, 3 or 5.
    start, stop : float
        Only the multiples of the period within these times, s; the whole plan if left out.

    Returns
    -------
    Samples
        At 0, T, 2T, ... up to ceil(duration / T) T, with u never decreasing; the last sample of the plan is exactly the
        end of the curve.

    Raises
    ------
    InputError
        If the curve is not that of the plan, the period is not positive and finite, the order is not one of those
        above, the times are not within the plan, or there are more samples than 1e8.
    """
    from interp.taylor import InterpolatorTable, TaylorTable, last_sample

    if order not in ORDERS:
        raise InputError(f"order = {order!r} must be 1, 2 or 3 (Taylor) or 5 (the plan's own time law)")
    require_instance(curve, Curve, "curve")
    require_instance(profile, FeedrateProfile, "profile")
    if curve is not profile.curve and curve.fingerprint != profile.curve.fingerprint:
        raise InputError(
            f"the plan was made for {profile.curve.name} ({profile.curve.fingerprint}), not for {curve.name} "
            f"({curve.fingerprint}); replay it on its own curve"
        )
    step = float(profile.origin.period if period is None else period)
    end = last_sample(profile.duration, step)
    first, last = _range(profile.duration, step, start, stop, end)
    table = InterpolatorTable.from_profile(profile) if order == 5 else TaylorTable.from_profile(profile)
    count = last - first + 1
    u, position = np.empty(count), np.empty((count, table.dim))
    _fill(table, order, step, first, u, position)
    t = step * np.arange(first, last + 1, dtype=np.float64)
    ends = profile.at(np.minimum(t[[0, -1]], profile.duration)).feed
    return Samples(step, t, u, position, float(ends[0]), float(ends[1]), curve.axes)


def _range(duration: float, period: float, start: float, stop: float | None, end: int) -> tuple[int, int]:
    """Numbers of the first and the last sample within the times; ``end`` is the last one of the plan."""
    until = duration if stop is None else float(stop)
    if not (isfinite(start) and isfinite(until) and 0.0 <= start <= until <= duration):
        raise InputError(
            f"start = {start!r} s and stop = {until!r} s must lie within the plan: 0 <= start <= stop <= {duration!r}"
        )
    first = ceil(start / period - WHOLE_PERIOD)
    last = end if duration - until <= WHOLE_PERIOD * period else floor(until / period + WHOLE_PERIOD)
    if last < first:
        raise InputError(
            f"no multiple of the period {period!r} s lies between start = {start!r} s and stop = {until!r} s"
        )
    if last - first >= MAX_SAMPLES:
        raise InputError(
            f"period = {period!r} s makes {last - first + 1} samples; at most {MAX_SAMPLES} are allowed at once: use a "
            "coarser period, or a range of times (start, stop)"
        )
    return first, last


def _fill(
    table: InterpolatorTable | TaylorTable, order: int, period: float, first: int, u: FloatArray, position: FloatArray
) -> None:
    """Write sample ``first`` and those after it into ``u`` and ``position``."""
    from interp import stepping
    from interp.taylor import InterpolatorTable, runner, start

    run = runner(table, order)
    exact = isinstance(table, InterpolatorTable)
    state = start(table, period, first=first if exact else 0)
    if not exact:  # the steps before the range count too
        size = min(first, _CHUNK)
        scratch = np.empty(size), np.empty((size, table.dim))
        for begin in range(0, first, _CHUNK):
            count = min(first - begin, _CHUNK)
            _advance(run, state, scratch[0][:count], scratch[1][:count])
    u[0], position[0] = state[stepping.U], state[-table.dim :]
    _advance(run, state, u[1:], position[1:])


def _advance(run: PlaceRun, state: FloatArray, u: FloatArray, position: FloatArray) -> None:
    """Take one step for each row, a chunk of rows to a compiled call."""
    for begin in range(0, u.size, _CHUNK):
        rows = slice(begin, begin + _CHUNK)
        run(state, u[rows], position[rows].reshape(-1))

"""Algorithms 1-4 of the 2022 thesis: greedy interpolators that choose one step after the other.

    1  second-order Taylor step, S-curves at both ends
    2  and the feedrate below its limit: cases A (faster), B (slower), C (as it is)
    3  and the step backed off until the chord error is within its tolerance
    4  and the step pushed up again until the chord error has reached it

W. R. W. Yusoff, "A realtime and parallel look-ahead control and feedrate compensation strategy for CNC reference-pulse
interpolation", Universiti Malaysia Pahang, 2022.

*Mode compat* is the program behind the published numbers of points.  Four defects of it decide these numbers, each of
them an argument of :func:`greedy` that repairs it:

    error_curve         the chord error is computed on the teardrop, whichever curve runs
    step_feed           the command feedrate drives the step; what is planned is only drawn
    taylor              the second term of the step has |C''| in place of C'.C''/|C'|, and no feedrate rate
    second_derivatives  three terms of the butterfly's C'' are wrong, in the step and in the bounds of the acceleration

*Mode physical* is what the text describes: the planned feedrate drives the step, the chord error is the curve's own and
the tolerance stands in limit 3.  Neither mode looks ahead; what that breaks is counted and located in the result.

Known limitation: the S-curves are functions of u and never reach 0 in a finite time, so a feed of ``min_feed`` enters
and leaves the path in mode physical.

In rooms of their own: what was printed (``greedy_published``), the arguments (``greedy_setup``), the compiled loops
(``greedy_compat.c``, ``greedy_physical.c``), the numbers they share with Python (``greedy_layout``), the result
(``greedy_run``).
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from interp.literature import greedy_layout as k
from interp.literature.greedy_run import GreedyRun, finish
from interp.literature.greedy_setup import (
    Braking,
    ErrorCurve,
    Formula,
    GreedyMode,
    GreedySetup,
    StepFeed,
    Variant,
    set_up,
)
from planner.compiled import core
from planner.errors import InputError, StalledError
from planner.geometry.curve import Curve
from planner.machine.limits import Limits, require_limits
from planner.types import FloatArray, Progress

_CHUNK = 1 << 16  # passes between two looks at the number of steps
_SLOW_CHUNK = 2048  # of the published back-off, thousands of trials a pass: some 50 ms
_NEAR_CUSP = 5e-3  # of the largest |C'|: what is slower counts as the cause of a stall


def greedy(
    curve: Curve,
    limits: Limits,
    algorithm: int,
    *,
    mode: GreedyMode = "compat",
    error_curve: ErrorCurve | None = None,
    variant: Variant = "theta",
    step_feed: StepFeed | None = None,
    taylor: Formula | None = None,
    second_derivatives: Formula | None = None,
    braking: Braking = "strict",
    safety: float = 0.18,
    u_rise: float = 0.10,
    u_fall: float = 0.95,
    min_feed: float = 0.5,
    max_steps: int = 1_000_000,
    progress: Progress | None = None,
) -> GreedyRun:
    """Interpolate a curve by one of the four algorithms.

    With v = |C'|, both with respect to u, and V the feedrate that drives the step,

        du = T V/v - (T V)^2/2 C'.C''/v^4             exact
        du = |T F/v - (T F)^2/2 |C''|/v^3|            as published

    and then, until the chord error is within its tolerance, du *= theta with theta = 0.9, 0.8, ... in Algorithm 2
    (mode compat only) and 0.999999, 0.999998, ... from Algorithm 3 on; Algorithm 4 multiplies by 1 + 1e-7, 1 + 2e-7, ...
    while the error is below 0.999 of the tolerance.  ``variant="root"`` solves for the largest step within the tolerance
    instead, in Algorithms 2 to 4, to 1e-6 of it.  In mode physical the factors are 0.999 and 1.001, and a step grows up
    to limits 1, 2 and 4 at most, outside the S-curves.

    The S-curves of the feedrate, over the parameter mapped to [0, 1], are s(3u/u_rise) and 1 - s(3(u-u_fall)/(1-u_fall))
    with s(z) = (1 + exp(-5z))^-8.  (The final thesis prints the falling one without its brackets.)

    Parameters
    ----------
    curve : Curve
        Of linear axes.
    limits : Limits
        The planned feedrate changes by the smaller of the tangential and the axes' jerks.
    algorithm : int
        1 to 4.
    mode : {"compat", "physical"}
    error_curve : {"teardrop", "own"}, optional
        Curve that the chord error is computed on; teardrop in mode compat, own in mode physical.
    variant : {"theta", "root"}
    step_feed : {"command", "planned"}, optional
        What drives the step; command in mode compat, planned in mode physical.  Planned in mode compat is the S-curve
        times the limit, without cases A to C.
    taylor, second_derivatives : {"published", "exact"}, optional
        Published in mode compat, exact in mode physical.  The second derivatives differ on the butterfly alone.
    braking : {"strict", "soft"}
        Case B in mode physical: go to the limit at once, whatever acceleration that takes, or brake within acceleration
        and jerk, however long the feed is above its limit.
    safety : float
        lambda of limit 4, in (0, 1].
    u_rise, u_fall : float
        End of the rising and start of the falling S-curve, of the range of u mapped to [0, 1].
    min_feed : float
        Feedrate below which nothing is planned where the limits allow it, mm/s.
    max_steps : int
        More are refused.
    progress : callable, optional
        Called now and then with a message and the share of the curve that is done.

    Returns
    -------
    GreedyRun

    Raises
    ------
    InputError
        If an argument is not one of those above, or the limits do not fit the curve.
    StalledError
        If the steps stop advancing, or there are more than ``max_steps``: the message names u, the cause and a remedy.
    """
    limits = require_limits(curve, limits)
    if curve.tip is not curve:
        raise InputError(f"{curve.name} moves rotary axes; the algorithms of 2022 know linear axes only")
    job = set_up(
        curve, limits, algorithm, mode, variant,
        {"error_curve": error_curve, "step_feed": step_feed, "taylor": taylor, "second_derivatives": second_derivatives},
        braking, (safety, u_rise, u_fall, min_feed), max_steps,
    )  # fmt: skip
    u, driving = _advance(job, progress)
    return finish(job, u, driving)


def _advance(job: GreedySetup, progress: Progress | None) -> tuple[FloatArray, FloatArray]:
    """Run the loop to the end of the curve: parameters in [0, 1] of all points, and the feed of every step."""
    size = _SLOW_CHUNK if job.variant == "theta" and job.algorithm >= 3 else _CHUNK
    state = np.zeros(k.STATE)
    state[k.PLANNED] = job.setting(k.FLOOR)
    parts, feeds, count, code = [np.zeros(1)], [np.empty(0)], 0, k.RUNNING
    while code == k.RUNNING:
        u, feed = np.empty(min(size, job.max_steps - count)), np.empty(min(size, job.max_steps - count))
        rest = job.limits.velocity, job.limits.acceleration, job.settings, state, u.size, u, feed
        if job.physical:
            code = core.greedy_physical_run(*job.own, *rest)
        else:
            code = core.greedy_compat_run(*job.own, *job.error, *rest)
        done = int(state[k.COUNT])
        parts.append(u[:done])
        feeds.append(feed[:done])
        count += done
        if code not in (k.RUNNING, k.DONE) or (code == k.RUNNING and count >= job.max_steps):
            _stall(job, code, state, count)
        if progress is not None:
            progress(f"Algorithm {job.algorithm}, {job.curve.name}: {count} points", min(float(state[k.U]), 1.0))
    return np.concatenate(parts), np.concatenate(feeds)


def _stall(job: GreedySetup, code: int, state: FloatArray, count: int) -> NoReturn:
    """Raise StalledError with the place, the cause and a remedy."""
    u0, u1 = job.curve.domain
    u, du, speed = (float(state[i]) for i in (k.U, k.DU, k.SPEED))
    span = u1 - u0
    way = job.limits.feed * job.limits.period
    smaller = "scale the curve up, or lower feed or period"
    if code == k.RUNNING:
        cause = f"max_steps = {job.max_steps} points are not enough; raise max_steps, or use a longer period"
    elif code == k.SINGULAR or not speed > _NEAR_CUSP * job.top_speed:
        cause = (
            f"|C'| = {speed / span:.3g} against {job.top_speed / span:.3g} elsewhere: a cusp, where a step of the "
            "parameter has no length; split the curve there, or give it a parametrisation with |C'| > 0"
        )
    elif code == k.BACK_OFF:
        cause = (
            f"back-off exhausted at theta = {state[k.THETA]:.3g}: the curve is too small for a step F T = {way:.3g} mm "
            f'within a chord error of {job.limits.chord_error:.3g} mm; {smaller}, or use variant="root"'
        )
    elif code == k.TOO_LONG:
        why = f"the curve is too small for a step F T = {way:.3g} mm; {smaller}"
        if job.algorithm == 4:
            why += ', or, where the curve is straight and nothing stops the push-up, use mode="physical"'
        cause = f"a step of {du:.3g} exceeds 0.1 of the range; {why}"
    elif code == k.NO_ADVANCE:
        cause = (
            f"steps of {du:.3g} of the range no longer advance: the second term of the Taylor step cancels the first, as "
            f"the curve is too small for a step F T = {way:.3g} mm; {smaller}"
        )
    else:
        cause = f"the Taylor step is {du:.3g}: its second term outweighs the first; {smaller}"
    raise StalledError(
        f"Algorithm {job.algorithm} stopped on {job.curve.name} at u = {u0 + span * min(u, 1.0):.9g}, step {count}: {cause}"
    )

"""What every method of the comparison makes of a curve: a motion, sampled once a period."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from feedplan.job import Job
from planner.errors import InputError, StalledError
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.geometry.differential import arc_derivatives
from planner.machine.feed_limits import feedrate_limits
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.quantity import ACCELERATION, JERK, Quantity
from planner.samples import Samples
from planner.types import FloatArray

if TYPE_CHECKING:
    from interp.literature.feedshapes import ShapeName
    from interp.literature.greedy_setup import Braking
    from interp.literature.lookahead import Rule
    from planner.plan import Method

OPTIMUM = "optimal"
REFERENCE = "nlp"  # the same problem by another solver
_SCAN_POINTS = 20_001
_STEADY_SHARE = 0.5  # of acceleration and jerk, in the ramps to a constant feed
_STALLED_SHARE = 0.01  # of the path that a feed shape may leave to its last sample: errors of the steps add up to less
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class MethodRun:
    """What a method makes of a curve.

    Attributes
    ----------
    samples : Samples
        One point a period.
    commanded : (m - 1,) array
        Feed the method means each period to have, mm/s.
    duration : float
        s.
    profile : FeedrateProfile or None
        The plan behind the samples, if there is one.
    setting : str
        What had to be chosen.
    """

    samples: Samples
    commanded: FloatArray
    duration: float
    profile: FeedrateProfile | None = None
    setting: str = ""


def _run_greedy(curve: Curve, limits: Limits, *, algorithm: int, braking: Braking = "strict") -> MethodRun:
    from interp import greedy

    run = greedy(curve, limits, algorithm, mode="physical", variant="root", braking=braking)
    setting = f"mode physical, {braking}, enters and leaves at {run.samples.start_feed:g} mm/s"
    return MethodRun(run.samples, run.feed[:-1], run.duration, setting=setting)


def _run_shape(curve: Curve, limits: Limits, *, kind: ShapeName, order: int, steady: bool = False) -> MethodRun:
    from interp import FeedShape, interpolate_shape

    share = _STEADY_SHARE if steady else 1.0
    acceleration = share * _weakest(curve, limits, ACCELERATION)
    jerk = share * _weakest(curve, limits, JERK) if kind == "bell" else inf
    feed = _steady_feed(curve, limits) if steady else limits.feed
    if not (np.isfinite(acceleration) and np.isfinite(feed)):
        raise InputError(
            f"feed = {feed:g} mm/s and acceleration = {acceleration:g} mm/s^2 must be finite: the ramps of 2002 follow "
            "from them"
        )

    def ramp(feed: float) -> float:
        if kind == "trapezoid":
            return feed / acceleration
        return float(max(0.5 * np.pi * feed / acceleration, np.pi * np.sqrt(0.5 * feed / jerk)))

    while feed * ramp(feed) > curve.length:  # the product grows with F^1.5 at least
        feed *= min(1.0 - _ROUNDING, (curve.length / (feed * ramp(feed))) ** 0.5)
    run = interpolate_shape(curve, FeedShape(kind, curve.length, feed, ramp(feed)), limits.period, order=order)
    left = curve.length - float(curve.tip.arclength.s(np.array([run.reached]))[0])
    if left > _STALLED_SHARE * curve.length:
        raise StalledError(
            f"steps of order {order} at {feed:.6g} mm/s come to u = {run.reached:.6g} only, {left:.4g} mm before the end: "
            "the second term of the Taylor step cancels the first; lower feed or period"
        )
    # A first-order step follows the feed at its start, one of second order the mean of the period.
    commanded = run.feed[:-1] if order == 1 else 0.5 * (run.feed[:-1] + run.feed[1:])
    setting = f"feed {feed:.6g} mm/s, ramps of {ramp(feed):.6g} s"
    return MethodRun(run.samples, commanded, float(run.samples.t[-1]), setting=setting)


def _run_adaptive(curve: Curve, limits: Limits, *, rule: Rule, order: int) -> MethodRun:
    from interp import AdaptiveLimits, interpolate_adaptive

    acceleration = _weakest(curve, limits, ACCELERATION) / np.sqrt(2.0)
    own = AdaptiveLimits(limits.feed, acceleration, acceleration, limits.chord_error, limits.period)
    run = interpolate_adaptive(curve, own, rule=rule, order=order)
    setting = f"rule {rule}, order {order}, {acceleration:.6g} mm/s^2 along and across the path"
    return MethodRun(run.samples, run.feed[:-1], run.duration, setting=setting)


def _run_plan(curve: Curve, limits: Limits, *, method: Method) -> MethodRun:
    job = Job(curve, limits)
    return planned_motion(job, job.plan(method=method))


def planned_motion(job: Job, profile: FeedrateProfile) -> MethodRun:
    """Sample a plan with the period of the limits."""
    samples = job.replay(profile)
    s = profile.at(np.minimum(samples.t, profile.duration)).s
    return MethodRun(samples, np.diff(s) / samples.period, profile.duration, profile)


METHODS: Mapping[str, Callable[[Curve, Limits], MethodRun]] = {
    "algorithm-1": partial(_run_greedy, algorithm=1),
    "algorithm-2": partial(_run_greedy, algorithm=2),
    "algorithm-2-soft": partial(_run_greedy, algorithm=2, braking="soft"),
    "algorithm-3": partial(_run_greedy, algorithm=3),
    "algorithm-3-soft": partial(_run_greedy, algorithm=3, braking="soft"),
    "algorithm-4": partial(_run_greedy, algorithm=4),
    "algorithm-4-soft": partial(_run_greedy, algorithm=4, braking="soft"),
    "2002-trapezoid-1": partial(_run_shape, kind="trapezoid", order=1),
    "2002-trapezoid-2": partial(_run_shape, kind="trapezoid", order=2),
    "2002-bell-1": partial(_run_shape, kind="bell", order=1),
    "2002-bell-2": partial(_run_shape, kind="bell", order=2),
    "2002-bell-steady": partial(_run_shape, kind="bell", order=2, steady=True),
    "2007-printed": partial(_run_adaptive, rule="averaged", order=1),
    "2007-uniform": partial(_run_adaptive, rule="uniform", order=2),
    "toppra": partial(_run_plan, method="toppra"),
    "scurve": partial(_run_plan, method="scurve"),
    REFERENCE: partial(_run_plan, method="nlp"),
    OPTIMUM: partial(_run_plan, method="optimal"),
}
"""Every method by name: Algorithms 1-4 (2022), feed shapes (2002), look-ahead (2007), and the planner's own."""


def _weakest(curve: Curve, limits: Limits, quantity: Quantity) -> float:
    """Smallest limit of the linear axes and of the path, mm/s^2 or mm/s^3."""
    *axes, path = limits.of_motions(quantity.order)
    return float(min(path, *(most for axis, most in zip(curve.axes, axes, strict=True) if axis not in ROTARY_AXES)))


def _steady_feed(curve: Curve, limits: Limits) -> float:
    """Highest constant feed within the four feed limits and, by F^3 |d^3q/ds^3|, the jerk of every axis; mm/s."""
    if curve.tip is not curve:
        raise InputError(f"{curve.name} moves rotary axes; a constant feed is derived for linear axes only")
    u = np.linspace(*curve.domain, _SCAN_POINTS)
    change = np.abs(arc_derivatives(curve.derivatives(u, 3))[3])
    with np.errstate(divide="ignore"):
        by_jerk = np.cbrt((limits.jerk / change).min(axis=-1))
    return float(min(feedrate_limits(curve, limits, u).lowest.min(), by_jerk.min()))


def select_methods(text: str) -> list[str]:
    """Return the methods that a list like "algorithm,2002-bell,optimal" names, in the order of :data:`METHODS`.

    A word is a name, or the beginning of names up to a hyphen.

    Raises
    ------
    InputError
        If a word names nothing.
    """
    chosen: set[str] = set()
    for word in (part.strip() for part in text.split(",")):
        found = [word] if word in METHODS else [name for name in METHODS if name.startswith(f"{word}-")]
        if not word or not found:
            raise InputError(
                f'method "{word}" must be one of {", ".join(METHODS)}, or the beginning of some: 2002-bell'
            )
        chosen.update(found)
    return [name for name in METHODS if name in chosen]

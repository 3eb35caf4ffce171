"""The interpolators of the literature and the planner's methods on the same curve, under the same limits.

    from feedplan.comparison import compare_methods, saving
    results = compare_methods(curve, limits)
    print(saving(results))

Every method is turned into the samples a drive would get, one a period, and these are judged by ``planner.verify``, which
shares no formula with any of them; a plan is judged between its samples as well.  Rules of the comparison:

1. *From rest to rest.*  The drives hold the first and the last sample.  Algorithms 1-4 enter and leave a path with a feed
   of their own, which is a step for a machine at rest; what they break without that step is told beside it.
2. *Machining time* is the time of the last sample, or the duration of a plan: the feed that drives the axes decides, not
   one that is only drawn.
3. *Dilation.*  The same points sent every kappa T have 1/kappa of the velocities, 1/kappa^2 of the accelerations and
   1/kappa^3 of the jerks, so that from the measured ratios r follows the least factor that breaks nothing,

       kappa = max(1, r_feed, r_velocity, sqrt(r_acceleration), cbrt(r_jerk), sqrt(r_chord error)).

   The check of the slowed motion confirms it.  A plan is slowed between its points, too; a step of its acceleration on
   a smooth path, which is no finite jerk however slow, counts there as the jerk a drive sees of it.  The chord error of
   the same points does not change: where it is too large, the slowed motion is sampled with the machine's own T, u(t)
   between the points by a monotone cubic, and the chord error of that must hold.
4. *The saving* of the optimum is counted against the fastest method that breaks nothing as it is, and against the fastest
   once each has been slowed by its kappa.  ``nlp`` solves the problem of ``optimal`` and is no rival.

Where a method's parameters must be chosen: Algorithms 1-4 as in :func:`interp.greedy`, mode physical.  2002: ramps that
use the weakest linear axis' acceleration (bell: and its jerk); a feed that the path is too short for is lowered; "steady"
runs at the highest constant feed that every limit allows everywhere, with ramps at half the acceleration and jerk.  2007:
both its accelerations are the weakest axis' over sqrt(2), so that their resultant keeps it.

Known limitation: kappa flatters a motion whose acceleration jumps.  Sampled with the same T instead of kappa T, a jump
leaves a jerk that falls with kappa^2 only.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import FeedrateError, InputError, StalledError
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.geometry.differential import arc_derivatives
from planner.machine.limits import Limits, feedrate_limits, require_limits
from planner.profile import FeedrateProfile, Samples
from planner.quantity import ACCELERATION, JERK, QUANTITIES, Quantity
from planner.types import FloatArray, Progress
from planner.verify import Row, check

if TYPE_CHECKING:
    from interp.literature.feedshapes import ShapeName
    from interp.literature.greedy import Braking
    from interp.literature.lookahead import Rule
    from planner.plan import Method


OPTIMUM = "optimal"
REFERENCE = "nlp"  # the same problem by another solver
NOTE = (
    "toppra, the trapezoid of 2002 and 2007 know no jerk limit: where the machine has one they are no fair rivals, and "
    "their times say what it costs"
)
# The limits of a machine, and the power of kappa by which a dilation lowers what is used of each.
_POWERS = {q.label: q.power for q in QUANTITIES}
LETTERS = {q.label: q.letter for q in QUANTITIES}
"""What stands for a broken limit in a table; anything else that fails is a question mark."""
_STEP = "step on a smooth path"  # of the acceleration: breaks the jerk limit, and no slowing cures it
# Rows that measure one of them in another way.
_SAME_LIMIT = dict.fromkeys(("jerk at a curvature break", "acceleration step", _STEP), JERK.label)
_SLOWEST_FEED = 1.0  # mm/s; below it a relative deviation says nothing
_SCAN_POINTS = 20_001
_STEADY_SHARE = 0.5  # of acceleration and jerk, in the ramps to a constant feed
_STALLED_SHARE = 0.01  # of the path that a feed shape may leave to its last sample: errors of the steps add up to less
_ROUNDING = 1e-9
_DILATIONS = 8
_MOST_POINTS = 3_000_000  # of a slowed motion whose chords are measured
# Loaded beforehand, so that no method is charged for it.
_LOADED = (
    "interp.taylor_kernels",
    "interp.literature.classic_kernels",
    "interp.literature.greedy_kernels",
    "planner.plan.utilisation_kernels",
    "planner.plan",
    "planner.plan.solvers.interior_kernels",
)
_LIBRARIES = {"toppra": "toppra", "scurve": "ruckig", REFERENCE: "casadi"}


@dataclass(frozen=True, eq=False)
class Motion:
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


@dataclass(frozen=True)
class Dilation:
    """How much slower a motion must run to break nothing.

    Attributes
    ----------
    factor : float
        kappa; 1 where nothing is broken.
    duration : float
        Time of the slowed motion, s.
    confirmed : bool
        The check found nothing broken in the slowed motion.
    """

    factor: float
    duration: float
    confirmed: bool


@dataclass(frozen=True)
class Judgement:
    """What the check says of a motion.

    Attributes
    ----------
    ratios : mapping
        Worst value over limit by limit name, over axes, and over a plan and its samples; 0 where there is no limit.
    broken : tuple of Row
        The worst row of every limit that does not hold; a jump of the acceleration counts as the jerk it makes.
    dilation : Dilation
    """

    ratios: Mapping[str, float]
    broken: tuple[Row, ...]
    dilation: Dilation


@dataclass(frozen=True, eq=False)
class Result:
    """One method's row.

    Attributes
    ----------
    method : str
    reason : str
        Why the method could not run; empty where it ran.
    duration : float
        Machining time, s.
    points : int
        Samples sent to the drives.
    chord_error : float
        Largest distance of the path from a chord of one period, mm.
    fluctuation : float
        Largest relative deviation of the length covered in a period from what the method meant it to be.
    computing_time : float
        Processor time without loading and compiling, s.
    judgement : Judgement or None
        From rest to rest; None where the method could not run.
    entered_at_speed : Judgement or None
        The same where the path is entered and left at the method's own feed, if that is not 0.
    motion : Motion or None
    """

    method: str
    reason: str = ""
    duration: float = nan
    points: int = 0
    chord_error: float = nan
    fluctuation: float = nan
    computing_time: float = nan
    judgement: Judgement | None = None
    entered_at_speed: Judgement | None = None
    motion: Motion | None = None

    @property
    def ok(self) -> bool:
        """The method ran and breaks nothing."""
        return self.judgement is not None and not self.judgement.broken


@dataclass(frozen=True)
class Saving:
    """What the optimum saves.

    Attributes
    ----------
    optimum : float
        Duration of the optimal plan, s.
    rival : str
        Fastest method that breaks nothing as it is; empty where there is none.
    rival_duration, share : float
        Its time, s, and what the optimum saves of it.
    slowed_rival : str
        Fastest method once each has been slowed until it breaks nothing.
    slowed_duration, slowed_share : float
        Its time then, s, and what the optimum saves of it.
    """

    optimum: float
    rival: str = ""
    rival_duration: float = nan
    share: float = nan
    slowed_rival: str = ""
    slowed_duration: float = nan
    slowed_share: float = nan


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


def compare_methods(
    curve: Curve, limits: Limits, methods: Sequence[str] | None = None, *, progress: Progress | None = None
) -> list[Result]:
    """Run methods on a curve and judge all of them alike.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    methods : sequence of str, optional
        Of :data:`METHODS`; all of them if left out.
    progress : callable, optional
        Called with a message and the share of the methods done.

    Returns
    -------
    list of Result
        One for each method, in that order.  A method that cannot run on this curve has a reason in place of numbers.

    Raises
    ------
    InputError
        If there is no such method, or limits and curve do not belong together.
    """
    chosen = list(METHODS) if methods is None else list(methods)
    for name in chosen:
        if name not in METHODS:
            raise InputError(f"method {name!r} must be one of {', '.join(METHODS)}")
    limits = require_limits(curve, limits)
    for module in (*_LOADED, *(_LIBRARIES[name] for name in chosen if name in _LIBRARIES)):
        import_module(module)
    for part in {curve, curve.tip}:
        _ = part.pieces, part.length, part.arclength
    results = []
    for k, name in enumerate(chosen):
        if progress is not None:
            progress(name, k / len(chosen))
        results.append(run_method(name, curve, limits))
    return results


def run_method(name: str, curve: Curve, limits: Limits) -> Result:
    """Run one method of :data:`METHODS` and judge it."""
    began = time.process_time()
    try:
        motion = METHODS[name](curve, limits)
    except FeedrateError as error:
        return Result(name, reason=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - began
    samples, entered = motion.samples, None
    if motion.profile is None and (samples.start_feed or samples.end_feed):
        _, entered = judge(curve, limits, motion)
        motion = replace(motion, samples=replace(samples, start_feed=0.0, end_feed=0.0))
    rows, judgement = judge(curve, limits, motion)
    return Result(
        method=name,
        duration=motion.duration,
        points=samples.t.size,
        chord_error=max(row.worst for row in rows if row.limit == "chord error"),
        fluctuation=fluctuation(curve, motion),
        computing_time=seconds,
        judgement=judgement,
        entered_at_speed=entered,
        motion=motion,
    )


def judge(curve: Curve, limits: Limits, motion: Motion) -> tuple[tuple[Row, ...], Judgement]:
    """Check the samples of a motion, and the plan behind them if there is one, and slow it until nothing is broken."""
    rows = _rows(curve, limits, motion)
    ratios = worst_ratios(rows)
    worst: dict[str, Row] = {}
    for row in rows:
        name = _SAME_LIMIT.get(row.limit, row.limit)
        if not row.ok and (name not in worst or row.ratio > worst[name].ratio):
            worst[name] = replace(row, limit=name)
    found = dilation(curve, limits, motion, ratios) if worst else Dilation(1.0, motion.duration, True)
    return rows, Judgement(ratios, tuple(worst.values()), found)


def worst_ratios(rows: Sequence[Row]) -> dict[str, float]:
    """Worst ratio of every limit of the machine, over the axes and over the rows that measure it.

    A step of the acceleration is counted by what a drive sees of it, the row "acceleration step".
    """
    worst = dict.fromkeys(_POWERS, 0.0)
    for row in rows:
        name = _SAME_LIMIT.get(row.limit, row.limit)
        if name in worst and row.limit != _STEP:
            worst[name] = max(worst[name], row.ratio)
    return worst


def least_dilation(ratios: Mapping[str, float]) -> float:
    """Smallest factor of time with which none of the measured ratios exceeds 1."""
    return float(max(1.0, *(ratio ** (1.0 / _POWERS[name]) for name, ratio in ratios.items())))


def dilation(curve: Curve, limits: Limits, motion: Motion, ratios: Mapping[str, float]) -> Dilation:
    """Slow a motion down until it breaks nothing: by the measured ratios, confirmed by the check (rule 3 above).

    Where the check still finds a limit broken (the chord error of long chords does not quite fall with kappa^2), the
    factor grows by what it measures.
    """
    factor = least_dilation(ratios)
    for _ in range(_DILATIONS):
        if not factor * motion.duration / limits.period < _MOST_POINTS:
            break
        rows = _slowed_rows(curve, limits, motion, factor)
        if all(row.ok for row in rows if row.limit != _STEP):
            return Dilation(factor, factor * motion.duration, True)
        growth = least_dilation(worst_ratios(rows))
        if growth == 1.0:  # what fails does not depend on time
            break
        factor *= growth * (1.0 + _ROUNDING)
    return Dilation(factor, factor * motion.duration, False)


def fluctuation(curve: Curve, motion: Motion) -> float:
    """Largest |length covered / (commanded feed x period) - 1| of the periods with a command of 1 mm/s at least.

    The last period, which the end of the curve cuts short, is left out.  nan where no period is that fast.
    """
    samples = motion.samples
    covered = np.diff(curve.tip.arclength.s(samples.u))[:-1]
    meant = motion.commanded[: covered.size] * samples.period
    counted = meant > _SLOWEST_FEED * samples.period
    return float(np.abs(covered[counted] / meant[counted] - 1.0).max()) if counted.any() else nan


def saving(results: Sequence[Result]) -> Saving | None:
    """What the optimal plan saves against its rivals; None where it is not among the results or breaks a limit."""
    optimum = next((r.duration for r in results if r.method == OPTIMUM and r.ok), None)
    if optimum is None:
        return None
    rivals = [(r, r.judgement.dilation) for r in results if r.judgement and r.method not in (OPTIMUM, REFERENCE)]
    found = Saving(optimum)
    if holding := [r for r, _ in rivals if r.ok]:
        best = min(holding, key=lambda r: r.duration)
        share = 1.0 - optimum / best.duration
        found = replace(found, rival=best.method, rival_duration=best.duration, share=share)
    if slowed := [(slow.duration, r.method) for r, slow in rivals if slow.confirmed]:
        duration, name = min(slowed)
        share = 1.0 - optimum / duration
        found = replace(found, slowed_rival=name, slowed_duration=duration, slowed_share=share)
    return found


def letters(judgement: Judgement) -> str:
    """Return the letters of what is broken, "nothing" if nothing is."""
    names = {row.limit for row in judgement.broken}
    known = "".join(letter for name, letter in LETTERS.items() if name in names)
    return known + "?" * bool(names - set(LETTERS)) or "nothing"


# ---- facts ---------------------------------------------------------------------------------------------------------


def result_facts(result: Result) -> dict[str, Any]:
    """One row as plain values, for JSON and CSV; numbers may be inf or nan."""
    judgement, entered = result.judgement, result.entered_at_speed
    facts: dict[str, Any] = {
        "method": result.method,
        "machining_time_s": result.duration,
        "verdict": "not run" if judgement is None else ("holds" if result.ok else "breaks"),
        "breaks": [] if judgement is None else [row.limit for row in judgement.broken],
        "points": result.points,
        "chord_error_mm": result.chord_error,
    }
    for name in _POWERS:
        facts[f"{name.replace(' ', '_')}_ratio"] = nan if judgement is None else judgement.ratios[name]
    facts |= {"feed_fluctuation": result.fluctuation, "computing_time_s": result.computing_time}
    facts |= _dilation_facts(judgement, "")
    facts["breaks_entered_at_speed"] = [] if entered is None else [row.limit for row in entered.broken]
    facts |= _dilation_facts(entered, "_entered_at_speed")
    facts |= {"setting": "" if result.motion is None else result.motion.setting, "reason": result.reason}
    return facts


def finite(value: Any) -> Any:
    """Replace numbers that are not finite, which JSON does not know, by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _dilation_facts(judgement: Judgement | None, suffix: str) -> dict[str, Any]:
    found = Dilation(nan, nan, False) if judgement is None else judgement.dilation
    return {
        f"dilation{suffix}": found.factor,
        f"dilated_time{suffix}_s": found.duration,
        f"dilation_confirmed{suffix}": None if judgement is None else found.confirmed,
    }


def saving_facts(found: Saving | None) -> dict[str, Any] | None:
    """The saving as plain values; numbers may be nan."""
    if found is None:
        return None
    return {
        "optimum_s": found.optimum,
        "fastest_that_breaks_nothing": found.rival or None,
        "its_time_s": found.rival_duration,
        "saving": found.share,
        "fastest_once_slowed": found.slowed_rival or None,
        "slowed_time_s": found.slowed_duration,
        "saving_against_slowed": found.slowed_share,
    }


# ---- methods -------------------------------------------------------------------------------------------------------


def _run_greedy(curve: Curve, limits: Limits, *, algorithm: int, braking: Braking = "strict") -> Motion:
    from interp import greedy

    run = greedy(curve, limits, algorithm, mode="physical", variant="root", braking=braking)
    setting = f"mode physical, {braking}, enters and leaves at {run.samples.start_feed:g} mm/s"
    return Motion(run.samples, run.feed[:-1], run.duration, setting=setting)


def _run_shape(curve: Curve, limits: Limits, *, kind: ShapeName, order: int, steady: bool = False) -> Motion:
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
    return Motion(run.samples, commanded, float(run.samples.t[-1]), setting=setting)


def _run_adaptive(curve: Curve, limits: Limits, *, rule: Rule, order: int) -> Motion:
    from interp import AdaptiveLimits, interpolate_adaptive

    acceleration = _weakest(curve, limits, ACCELERATION) / np.sqrt(2.0)
    own = AdaptiveLimits(limits.feed, acceleration, acceleration, limits.chord_error, limits.period)
    run = interpolate_adaptive(curve, own, rule=rule, order=order)
    setting = f"rule {rule}, order {order}, {acceleration:.6g} mm/s^2 along and across the path"
    return Motion(run.samples, run.feed[:-1], run.duration, setting=setting)


def _run_plan(curve: Curve, limits: Limits, *, method: Method) -> Motion:
    from planner.plan import plan_feedrate

    return _planned(plan_feedrate(curve, limits, method=method), limits.period)


def _planned(profile: FeedrateProfile, period: float) -> Motion:
    from interp import replay

    samples = replay(profile.curve, profile, period)
    s = profile.at(np.minimum(samples.t, profile.duration)).s
    return Motion(samples, np.diff(s) / period, profile.duration, profile)


METHODS: Mapping[str, Callable[[Curve, Limits], Motion]] = {
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


# ---- judging -------------------------------------------------------------------------------------------------------


def _rows(curve: Curve, limits: Limits, motion: Motion) -> tuple[Row, ...]:
    rows = check(curve, limits, motion.samples).rows
    return rows if motion.profile is None else (*rows, *check(curve, limits, motion.profile).rows)


def _slowed_rows(curve: Curve, limits: Limits, motion: Motion, factor: float) -> tuple[Row, ...]:
    """Rows of the check of a slowed motion, its chord error with the machine's period where it needs that."""
    period = factor * limits.period
    if motion.profile is None:
        samples = motion.samples
        t = period * np.arange(samples.t.size, dtype=np.float64)
        slowed = Motion(replace(samples, period=period, t=t), motion.commanded, factor * motion.duration)
    else:
        slowed = _planned(_slowed_plan(motion.profile, factor), period)
    rows = _rows(curve, limits.with_period(period), slowed)
    if all(row.ok for row in rows if row.limit == "chord error"):
        return rows
    rates = tuple(row for row in rows if row.limit != "chord error")
    return (*rates, _slowed_chord(curve, limits, motion.samples, factor))


def _slowed_chord(curve: Curve, limits: Limits, samples: Samples, factor: float) -> Row:
    """Chord error of a slowed motion that is sampled with the machine's period."""
    from scipy.interpolate import PchipInterpolator

    count = int(np.ceil(samples.t[-1] * factor / limits.period)) + 1
    t = limits.period * np.arange(count, dtype=np.float64)
    u = np.clip(PchipInterpolator(samples.t, samples.u)(np.minimum(t / factor, samples.t[-1])), *curve.domain)
    u[[0, -1]] = samples.u[[0, -1]]
    return check(curve, limits, Samples(limits.period, t, u, curve.derivatives(u, 0)[0])).row("chord error")


def _slowed_plan(profile: FeedrateProfile, factor: float) -> FeedrateProfile:
    """The plan run slower by a factor; what holds it back is what did before."""
    before = profile.slowed or ((0, 1.0),)
    return replace(
        profile,
        slowed=tuple((node, factor * value) for node, value in before),
        t=profile.t * factor,
        u_rate=profile.u_rate / factor,
        u_acceleration=profile.u_acceleration / factor**2,
        feed=profile.feed / factor,
        acceleration=profile.acceleration / factor**2,
        jerk=profile.jerk / factor**3,
    )

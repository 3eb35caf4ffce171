"""What the check says of a motion, and how much slower it must run to break nothing (rules 1 to 3 of the comparison)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from feedplan.comparison.methods import MethodRun, planned_motion
from feedplan.job import Job
from interp.literature.feedshapes import SLOWEST_FEED
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.quantity import JERK, QUANTITIES
from planner.samples import Samples
from planner.verify import Row

LETTERS = {quantity.label: quantity.letter for quantity in QUANTITIES}
"""What stands for a broken limit in a table; anything else that fails is a question mark."""
_POWERS = {quantity.label: quantity.power for quantity in QUANTITIES}
_STEP = "step on a smooth path"  # of the acceleration: breaks the jerk limit, and no slowing cures it
# Rows that measure one of them in another way.
_SAME_LIMIT = dict.fromkeys(("jerk at a curvature break", "acceleration step", _STEP), JERK.label)
_ROUNDING = 1e-9
_DILATIONS = 8
_MAX_POINTS = 3_000_000  # of a slowed motion whose chords are measured


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


def judge(curve: Curve, limits: Limits, motion: MethodRun) -> tuple[tuple[Row, ...], Judgement]:
    """Check the samples of a motion, and the plan behind them if there is one, and slow it until nothing is broken."""
    rows = _rows(Job(curve, limits), motion)
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


def dilation(curve: Curve, limits: Limits, motion: MethodRun, ratios: Mapping[str, float]) -> Dilation:
    """Slow a motion down until it breaks nothing: by the measured ratios, confirmed by the check (rule 3 above).

    Where the check still finds a limit broken (the chord error of long chords does not quite fall with kappa^2), the
    factor grows by what it measures.
    """
    factor = least_dilation(ratios)
    for _ in range(_DILATIONS):
        if not factor * motion.duration / limits.period < _MAX_POINTS:
            break
        rows = _slowed_rows(curve, limits, motion, factor)
        if all(row.ok for row in rows if row.limit != _STEP):
            return Dilation(factor, factor * motion.duration, True)
        growth = least_dilation(worst_ratios(rows))
        if growth == 1.0:  # what fails does not depend on time
            break
        factor *= growth * (1.0 + _ROUNDING)
    return Dilation(factor, factor * motion.duration, False)


def fluctuation(curve: Curve, motion: MethodRun) -> float:
    """Largest |length covered / (commanded feed x period) - 1| of the periods with a command of 1 mm/s at least.

    The last period, which the end of the curve cuts short, is left out.  nan where no period is that fast.
    """
    samples = motion.samples
    covered = np.diff(curve.tip.arclength.s(samples.u))[:-1]
    meant = motion.commanded[: covered.size] * samples.period
    counted = meant > SLOWEST_FEED * samples.period
    return float(np.abs(covered[counted] / meant[counted] - 1.0).max()) if counted.any() else nan


def letters(judgement: Judgement) -> str:
    """Return the letters of what is broken, "nothing" if nothing is."""
    names = {row.limit for row in judgement.broken}
    known = "".join(letter for name, letter in LETTERS.items() if name in names)
    return known + "?" * bool(names - set(LETTERS)) or "nothing"


def _rows(job: Job, motion: MethodRun) -> tuple[Row, ...]:
    rows = job.check(motion.samples).rows
    return rows if motion.profile is None else (*rows, *job.check(motion.profile).rows)


def _slowed_rows(curve: Curve, limits: Limits, motion: MethodRun, factor: float) -> tuple[Row, ...]:
    """Rows of the check of a slowed motion, its chord error with the machine's period where it needs that."""
    period = factor * limits.period
    job = Job(curve, limits.with_period(period))
    if motion.profile is None:
        samples = motion.samples
        t = period * np.arange(samples.t.size, dtype=np.float64)
        slowed = MethodRun(replace(samples, period=period, t=t), motion.commanded, factor * motion.duration)
    else:
        slowed = planned_motion(job, slowed_plan(motion.profile, factor))
    rows = _rows(job, slowed)
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
    samples = Samples(limits.period, t, u, curve.derivatives(u, 0)[0])
    return Job(curve, limits).check(samples).row("chord error")


def slowed_plan(profile: FeedrateProfile, factor: float) -> FeedrateProfile:
    """The plan run slower by a factor; what holds it back is what did before."""
    before = profile.slowed or ((0, 1.0),)
    return replace(
        profile,
        slowed=tuple((node, factor * value) for node, value in before),
        law=profile.law.dilated(factor),
        feed=profile.feed / factor,
        acceleration=profile.acceleration / factor**2,
        jerk=profile.jerk / factor**3,
    )

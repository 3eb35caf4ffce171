"""From a curve and its limits to what a solver sees, for the tests of plans."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import Phase
from hypothesis import strategies as st
from strategies import random_nurbs

from planner.geometry.curve import Curve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.plan.ends import FREE, end_with
from planner.plan.guess import FeedGuess, breaks_inside, guess_feed
from planner.plan.knots import Grid, place_knots, with_blends
from planner.plan.rows import Constraints, build
from planner.plan.section import Section, cut
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap

SEEDS = st.integers(0, 2000)  # of random_case
NO_SHRINKING = (Phase.explicit, Phase.generate)  # a smaller seed is not a simpler path


def laid_out(
    curve: Curve,
    limits: Limits,
    intervals: int = 1000,
    *,
    start: float = 0.0,
    end: float = 0.0,
    periodic: bool = False,
    parts: int = 4,
) -> tuple[Section, FeedGuess, TimeGrid]:
    """Section, guess of the feed and grid in its time, of a path without corners, from feed start to feed end."""
    ends = (FREE, FREE) if periodic else (end_with(start), end_with(end))
    (section,) = cut(curve, limits, *ends, exact_stop=False)
    guess = guess_feed(section, limits, intervals)
    on = TimeMap.from_guess(section, limits, guess, breaks_inside(section), intervals // parts)
    return section, guess, TimeGrid.even(on, parts)


def knotted(
    curve: Curve, limits: Limits, intervals: int = 1000, *, start: float = 0.0, end: float = 0.0, periodic: bool = False
) -> tuple[Section, FeedGuess, Grid]:
    """Section with its rest blends, guess of the feed and grid over the rest map, as bounds have them."""
    ends = (FREE, FREE) if periodic else (end_with(start), end_with(end))
    (section,) = cut(curve, limits, *ends, exact_stop=False)
    guess = guess_feed(section, limits, intervals)
    section = with_blends(section, guess)
    return section, guess, place_knots(section, guess, intervals)


def problem_of(
    curve: Curve,
    limits: Limits,
    intervals: int = 100,
    *,
    start: float = 0.0,
    end: float = 0.0,
    periodic: bool = False,
    inner: int = 1,
) -> Constraints:
    """The arrays that a solver sees."""
    _, _, grid = laid_out(curve, limits, intervals, start=start, end=end, periodic=periodic, parts=12)
    return build(limits, grid, periodic=periodic, inner=inner)[0]


def random_case(seed: int) -> tuple[NurbsCurve, Limits]:
    """A random curve in two or three axes, and limits of a usual machine."""
    rng = np.random.default_rng(seed)
    degree, dim = int(rng.integers(3, 6)), int(rng.integers(2, 4))
    curve = random_nurbs(seed, degree, dim, spans=int(rng.integers(1, 5)), rational=bool(rng.integers(2)))
    limits = Limits(
        float(rng.choice([60.0, 200.0, np.inf])),
        rng.uniform(50.0, 400.0, dim),
        rng.uniform(300.0, 3000.0, dim),
        rng.uniform(5000.0, 60000.0, dim),
        chord_error=float(rng.choice([1e-3, np.inf])),
    )
    return curve, limits


def duration(curve: Curve, limits: Limits, **options: Any) -> float:
    """Seconds of the plan."""
    return plan_feedrate(curve, limits, **options).duration

"""From a curve and its limits to what a solver sees, for the tests of plans."""

from __future__ import annotations

from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.plan.knots import Grid, Scan, place_knots, scan, with_blends
from planner.plan.rows import Constraints, build
from planner.plan.section import Section, cut


def laid_out(
    curve: Curve, limits: Limits, intervals: int = 1000, *, start: float = 0.0, end: float = 0.0, periodic: bool = False
) -> tuple[Section, Scan, Grid]:
    """Section with its blends, guess of the feed and grid of a path without corners, from feed start to feed end."""
    (section,) = cut(curve, limits, start, end, exact_stop=False, periodic=periodic)
    guess = scan(section, limits, intervals)
    section = with_blends(section, guess)
    return section, guess, place_knots(section, guess, intervals)


def problem_of(
    curve: Curve, limits: Limits, intervals: int = 100, *, start: float = 0.0, end: float = 0.0, periodic: bool = False
) -> Constraints:
    """The arrays that a solver sees."""
    section, guess, grid = laid_out(curve, limits, intervals, start=start, end=end, periodic=periodic)
    return build(section, limits, grid, guess, periodic=periodic)[0]

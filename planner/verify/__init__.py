"""Independent verification of a plan or of its samples.

A plan is believed only after it has been measured here, from the curve and the time law alone: no formula of the
planner is used, neither its constraints nor its feed limit for the chord.

Three formulas of geometry are shared with the planner, as the evaluation of the curve itself is: the chain rule from u to
an axis, the curvature of a curve (``planner.geometry.differential``), and the distance from a segment (``chord``).  An error
there would pass unseen here.  It is found by ``tests/geometry/test_differential.py`` and ``test_chord.py``, which compare
with fifty digits and closed forms, and plant an error in every term.  What follows from them is derived again, another way
where there is one: the rates along the path by projection onto the tangent (the planner differentiates |C'|), the chord
error as a distance (the planner limits the feed on the osculating circle), a step of the acceleration from its two sides
(the planner bounds the feed at a jump of the curvature).

A *profile* is measured between its nodes.  The time law is cut into spans: the intervals of the table, cut again
wherever u(t) crosses a knot of the curve, so that everything is smooth within a span.

1. On each span the axes' velocity, acceleration and jerk follow from u(t) and the curve's derivatives by the chain
   rule, at ``density`` points, both ends included and each end taken from inside the span.
2. The spans with the highest peaks (a parabola through the top three points) are searched on ever finer points, so
   that the worst value does not depend on the grid.
3. Where two spans meet, the values on either side are compared: a step of the velocity is a violation; so is, of an axis
   with a jerk limit, one of the acceleration, but at a jump of the curvature.  There a step D is what a drive sees as a
   jerk of 0.75 D / T, once it is sampled with the period T.
4. The chord error is the true distance between the path and the chord of one period, for every phase of the sampling.  What
   is measured in 1. bounds it (``chordbounds.py``), so chords that cannot be left as far as the highest are left out.

*Samples* are measured as a drive sees them: by differences over the period, held constant before the first and after
the last one.

Known limitation: a table in double precision cannot hold a jerk over very short intervals h, because the last digit of
u is worth 60 eps |u| / h^3.  That much is granted (``Row.slack``); it matters below some 1e-5 s.  There the mean jerk of
each interval is looked at as well, of which the digits of u hide nothing (``meanjerk.py``).
"""

from __future__ import annotations

import numpy as np

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import require_instance
from planner.machine.limits import Limits, require_limits
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.verify.between_nodes import check_profile
from planner.verify.differences import check_samples
from planner.verify.findings import Report, Row, Rows

__all__ = ["Report", "Row", "check"]


def check(
    curve: Curve,
    limits: Limits,
    plan: FeedrateProfile | Samples,
    *,
    density: int = 24,
    tolerance: float = 1e-6,
) -> Report:
    """Measure a plan, or the samples of one, against every limit.

    Parameters
    ----------
    curve : Curve
        The tool path.
    limits : Limits
        What is allowed; its period is the one the chord error of a profile is measured with (samples have their own).
    plan : FeedrateProfile or Samples
        What is measured.
    density : int
        Points an interval of the table (of samples: a period, for the chord error), at least 4.
    tolerance : float
        Relative excess that still counts as within a limit.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        If limits, curve and plan do not belong together, or an argument is not one of those above.
    """
    limits = require_limits(curve, limits)
    require_instance(plan, (FeedrateProfile, Samples), "plan")
    if isinstance(density, bool) or not isinstance(density, int | np.integer) or density < 4:
        raise InputError(f"density = {density!r} must be an integer of at least 4")
    if not (np.isfinite(tolerance) and tolerance >= 0.0):
        raise InputError(f"tolerance = {tolerance!r} must be >= 0 and finite")
    rows = Rows(curve, float(tolerance))
    if isinstance(plan, FeedrateProfile):
        if plan.curve is not curve and plan.curve.fingerprint != curve.fingerprint:
            raise InputError(
                f"the plan was made for another curve: {plan.curve.name} (fingerprint {plan.curve.fingerprint}), not "
                f"{curve.name} ({curve.fingerprint}); plan this curve, or check the plan on its own"
            )
        return check_profile(curve, limits, plan, int(density), rows)
    return check_samples(curve, limits, plan, int(density), rows)

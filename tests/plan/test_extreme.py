"""Curves and machines at the edges: each is planned and passes the check, or is refused with place and reason."""

import json
import re
import warnings

import numpy as np
import pytest
from cases import CURVES, DRIVES
from extreme import extreme_case

from interp import replay
from planner import check, load_curve, load_limits, plan_feedrate
from planner.errors import FeedrateError, SolverError
from planner.geometry.nurbs import NurbsCurve
from planner.plan.solvers import interior as optimal


def outcome(make_curve, limits):
    """What becomes of a case: "planned", "breaks" and which limits, or the refusal."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            curve = make_curve()
            plan = plan_feedrate(curve, limits)
        except FeedrateError as error:
            return f"{type(error).__name__}: {error}"
    assert np.isfinite([plan.t, plan.u, plan.u_rate, plan.u_acceleration]).all()
    assert not plan.lower_bound > plan.duration * (1.0 + 2e-6)
    reports = [check(curve, limits, plan)]
    if plan.duration / limits.period < 1e5:
        reports.append(check(curve, limits, replay(curve, plan, limits.period)))
    broken = {row.limit for report in reports for row in report.violations}
    return f"breaks {', '.join(sorted(broken))}" if broken else "planned"


def of_file(seed):
    limits = load_limits(CURVES / f"seed{seed}.toml")
    return outcome(lambda: load_curve(CURVES / f"seed{seed}.json"), limits)


@pytest.mark.parametrize("seed", [12, 20, 36, 53, 60, 107])
def test_a_curve_that_once_broke_a_limit_is_planned(seed):
    """Of seed 53 a digit of u is worth up to 24 mm of 2e7: the check proves the plan right, and its samples."""
    assert of_file(seed) == "planned"


@pytest.mark.parametrize("away", [7e3, 7e4, 7e6])
def test_a_curve_beyond_the_digits_of_a_plan_is_refused_with_place_and_reason(away):
    """Seed 53, of which a digit of u is 24 mm where it begins at -67, further from 0: its legs are 2e7 mm."""
    given = json.loads((CURVES / "seed53.json").read_text(encoding="utf-8"))["curve"]
    knots = np.array(given["knots"]) - away

    def moved():
        return NurbsCurve(given["control_points"], knots, given["degree"], given["weights"], given["axes"])

    refused = outcome(moved, load_limits(CURVES / "seed53.toml"))
    assert re.match(r"CurveError: .*a digit of u is worth [\d.e-]+ of the path between u = -[\d.]+ and", refused)


@pytest.mark.parametrize(
    ("seed", "why"),
    [
        (36, r"\|C'\| falls to [\d.e-]+ of its largest value on its piece at u = 0.0376"),
        (53, r"a digit of u is worth 0.0264 mm of the path at u = -67.0948869"),  # its first leg
    ],
)
def test_a_solve_that_fails_on_such_a_curve_says_what_is_special_there(monkeypatch, seed, why):
    def fails(*_args, **_options):
        raise SolverError("planted")

    monkeypatch.setattr(optimal, "solve_interior", fails)
    assert re.match(rf"CurveError: .*planted.*{why}", of_file(seed))


def test_a_solve_that_fails_names_its_stretch(monkeypatch):
    def fails(*_args, **_options):
        raise SolverError("the interior-point method stopped")

    monkeypatch.setattr(optimal, "solve_interior", fails)
    with pytest.raises(SolverError, match=r"teardrop: no plan found between u = 0 and 1: the interior-point method"):
        plan_feedrate(load_curve("teardrop"), DRIVES)


@pytest.mark.parametrize(
    ("seed", "why"),
    [
        (2027, "far from 0, weights 1e6 apart"),
        (2151, "tangential jerk where the curvature jumps, axes 1e3 apart"),
        (2152, "chords around exact stops, without a jerk limit"),
        (2168, "samples of a path of kilometres, weights 1e6 apart"),
        (2328, "tangential acceleration of samples, a path of 40 nm"),
        (2336, "tangential jerk of samples where the tip turns back"),
        (2364, "the same, back and forth within one period"),
        (2769, "jerk of samples on a path of 1 um, degree 4"),
    ],
)
def test_a_curve_of_the_sweep_that_once_broke_a_limit_is_planned(seed, why):
    case = extreme_case(seed)
    assert outcome(case.curve, case.limits) == "planned", why


@pytest.mark.parametrize("seed", [2203, 2335])
def test_a_curve_that_its_parameter_does_not_resolve_is_refused(seed):
    """2203: a digit of u is worth 68 mm, of a path within 1e-13 of u = 44.6; 2335: it leaves 9 intervals of a plan."""
    case = extreme_case(seed)
    assert re.match(
        r"CurveError: extreme wander: a digit of u is worth [\d.e-]+ of the path", outcome(case.curve, case.limits)
    )


@pytest.mark.slow
@pytest.mark.parametrize("first", range(2000, 3000, 50))
def test_every_extreme_curve_is_planned_or_refused_as_a_curve(first):
    """Nothing that is not finite, no plan that breaks a limit, no bound above its plan; a refusal says where and why."""
    for seed in range(first, first + 50):
        case = extreme_case(seed)
        assert re.match(r"planned$|CurveError: .*u = |SolverError: .*near u = ", outcome(case.curve, case.limits)), seed


@pytest.mark.parametrize(
    "seed", [2000, 2001, 2002, 2003, 2004, 2005, 2010, 2015, 2017, 2018, 2019, 2020, 2021, 2022, 2047, 2088]
)
def test_extreme_curves_are_planned(seed):
    case = extreme_case(seed)
    assert outcome(case.curve, case.limits) == "planned"

"""Curves and machines at the edges: each is planned and passes the check, or is refused with place and reason."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from extreme import extreme_case

from interp import replay
from planner import check, load_curve, load_limits, plan_feedrate
from planner.errors import FeedrateError, SolverError
from planner.limits import Limits
from planner.solvers import optimal

DATA = Path(__file__).parent / "data" / "curves"


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
    reports = [check(curve, limits, plan)]
    if plan.duration / limits.period < 1e5:
        reports.append(check(curve, limits, replay(curve, plan, limits.period)))
    broken = {row.limit for report in reports for row in report.violations}
    return f"breaks {', '.join(sorted(broken))}" if broken else "planned"


def of_file(seed):
    limits = load_limits(DATA / f"seed{seed}.toml")
    return outcome(lambda: load_curve(DATA / f"seed{seed}.json"), limits)


@pytest.mark.parametrize("seed", [12, 20, 60, 107])
def test_a_curve_that_once_broke_a_limit_is_planned(seed):
    assert of_file(seed) == "planned"


def test_a_curve_beyond_the_digits_of_a_plan_is_refused_with_place_and_reason():
    """Seed 36: |C'| falls to 6e-9; seed 53: a digit of u is 24 mm."""
    assert re.match(
        r"CurveError: .*\|C'\| falls to [\d.e-]+ of its largest value on its piece at u = 0.0376", of_file(36)
    )
    assert re.match(r"CurveError: .*a digit of u is worth 23.7 mm of the path at u = -67.0940191", of_file(53))


def test_a_solve_that_fails_names_its_stretch(monkeypatch):
    def fails(*_args, **_options):
        raise SolverError("the interior-point method stopped")

    monkeypatch.setattr(optimal, "solve", fails)
    limits = Limits(100.0, [250.0] * 2, [1000.0] * 2, [20000.0] * 2)
    with pytest.raises(SolverError, match=r"teardrop: no plan found between u = 0 and 1: the interior-point method"):
        plan_feedrate(load_curve("teardrop"), limits)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(2000, 3000, 50))
def test_nothing_but_a_plan_or_a_refusal_comes_out(first):
    """No other error, nothing that is not finite; plans that break a limit are said to."""
    for seed in range(first, first + 50):
        case = extreme_case(seed)
        assert re.match(r"planned|breaks|\w+Error: ", outcome(case.curve, case.limits)), seed


@pytest.mark.parametrize(
    "seed", [2000, 2001, 2002, 2003, 2004, 2005, 2010, 2015, 2017, 2018, 2019, 2020, 2021, 2022, 2047, 2088]
)
def test_extreme_curves_are_planned(seed):
    case = extreme_case(seed)
    assert outcome(case.curve, case.limits) == "planned"

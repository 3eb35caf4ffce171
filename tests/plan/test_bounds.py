"""Lower bounds: the identity behind them, closed forms, and that no plan is below them."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from bound_cases import KINDS, bound_case, program_of
from cases import DRIVES, MILL, drives, line, mill
from extreme import extreme_case

from planner import (
    FeedrateError,
    InputError,
    Limits,
    SolverError,
    certify,
    check,
    load_curve,
    load_limits,
    plan_feedrate,
)
from planner.certificate import Certificate, CertificateSection
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.output.table import read_table, write_table
from planner.plan import bounds
from planner.plan.bounds import Bound, section_bound, statement
from planner.plan.dual.problem import Pace
from planner.plan.ends import REST
from planner.plan.guess import guess_feed
from planner.plan.section import cut
from planner.programs.path.smooth_path import program_path
from planner.status import Claim
from planner.verify.certificate import verify_bound, verify_plan_bound

# a line, an arc and a line, tangent to one another
JUMPS = NurbsCurve(
    [[0, 0], [20, 0], [40, 0], [50, 0], [50, 10], [50, 30], [50, 50]],
    [0, 0, 0, 1, 1, 2, 2, 3, 3, 3],
    2,
    [1, 1, 1, np.sqrt(0.5), 1, 1, 1],
)
LINE = line(100.0)
SAWTOOTH = (
    "G21 G90 G64 P0.01\nG0 X0 Y0\nG1 X20 F6000\n" + "".join(f"X{x} Y20\nY0\n" for x in range(40, 121, 20)) + "M2\n"
)


def test_line_from_rest_to_rest_is_bounded_by_its_closed_form():
    exact = 1.0 + 0.1 + 0.05  # seven segments: D/V + V/A + A/J
    profile = plan_feedrate(LINE, MILL)
    assert 0.0 <= 1.0 - certify(LINE, MILL, profile, intervals=1000) / exact < 1e-5
    assert 0.0 <= 1.0 - certify(LINE, MILL, profile, intervals=4000) / exact < 1e-6


def test_sawtooth_whose_old_bound_a_plan_contradicted(tmp_path):
    path = program_path(program_of(SAWTOOTH, tmp_path), None, load_limits("mill"), path="separate")
    limits = load_limits("mill").for_curve(path.curve)
    profile = plan_feedrate(path.curve, limits, intervals=1000)
    bound = certify(path.curve, limits, profile)
    assert 3.79 < bound <= 3.864  # a plan of 3.864 s exists
    assert profile.lower_bound <= 3.864


CASES = {
    "rest to rest": ("teardrop", 1.0, MILL, {}, 1e-4),
    "feeds at the ends": ("butterfly", 10.0, MILL, {"start_feed": 10.0, "end_feed": 5.0}, 5e-4),
    "start acceleration": ("butterfly", 10.0, MILL, {"start_feed": 10.0, "start_acceleration": 100.0}, 5e-4),
    "periodic": ("hypotrochoid", 10.0, drives(300.0), {"periodic": True}, 2e-4),
    "an axis without a jerk limit": ("butterfly", 10.0, drives(jerk=[2e4, np.inf]), {}, 5e-4),
    "no acceleration limit": ("teardrop", 1.0, Limits(100.0, [np.inf] * 2, [np.inf] * 2, [2e4] * 2), {}, 2e-4),
    "no velocity limit": ("teardrop", 1.0, Limits(np.inf, [np.inf] * 2, [1e3] * 2, [2e4] * 2), {}, 2e-4),
    "tangential limits": (
        "butterfly",
        10.0,
        drives(tangential_acceleration=500.0, tangential_jerk=1e4),
        {},
        1e-2,
    ),
    "rotary axes": ("flank", 1.0, load_limits("five-axis"), {}, 1.7e-2),
    "curvature jumps": (JUMPS, 1.0, MILL, {}, 3e-2),
    "exact stops": (JUMPS, 1.0, MILL, {"exact_stop": True}, 3e-4),
}


@pytest.mark.parametrize("case", CASES)
def test_bound_is_close_to_the_plan_and_independently_verified(case, tmp_path):
    curve, scale, limits, options, gap = CASES[case]
    curve = load_curve(curve, scale=scale) if isinstance(curve, str) else curve
    profile = plan_feedrate(curve, limits, **options)
    assert check(curve, limits, profile).ok
    bound = certify(curve, limits, profile)
    assert isinstance(bound, Bound)
    assert 0.0 <= 1.0 - bound / profile.duration <= gap
    if "start_acceleration" not in options:  # which certify leaves free, and the plan's own bound does not
        assert profile.lower_bound <= bound * (1.0 + 1e-4)
    assert profile.lower_bound <= profile.duration
    report = verify_plan_bound(curve, limits, bound.certificate, replace(profile, lower_bound=float(bound)))
    assert report.ok, report.refusal
    assert bound <= report.proved * (1.0 + 1e-9)
    table = tmp_path / "plan.csv"
    write_table(table, profile, limits)
    assert certify(curve, limits, read_table(table, curve)) == pytest.approx(bound, rel=1e-12)


def test_agrees_with_the_verifier_to_quadrature():
    """Caps by ways from the stops differ (theirs are closer), so the cap is kept finite by the feed alone here."""
    curve = load_curve("teardrop")
    limits = DRIVES
    profile = plan_feedrate(curve, limits, intervals=200)
    bound = certify(curve, limits, profile, intervals=2000)
    assert verify_bound(curve, limits, bound.certificate).proved == pytest.approx(bound, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "scale", "feed"),
    [("teardrop", 1.0, 100.0), ("butterfly", 10.0, 300.0), ("hypotrochoid", 10.0, 300.0), ("circle", 1.0, 100.0)],
)
def test_gaps_to_the_best_plan_fall_with_the_knots(name, scale, feed):
    curve = load_curve(name, scale=scale)
    limits = mill(feed)
    best = plan_feedrate(curve, limits, intervals=8000)
    assert check(curve, limits, best).ok
    gaps = [1.0 - certify(curve, limits, best, intervals=n) / best.duration for n in (1000, 4000)]
    assert 0.0 <= gaps[1] < gaps[0] <= 2e-4
    assert gaps[1] <= 1e-4


def test_bound_above_a_checked_plan_is_an_error(monkeypatch):
    profile = plan_feedrate(LINE, MILL, intervals=100)
    impossible = replace(profile, law=profile.law.dilated(0.9))
    assert certify(LINE, MILL, impossible) > impossible.duration  # such a plan fails its check, and says nothing

    class Passed:
        ok = True

    monkeypatch.setattr(bounds, "check", lambda *_args: Passed)
    with pytest.raises(SolverError, match="above a plan of"):
        certify(LINE, MILL, impossible)


def test_bound_is_a_number_that_carries_its_proof():
    profile = plan_feedrate(LINE, MILL, intervals=100)
    bound = certify(LINE, MILL, profile)
    assert f"{bound:.4f}" == "1.1500"
    assert float(bound) == bound.certificate.bound
    assert "from rest to rest" in bound.statement
    assert "osculating circle" in bound.statement
    with pytest.raises(FeedrateError, match="intervals = 3"):
        certify(LINE, MILL, profile, intervals=3)


@pytest.mark.parametrize(
    ("stops", "shown"),
    [
        ((), None),
        ((20,), "20"),
        ((20, 120), "20, 120"),
        (range(10, 90, 10), "70, 80"),
        (range(10, 100, 10), "70, 80, ..."),
    ],
)
def test_a_bound_names_the_stops_of_its_plans_but_not_the_corners(stops, shown):
    """Where a plan stops in the middle of a line other plans need not; at a corner every plan has to."""
    bent = NurbsCurve([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]], [0, 0, 100, 150, 150], 1, name="bent")
    ends = sorted([0.0, *stops, 100.0, 150.0])
    data = []
    for k, (start, end) in enumerate(pairwise(ends)):
        u = np.array([[start, 0.5 * (start + end), end], [0.0] * 3, [0.0] * 3])
        feeds = 0.0, (12.5 if k == len(ends) - 2 else 0.0)
        data.append(CertificateSection(np.arange(3.0), u, np.empty((0, 4)), np.empty((0, 3)), *feeds, np.nan))
    certificate = Certificate(tuple(data), (), (), 1.5, bent.fingerprint, False)
    named = statement(bent, DRIVES, certificate).split("; ")
    assert named[0] == "no plan of bent from rest to 12.5 mm/s within these limits takes less than 1.5 s"
    if shown is None:
        assert len(named) == 1
    else:
        assert named[1].startswith("for plans that stop at u = ")
        assert named[1].endswith(shown)
        assert "100" not in named[1]
    jumps = statement(JUMPS, MILL, replace(certificate, sections=tuple(data[:1]), periodic=True)).split("; ")
    assert jumps[0].startswith("no plan of nurbs that pass its end into its start within these limits takes")
    assert jumps[1] == "the chord error counts as the feed limit of the osculating circle"
    assert jumps[2].startswith("at curvature jumps the acceleration steps by at most 0.001 s / 0.75 of the jerk limit")


@pytest.mark.parametrize("periodic", [True, False, None])
def test_a_plan_is_periodic_that_says_so_or_closes_and_says_nothing(periodic):
    """What a plan says decides where it can be true; a table of other makers says nothing."""
    curve = load_curve("circle")
    around = plan_feedrate(curve, MILL, periodic=True, intervals=100)
    origin = replace(around.origin, periodic=periodic)
    assert certify(curve, MILL, replace(around, origin=origin), intervals=60).certificate.periodic is (
        periodic is not False
    )
    for column in ("feed", "acceleration"):
        other = getattr(around, column).copy()
        other[-1] += 1e-5 * np.abs(getattr(around, column)).max()
        unlike = replace(around, origin=origin, **{column: other})
        assert not bounds._is_periodic(curve, unlike)
    apart = FormulaCurve({"X": "50*cos(u)", "Y": "50*sin(u)"}, (0.0, 6.2))
    assert not bounds._is_periodic(apart, replace(around, curve=apart, origin=origin))
    still = np.zeros(around.t.size)
    assert not bounds._is_periodic(curve, replace(around, feed=still, acceleration=still, origin=origin))


def test_caps_alone_bound_where_nothing_else_is_known():
    """A circle at a feed far below what axes allow: the bound is length over feed."""
    curve = load_curve("circle")
    limits = Limits(1.0, [250.0] * 2, [1e6] * 2, [1e9] * 2)
    (section,) = cut(curve, limits, exact_stop=False)
    guess = guess_feed(section, limits, 1000)
    assert section_bound(section, limits, 1000, Pace(guess.u, guess.time)) == pytest.approx(curve.length, rel=1e-3)


def test_the_bound_of_a_plan_is_computed_once_and_only_where_it_is_asked_for(monkeypatch):
    asked = []

    def counted(section, *rest, **options):
        asked.append((section.u_start, section.u_end))
        return section_bound(section, *rest, **options)

    monkeypatch.setattr(bounds, "section_bound", counted)
    plan = plan_feedrate(load_curve("teardrop"), MILL, intervals=60)
    assert check(plan.curve, MILL, plan).ok
    sent = pickle.loads(pickle.dumps(plan))
    proved = replace(plan, lower_bound=1.0, claim=Claim.COMPUTED)
    assert asked == []
    assert proved.lower_bound == 1.0
    assert 0.9 * plan.duration < plan.lower_bound <= plan.duration
    assert plan.claim is Claim.COMPUTED
    assert replace(plan, method="other").lower_bound == plan.lower_bound
    assert asked == [plan.curve.domain]
    assert sent.lower_bound == plan.lower_bound


def test_a_plan_has_no_bound_where_one_section_has_none(monkeypatch):
    corner = NurbsCurve([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]], [0, 0, 1, 2, 2], 1)
    plan = plan_feedrate(corner, MILL, intervals=60)
    whole = plan_feedrate(corner, MILL, intervals=60).lower_bound
    first = plan_feedrate(line(10.0), MILL, intervals=30).lower_bound
    assert whole == pytest.approx(2.0 * first, rel=1e-3)
    found = iter([np.nan, first])
    monkeypatch.setattr(bounds, "section_bound", lambda *_, **__: next(found))
    assert np.isnan(plan.lower_bound)
    assert plan.claim is Claim.NONE
    assert np.isnan(plan_feedrate(corner, MILL, method="scurve").lower_bound)


METHODS = ("optimal", "nlp", "toppra", "scurve")


def plans_of(case, rng):
    """Plans by every method and on several grids, those that pass their check."""
    for method in METHODS:
        for intervals in (int(rng.integers(30, 120)), int(rng.integers(200, 800))):
            if (method in {"nlp", "scurve"} and intervals > 200) or (method == "nlp" and rng.random() < 0.9):
                continue
            options = dict(case.options)
            if method in {"toppra", "scurve"}:
                options.pop("start_acceleration", None)
            try:
                profile = plan_feedrate(case.curve, case.limits, method=method, intervals=intervals, **options)
            except FeedrateError:
                continue
            if check(case.curve, case.limits, profile).ok:
                yield profile


def no_bound_exceeds_a_plan(seed, folder):
    """How many plans there are of a case; every bound is below all of those with the same stops, and proved elsewhere."""
    case = bound_case(seed, folder)
    plans = list(plans_of(case, np.random.default_rng([32, seed])))
    groups = {}
    for profile in plans:
        carried = profile.lower_bound if profile.method in {"optimal", "nlp"} else 0.0
        assert carried <= profile.duration * (1.0 + 2e-6)
        stops = (*profile.u[profile.u_rate == 0.0], profile.feed[0], profile.feed[-1])
        if not case.options.get("periodic"):
            groups.setdefault(stops, []).append(profile)  # plans with other stops or ends are another problem
        else:
            groups.setdefault("periodic", []).append(profile)
    for alike in groups.values():
        bound = certify(case.curve, case.limits, alike[0], intervals=300)  # raises where it is above this plan
        report = verify_bound(case.curve, case.limits, bound.certificate)
        assert bound <= report.proved * (1.0 + 1e-9)
        assert report.proved <= min(profile.duration for profile in alike) * (1.0 + 2e-6)
    return len(plans)


@pytest.mark.parametrize("seed", range(2 * len(KINDS)))
def test_no_bound_exceeds_any_plan(seed, tmp_path):
    assert no_bound_exceeds_a_plan(seed, tmp_path) > 0


@pytest.mark.slow
def test_no_bound_exceeds_any_plan_of_six_hundred(tmp_path):
    assert sum(no_bound_exceeds_a_plan(seed, tmp_path) > 0 for seed in range(100, 700)) > 590


@pytest.mark.parametrize("seed", [260, 284, 482])
def test_a_closed_path_of_an_axis_without_an_acceleration_limit_is_proved(seed, tmp_path):
    """Where the path closes a difference of the l, by one digit, would be paid with the largest acceleration: inf."""
    case = bound_case(seed, tmp_path)
    assert np.isinf(case.limits.acceleration).any()
    bound = certify(case.curve, case.limits, plan_feedrate(case.curve, case.limits, periodic=True), intervals=300)
    assert verify_bound(case.curve, case.limits, bound.certificate).proved == pytest.approx(bound, rel=1e-6)


@pytest.mark.parametrize("seed", [221, 265, 296, 420])
def test_a_plan_without_jerk_is_faster_than_the_bound_and_fails_its_check(seed, tmp_path):
    """Its steps are small enough for the axes in samples, and once passed."""
    case = bound_case(seed, tmp_path)
    profile = plan_feedrate(case.curve, case.limits, method="toppra", intervals=300, **case.options)
    report = check(case.curve, case.limits, profile)
    assert {row.limit for row in report.violations} - {"tangential step"} == {"step on a smooth path"}
    smooth = plan_feedrate(case.curve, case.limits, **case.options)
    assert certify(case.curve, case.limits, smooth) > profile.duration


def test_a_tip_that_turns_back_has_no_bound_from_its_arc_length():
    """X runs forth and back while A turns: where X reverses, the arc length of the tip has a kink, and no jerk."""
    points = [[0.0, 0.0], [40.0, 0.3], [0.0, 0.8], [30.0, 1.0]]
    curve = NurbsCurve(points, [0, 0, 0, 0, 1, 1, 1, 1], 3, axes=("X", "A"))
    tangential = {"tangential_acceleration": 5e3, "tangential_jerk": 3e4}
    limits = Limits(1e6, [1e4, 50.0], [1000.0, 20.0], [2e4, 300.0], **tangential, axes=("X", "A"))
    profile = plan_feedrate(curve, limits)
    assert check(curve, limits, profile).ok
    bound = certify(curve, limits, profile)
    assert 0.999 * profile.duration < bound <= profile.duration
    assert bound.certificate.jerk_names == ("jerk X", "jerk A")
    claimed = replace(
        bound.certificate,
        jerk_names=("jerk X", "tangential jerk"),
    )
    with pytest.raises(InputError, match="turns back near u = "):
        verify_bound(curve, limits, claimed)


def test_a_certificate_for_other_limits_says_so():
    """Multipliers for a slow machine prove no time at all on one whose axes have ten thousand times its jerk."""
    profile = plan_feedrate(LINE, MILL, intervals=100)
    bound = certify(LINE, MILL, profile)
    fast = Limits(1e4, [1e4] * 2, [1e6] * 2, [2e12] * 2)
    report = verify_plan_bound(LINE, fast, bound.certificate, profile)
    assert report.proved <= 0.0
    assert report.statement.startswith("nothing for these limits")
    assert report.refusal.startswith("the certificate proves nothing for these limits, not the 1.1499")
    assert report.refusal.endswith("the plan was made for other limits than these: give those")
    same = verify_plan_bound(LINE, Limits(**vars(MILL)), bound.certificate, profile)
    assert same.ok
    assert not same.other_limits
    assert Limits(**{**vars(MILL), "jerk": [2e4, 2.1e4]}) != MILL
    assert MILL.with_feed(99.0) != MILL


def test_a_bound_whose_coordinate_does_not_grow_is_none(monkeypatch):
    """A line with weights 1e5 apart on a grid that does not follow |C'|: it came out 2.4e-4 above a plan."""
    case = extreme_case(2220)
    curve = case.curve()
    profile = plan_feedrate(curve, case.limits)
    assert 0.9999 * profile.duration < profile.lower_bound <= profile.duration
    place, look = bounds.place_knots, bounds.guess_feed
    monkeypatch.setattr(bounds, "place_knots", lambda *given, **_follow: place(*given))
    monkeypatch.setattr(bounds, "guess_feed", lambda *given, **_follow: look(*given))
    with pytest.raises(
        SolverError, match=r"between its knots u = [\d.e-]+ and [\d.e-]+ the coordinate of the bound does"
    ):
        certify(curve, case.limits, profile, intervals=250)
    assert np.isnan(plan_feedrate(curve, case.limits, intervals=250).lower_bound)


@pytest.mark.parametrize(("above", "raises"), [(1.9e-6, False), (2.1e-6, True)])
def test_a_bound_may_exceed_a_plan_by_what_its_check_grants(monkeypatch, above, raises):
    curve, limits = load_curve("circle"), load_limits("mill").for_curve(load_curve("circle"))
    profile = plan_feedrate(curve, limits, intervals=100)
    _, splines = bounds._certified(
        bounds.sections_between(curve, limits, {}, REST, REST)[0],
        limits,
        100,
        Pace(profile.u, profile.t),
        periodic=False,
    )
    monkeypatch.setattr(bounds, "_certified", lambda *_, **__: (profile.duration * (1.0 + above), splines))
    if raises:
        with pytest.raises(SolverError, match="an error of this program"):
            certify(curve, limits, profile)
    else:
        assert certify(curve, limits, profile) > profile.duration


def test_a_closed_path_from_rest_to_rest_is_not_periodic():
    """Feed and acceleration are the same at both ends there too: nothing."""
    curve, limits = load_curve("circle"), load_limits("mill").for_curve(load_curve("circle"))
    profile = plan_feedrate(curve, limits, intervals=100)
    silent = replace(profile, origin=replace(profile.origin, periodic=None))
    assert profile.feed[0] == profile.feed[-1] == 0.0
    assert not certify(curve, limits, silent).certificate.periodic

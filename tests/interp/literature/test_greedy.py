"""Algorithms 1-4 of 2022: the published numbers, plain re-implementations, closed forms, and what a run must report."""

from __future__ import annotations

from math import acos, exp, pi

import numpy as np
import pytest
from greedy_cases import CURVES, MADE, NAMES, REPAIRED, greedy_limit, limits

from interp import greedy
from interp.literature.greedy_published import DEFECTS, PUBLISHED_COUNTS
from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.machine.limits import Limits

# Integral of sqrt(curvature) over the length, and the length, mm.
INTEGRALS = {
    "teardrop": (20.765014, 101.834695),
    "hypotrochoid": (19.988733, 68.627374),
    "snailshell": (14.513904, 13.855877),
    "butterfly": (26.800549, 35.606994),
}


def ellipse(a, b):
    return FormulaCurve({"X": f"{a}*sin(2*pi*u)", "Y": f"{b}*cos(2*pi*u)"}, (0.0, 1.0), name="ellipse")


def steps_needed(curve, feed=np.inf):
    """Integral of max(1/(F T), sqrt(curvature/(8 e))) ds: no fewer chords keep the tolerance of 1e-6 mm, T = 1 ms."""
    u = np.linspace(*curve.domain, 100_001)
    mid = 0.5 * (u[1:] + u[:-1])
    speed = np.linalg.norm(curve.derivatives(mid, 1)[1], axis=-1)
    density = np.maximum(1.0 / (feed * 1e-3), np.sqrt(curve.curvature(mid) / 8e-6))
    return float(np.sum(density * speed) * (u[1] - u[0])), float(np.sum(speed) * (u[1] - u[0]))


# ---- plain re-implementations ---------------------------------------------------------------------------------------


def chord_error(position, u, du):
    """Largest distance of 19 inner points from the chord, by the normal part of a vector."""
    p, q = position(u), position(u + du)
    chord = (q - p) / np.linalg.norm(q - p)
    inner = position(u + du * np.arange(1, 20)[:, None] / 20.0) - p
    return float(np.linalg.norm(inner - (inner @ chord)[:, None] * chord, axis=-1).max())


def teardrop_at(u):
    u = np.asarray(u)
    return np.stack([-150 * u + 450 * u**2 - 300 * u**3, -150 * u + 150 * u**2], axis=-1).reshape(*u.shape[:1], 2)


def s_curve(u, rise=0.10, fall=0.95):
    def s(z):
        return (1.0 + exp(-5.0 * z)) ** -8 if z > -16.0 else 0.0

    return s(3.0 * u / rise) * (1.0 - s(3.0 * (u - fall) / (1.0 - fall)))


def published_points(curve, algorithm, count):
    """The published program on its first ``count`` points, as it is written; u in [0, 1]."""
    span = curve.domain[1] - curve.domain[0]
    u = [0.0]
    for _ in range(count):
        _, first, second = curve.derivatives(curve.domain[0] + span * u[-1], 2)
        v, w = np.linalg.norm(first) * span, np.linalg.norm(second) * span**2
        du = abs(0.02 / v - 0.02**2 / 2.0 * w / v**3)
        if algorithm >= 2:
            d = 0.1 if algorithm == 2 else 1e-6
            theta = 1.0 - d
            while chord_error(teardrop_at, u[-1], du) > 1e-6:
                du *= theta
                theta -= d
        if algorithm == 4:
            theta = 1.0
            while chord_error(teardrop_at, u[-1], du) < 0.999e-6:
                du *= theta
                theta += 1e-7
        u.append(u[-1] + du)
    return np.array(u)


def physical_points(curve, given, algorithm, soft, safety=0.18, floor=0.5):
    """Mode physical without the chord error, by the cases of the table: parameters in [0, 1] and feeds."""
    span = curve.domain[1] - curve.domain[0]
    period, jerk = given.period, given.jerk.min()
    u, feeds, v_now, a_now = [0.0], [], floor, 0.0
    while u[-1] < 1.0:
        _, first, second = curve.derivatives(min(curve.domain[0] + span * u[-1], curve.domain[1]), 2) * np.array(
            [[1.0], [span], [span**2]]
        )
        speed = np.linalg.norm(first)
        tangent = first / speed
        bend = (first[0] * second[1] - first[1] * second[0]) / speed**3
        normal = np.array([-tangent[1], tangent[0]]) * bend
        with np.errstate(divide="ignore"):
            limit = min(
                given.feed,
                *(given.velocity / np.abs(tangent)),
                *np.sqrt(safety * given.acceleration / np.abs(normal)),
            )
            ends = [(side * given.acceleration - normal * v_now**2) / tangent for side in (-1.0, 1.0)]
        low, high = np.min(ends, axis=0).max(), np.max(ends, axis=0).min()
        target = max(limit * s_curve(u[-1]), min(limit, floor))
        if algorithm == 1:
            v_next = max(given.feed * s_curve(u[-1]), floor)
        elif target > v_now:
            v_next = min(
                v_now + period * np.clip(a_now + jerk * period if a_now > 0 else jerk * period, 0, high), target
            )
        elif target < v_now and soft:
            v_next = max(
                v_now + period * np.clip(a_now - jerk * period if a_now < 0 else -jerk * period, low, 0), target
            )
        else:
            v_next = target
        a_now, v_now = (v_next - v_now) / period, v_next
        way = v_now * period
        u.append(min(1.0, u[-1] + way / speed - way**2 * (first @ second) / (2.0 * speed**4)))
        feeds.append(v_now)
    return np.array(u), np.array(feeds)


@pytest.mark.parametrize(
    ("name", "algorithm", "count"),
    [("hypotrochoid", 1, 200), ("teardrop", 2, 60), ("snailshell", 2, 60), ("hypotrochoid", 3, 2), ("teardrop", 4, 2)],
)
def test_the_points_are_those_of_the_loop_as_it_is_written(name, algorithm, count):
    run = greedy(CURVES[name], limits(), algorithm)
    span = CURVES[name].domain[1]
    assert np.abs(run.u[: count + 1] / span - published_points(CURVES[name], algorithm, count)).max() < 1e-9


@pytest.mark.parametrize(("algorithm", "soft"), [(1, False), (2, False), (2, True)])
def test_the_planned_feed_is_that_of_the_cases_of_the_table(algorithm, soft):
    given = limits(period=5e-3)
    u, feeds = physical_points(CURVES["hypotrochoid"], given, algorithm, soft)
    run = greedy(CURVES["hypotrochoid"], given, algorithm, mode="physical", braking="soft" if soft else "strict")
    assert run.u.size == u.size
    assert np.abs(run.u / CURVES["hypotrochoid"].domain[1] - u).max() < 1e-9
    assert np.abs(run.feed[:-1] - feeds).max() < 1e-7


# ---- the published table -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_published_numbers_of_points(name):
    runs = [greedy(CURVES[name], limits(), algorithm) for algorithm in (1, 2, 3, 4)]
    assert tuple(run.n for run in runs[:3]) == MADE[name][:3]
    assert abs(runs[3].n - PUBLISHED_COUNTS[name][3]) <= 2
    assert tuple(run.published for run in runs) == PUBLISHED_COUNTS[name]
    assert [run.u.size for run in runs] == [runs[0].n, *(run.n + 1 for run in runs[1:])]
    switched = list(DEFECTS) if name == "butterfly" else list(DEFECTS)[:3]
    assert all(run.defects == tuple(switched) for run in runs)


def test_the_result_says_where_the_print_errs():
    second, third = (greedy(CURVES["teardrop"], limits(), algorithm) for algorithm in (2, 3))
    for run in (second, third):
        assert all(number in run.remark for number in ("9204", "9294", "1805", "1605"))
    assert second.n - third.n == 9294 - 7599
    assert greedy(CURVES["snailshell"], limits(), 3).remark == ""
    other = greedy(CURVES["teardrop"], limits(feed=30.0), 2)
    assert (other.published, other.remark) == (None, "")


@pytest.mark.parametrize(
    ("curve", "counts"),
    [
        (ellipse(79, 79), (49641, 24822, 16549, 12413)),
        (ellipse(11, 51), (21575, 11296, 8338, 7351)),
        (CURVES["teardrop"], (10261, 7599, 7347, 7347)),
    ],
)
def test_the_counts_of_the_thesis_at_four_feeds(curve, counts):
    assert tuple(greedy(curve, limits(feed=feed), 3).n for feed in (10.0, 20.0, 30.0, 40.0)) == counts


def test_each_defect_has_a_switch_of_its_own():
    circle = ellipse(79, 79)
    assert greedy(circle, limits(), 3, taylor="exact").n == 24819
    butterfly = [greedy(CURVES["butterfly"], limits(), k, second_derivatives="exact").n for k in (1, 2, 3)]
    assert butterfly == [1803 + 1, 10829, 7348]
    own = [greedy(CURVES["snailshell"], limits(), k, error_curve="own").n for k in (1, 2, 3, 4)]
    assert own == [706, 8244, 5137, 5134]
    # Driven by the planned feed, the run takes the time that this feed needs, S-curves included.
    planned = greedy(CURVES["teardrop"], limits(), 1, step_feed="planned", min_feed=3.0)
    assert planned.defects == ("chord error on the wrong curve", "wrong Taylor term")
    u = np.linspace(0.0, 1.0, 20_001)[:-1] + 0.5 / 20_000
    four = np.minimum(20.0, greedy_limit(CURVES["teardrop"], u))
    feed = np.maximum(four * np.array([s_curve(x) for x in u]), np.minimum(four, 3.0))
    speed = np.linalg.norm(CURVES["teardrop"].derivatives(u, 1)[1], axis=-1)
    assert planned.duration == pytest.approx(np.mean(speed / feed), rel=2e-3)


def test_the_butterflys_wrong_derivatives_are_known_by_its_shape():
    expressions = {axis: f"3*({text})" for axis, text in CURVES["butterfly"].expressions.items()}
    scaled = FormulaCurve(expressions, CURVES["butterfly"].domain, name="a copy")
    assert "wrong second derivatives" in greedy(scaled, limits(), 1).defects
    assert greedy(scaled, limits(), 1).n == greedy(load_curve("butterfly", scale=3.0), limits(), 1).n
    assert "wrong second derivatives" not in greedy(CURVES["snailshell"], limits(), 1).defects


# ---- own chord error: closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_own_chord_error_leaves_as_few_points_as_there_can_be(name):
    curve = CURVES[name]
    (least, length), (slower, _) = steps_needed(curve), steps_needed(curve, 20.0)
    integral, known_length = INTEGRALS[name]
    assert length == pytest.approx(known_length, rel=1e-6)
    assert least == pytest.approx(integral / np.sqrt(8e-6), rel=1e-5)
    for switches in (REPAIRED, REPAIRED | {"taylor": "published"}):
        third, fourth = (greedy(curve, limits(), k, **switches) for k in (3, 4))
        assert 0.0 <= third.n - slower <= 10.0
        assert 0.0 <= fourth.n - least <= 10.0
        assert third.chord_error.max() <= 1e-6 * (1.0 + 1e-7)
    third, fourth = (greedy(curve, limits(), k, **REPAIRED, variant="root") for k in (3, 4))
    for run, bound in ((third, slower), (fourth, least)):  # rounded up; the law is one of small steps
        assert bound - 0.1 <= run.n < bound + 1.0
    assert np.all(fourth.chord_error[:-2] >= 1e-6 * (1.0 - 2e-6))
    assert fourth.row("chord error").count == third.row("chord error").count == 0


@pytest.mark.parametrize("curve", [load_curve("circle"), ellipse(50, 50)])
def test_chords_of_a_circle_have_the_sagitta_of_the_tolerance(curve):
    """R - R cos(angle/2) = e, for a rational curve and a fitted one."""
    for tolerance in (1e-6, 1e-3):
        run = greedy(curve, limits(feed=1e3, chord_error=tolerance), 4, **REPAIRED, variant="root")
        assert abs(run.n - pi / acos(1.0 - tolerance / 50.0)) <= 1.0


def test_a_tilted_curve_has_the_same_points():
    flat, high = CURVES["teardrop"].expressions["X"], CURVES["teardrop"].expressions["Y"]
    tilted = FormulaCurve({"X": f"0.6*({flat})", "Y": f"0.8*({flat})", "Z": high}, (0.0, 1.0), name="tilted")
    wide = Limits(20.0, [np.inf] * 3, [np.inf] * 3, [np.inf] * 3, chord_error=1e-6)
    for algorithm in (1, 2, 3, 4):
        run = greedy(tilted, wide, algorithm, **REPAIRED)
        assert run.n == greedy(CURVES["teardrop"], limits(), algorithm, **REPAIRED).n
    assert run.samples.position.shape == (run.n + 1, 3)


@pytest.mark.parametrize("algorithm", [1, 2, 3, 4])
@pytest.mark.parametrize("mode", ["compat", "physical"])
def test_scaling_every_length_leaves_the_points(algorithm, mode):
    switches = REPAIRED | {"variant": "root", "mode": mode, "safety": 0.5}
    small = greedy(CURVES["snailshell"], limits(period=2e-3), algorithm, **switches)
    double = limits(40.0, 2e-6, 2e-3, velocity=[60.0] * 2, acceleration=[60.0] * 2, jerk=[400.0] * 2)
    large = greedy(load_curve("snailshell", scale=2.0), double, algorithm, **switches, min_feed=1.0)
    assert large.u.size == small.u.size
    assert np.abs(large.u - small.u).max() < 1e-6
    assert [row.count for row in large.rows[:2]] == [row.count for row in small.rows[:2]]


# ---- what the published runs do -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "largest", "shares"),
    [
        ("teardrop", (4.56e-6, 1.0e-6, 1.0e-6, 1.0e-6), (72, 0, 0, 0)),
        ("hypotrochoid", (1.13e-4, 2.73e-6, 4.32e-6, 4.32e-6), (56, 22, 40, 40)),
        ("snailshell", (3.69e-4, 2.10e-6, 2.35e-6, 2.35e-6), (100, 3, 20, 20)),
        ("butterfly", (1.42e-3, 3.03e-6, 4.47e-6, 4.47e-6), (100, 36, 92, 92)),
    ],
)
def test_what_the_published_runs_do_to_their_own_curve(name, largest, shares):
    for algorithm, error, share in zip((1, 2, 3, 4), largest, shares, strict=True):
        run = greedy(CURVES[name], limits(), algorithm)
        row = run.row("chord error")
        assert row.worst == pytest.approx(error, rel=5e-3)
        assert 100.0 * row.count / (run.u.size - 1) == pytest.approx(share, abs=0.6)
        # The program saw nothing of it.
        assert (run.controlled_error.max() <= 1e-6 * (1 + 1e-7)) == (algorithm > 1)
        assert {"feed", "acceleration", "jerk"} <= {row.limit for row in run.violations}


def test_the_reported_acceleration_is_clipped_and_the_planned_one_is_not():
    """The program's own log: at most 31.7328; what the plan asks for goes up to 138 and 234 mm/s^2."""
    run = greedy(CURVES["teardrop"], limits(), 3, safety=0.5, u_rise=0.05)
    assert run.reported_acceleration.max() == pytest.approx(31.7328, abs=5e-5)
    assert run.reported_acceleration.min() == pytest.approx(-31.98, abs=0.02)
    assert np.abs(np.diff(run.feed)).max() / 1e-3 == pytest.approx(234.0, abs=0.5)
    hypotrochoid = greedy(CURVES["hypotrochoid"], limits(), 3, u_rise=0.05)
    assert np.abs(np.diff(hypotrochoid.feed)).max() / 1e-3 == pytest.approx(138.0, abs=1.0)
    assert np.all(run.feed <= run.limit)


# ---- mode physical --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("variant", ["theta", "root"])
def test_strict_keeps_feed_and_tolerance_and_breaks_the_rest(name, variant):
    for safety in (0.18, 0.5):
        run = greedy(CURVES[name], limits(), 3, mode="physical", variant=variant, safety=safety)
        assert run.row("feed").count == run.row("chord error").count == 0
        assert run.chord_error.max() <= 1e-6 * (1.0 + 1e-7)
        assert np.all(run.feed[:-1] <= run.limit[:-1] * (1.0 + 1e-9))
        assert run.row("jerk").count > 0
        # Never faster than the limits allow on the whole.
        assert run.duration >= steps_needed(CURVES[name], 20.0)[0] * 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_algorithm_1_ignores_limits_and_soft_braking_comes_late(name):
    first = greedy(CURVES[name], limits(), 1, mode="physical")
    assert min(first.row(limit).count for limit in ("feed", "chord error", "acceleration", "jerk")) > 0
    strict = greedy(CURVES[name], limits(), 2, mode="physical")
    soft = greedy(CURVES[name], limits(), 2, mode="physical", braking="soft")
    assert strict.row("feed").count == 0 < soft.row("feed").count
    assert soft.row("acceleration").count <= strict.row("acceleration").count
    assert soft.duration <= strict.duration
    fourth = greedy(CURVES[name], limits(), 4, mode="physical", variant="root")
    assert fourth.row("feed").count == fourth.row("chord error").count == 0
    assert fourth.duration <= strict.duration


def test_the_chord_error_that_limit_4_leaves():
    """eps = lambda A T^2/(8 max(|alpha|, |beta|)) where limit 4 holds: at most 5.303e-6 lambda, 1e-6 at 0.18856."""
    run = greedy(CURVES["teardrop"], limits(feed=1e3, velocity=[1e3] * 2), 2, mode="physical", u_rise=1e-3)
    at = (run.samples.u > 0.05) & (run.samples.u < 0.9)
    first = CURVES["teardrop"].derivatives(run.u, 1)[1]
    law = 0.18 * 30.0 * 1e-6 / 8.0 / (np.abs(first) / np.linalg.norm(first, axis=-1)[:, None]).max(axis=-1)
    holds = at & (run.feed >= run.limit * (1 - 1e-12))
    assert holds.sum() > 1000
    assert run.chord_error[holds] == pytest.approx(law[holds], rel=2e-3)
    threshold = 8e-6 / (np.sqrt(2.0) * 30.0 * 1e-6)
    assert threshold == pytest.approx(0.18856, abs=5e-6)
    largest = [
        greedy(CURVES["snailshell"], limits(), 2, mode="physical", safety=s).chord_error.max() for s in (0.18, 0.5)
    ]
    assert largest == pytest.approx([0.9546e-6, 2.652e-6], rel=1e-3)
    for safety, broken in ((0.188, False), (0.190, True)):
        run = greedy(CURVES["snailshell"], limits(), 2, mode="physical", safety=safety)
        assert (run.row("chord error").count > 0) == broken


def test_the_lowest_feed_is_kept_and_shortens_the_run():
    slow, fast = (greedy(CURVES["snailshell"], limits(), 3, mode="physical", min_feed=v) for v in (0.5, 3.0))
    for run, floor in ((slow, 0.5), (fast, 3.0)):
        assert np.all(run.feed >= np.minimum(floor, run.limit) * (1.0 - 1e-9))
        assert run.samples.start_feed == run.samples.end_feed == floor
    assert fast.duration < slow.duration


# ---- what a run reports ---------------------------------------------------------------------------------------------


# ---- stalls ---------------------------------------------------------------------------------------------------------


# ---- input ----------------------------------------------------------------------------------------------------------


# ---- the benchmark --------------------------------------------------------------------------------------------------


# ---- speed ----------------------------------------------------------------------------------------------------------

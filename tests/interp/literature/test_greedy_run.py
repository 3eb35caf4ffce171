"""What runs of the greedy algorithms report, where they stall, what they refuse, and their speed."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from greedy_cases import CURVES, CUSP, MADE, NAMES, REPAIRED, REST, greedy_limit, limits

from benchmarks import greedy as benchmark
from interp import greedy
from planner import load_curve
from planner.errors import InputError, StalledError
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits


@pytest.mark.parametrize("mode", ["compat", "physical"])
@pytest.mark.parametrize("algorithm", [1, 2, 4])
def test_violations_are_counted_and_located(mode, algorithm):
    curve, given = CURVES["hypotrochoid"], limits(period=2e-3)
    run = greedy(curve, given, algorithm, mode=mode, variant="root")
    q, period = curve.derivatives(run.u, 0)[0], given.period
    assert np.array_equal(q, run.samples.position)
    inner = curve.derivatives(run.u[:-1, None] + np.diff(run.u)[:, None] * np.arange(1, 20) / 20.0, 0)[0] - q[:-1, None]
    chord = np.diff(q, axis=0) / np.linalg.norm(np.diff(q, axis=0), axis=-1)[:, None]
    along = np.einsum("knj,kj->kn", inner, chord)
    errors = np.linalg.norm(inner - along[..., None] * chord[:, None], axis=-1).max(axis=-1)
    assert run.chord_error[:-1] == pytest.approx(errors, abs=1e-11)
    feed = np.linalg.norm(np.diff(q, axis=0), axis=-1) / period
    assert run.actual_feed[:-2] == pytest.approx(feed[:-1], rel=2e-3, abs=2e-3)
    lowest = np.minimum(20.0, greedy_limit(curve, run.u[:-1]))
    start = 0.5 if mode == "physical" else 0.0
    acceleration = np.diff(run.actual_feed, prepend=start) / period
    jerk = np.diff(acceleration, prepend=0.0) / period
    ends = slice(0, -1) if mode == "physical" else slice(None)
    expected = {
        "feed": np.flatnonzero(run.actual_feed[:-1] > lowest * (1 + 1e-8)),
        "chord error": np.flatnonzero(errors > 1e-6 * (1 + 1e-5)),
        "acceleration": np.flatnonzero(outside(curve, run, acceleration)[ends]),
        "jerk": np.flatnonzero(np.abs(jerk[ends]) > 200.0 * (1 + 2e-6)),
    }
    for limit, found in expected.items():
        row = run.row(limit)
        assert abs(row.count - found.size) <= 2, limit
        assert row.count == row.indices.size
        assert np.setxor1d(row.indices, found).size <= 2
        assert row.u == run.u[row.index]
        assert row.t == run.samples.t[row.index]
        if row.count:
            assert row.index in row.indices
            assert limit in str(row)
    assert run.row("chord error").worst == pytest.approx(errors.max(), abs=1e-11)
    assert run.row("feed").allowed == pytest.approx(lowest[run.row("feed").index], rel=1e-6)
    assert abs(run.row("jerk").worst) == pytest.approx(np.abs(jerk[ends]).max())
    assert run.violations == tuple(row for row in run.rows if row.count)


def outside(curve, run, acceleration):
    """Whether an axis exceeds 30 mm/s^2, from q'' = t A + n V^2, at the feed before each step."""
    _, first, _ = curve.derivatives(run.u, 2)
    tangent = first / np.linalg.norm(first, axis=-1)[:, None]
    second = np.gradient(tangent, axis=0)  # the direction of the normal
    side = np.sign(tangent[:, 0] * second[:, 1] - tangent[:, 1] * second[:, 0])
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) * (side * curve.curvature(run.u))[:, None]
    before = np.append(0.5 if run.mode == "physical" else 0.0, run.actual_feed[:-1])
    axes = tangent * acceleration[:, None] + normal * before[:, None] ** 2
    return np.abs(axes).max(axis=-1) > 30.0 * (1 + 2e-6)


def test_a_run_within_its_limits_reports_none():
    wide = Limits(2.0, [30.0] * 2, [1e6] * 2, [1e9] * 2, chord_error=1e-6)
    run = greedy(CURVES["teardrop"], wide, 3, mode="physical", safety=1.0)
    assert run.violations == ()
    assert [row.count for row in run.rows] == [0, 0, 0, 0]
    # One limit tightened below what the run does is found, and only that one.
    over = greedy(CURVES["teardrop"], replace_limit(wide, jerk=[1.0] * 2), 1, mode="physical", safety=1.0)
    assert [row.limit for row in over.violations] == ["jerk"]
    bent = greedy(CURVES["teardrop"], replace_limit(wide, chord_error=1e-9), 1, mode="physical", safety=1.0)
    assert [row.limit for row in bent.violations] == ["chord error"]


def replace_limit(given, **changes):
    names = ("velocity", "acceleration", "jerk", "chord_error", "period")
    return Limits(given.feed, **({name: getattr(given, name) for name in names} | changes))


def test_arrays_are_whole_and_frozen():
    run = greedy(CURVES["snailshell"], limits(), 3)
    m = run.u.size
    names = ("feed", "actual_feed", "limit", "chord_error", "controlled_error", "acceleration", "reported_acceleration")
    for name in names:
        array = getattr(run, name)
        assert array.shape == (m,)
        assert not array.flags.writeable
    assert run.acceleration_range.shape == (m, 2)
    assert (run.u[0], run.u[-1]) == CURVES["snailshell"].domain
    assert np.all(np.diff(run.u) > 0.0)
    assert run.duration == pytest.approx((m - 1) * 1e-3)
    with pytest.raises(InputError, match="limit = 'speed'"):
        run.row("speed")
    assert replace(run, n=1).n == 1


def test_progress_is_reported_up_to_the_end():
    heard = []
    greedy(CURVES["snailshell"], limits(), 4, progress=lambda message, share: heard.append((message, share)))
    assert len(heard) > 2
    assert all("Algorithm 4" in message for message, _ in heard)
    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize(
    ("name", "scale", "algorithm", "place", "words"),
    [
        ("snailshell", 0.01, 2, 0.2618 * 3.0 * pi, "second term of the Taylor step cancels the first"),
        ("butterfly", 0.01, 2, 0.0, "back-off exhausted"),
        ("hypotrochoid", 0.001, 2, 0.0, "back-off exhausted"),
        ("teardrop", 1e-4, 2, 0.0, "back-off exhausted"),
        ("teardrop", 1e-4, 1, 0.0, "exceeds 0.1 of the range"),
    ],
)
@pytest.mark.parametrize("error_curve", ["teardrop", "own"])
def test_a_curve_that_is_too_small_stalls(name, scale, algorithm, place, words, error_curve):
    if (name, algorithm, error_curve) == ("teardrop", 2, "own"):  # its own error asks for shorter steps than its size
        error_curve = "teardrop"
    curve = load_curve(name, scale=scale)
    begin = time.perf_counter()
    with pytest.raises(StalledError) as stalled:
        greedy(curve, limits(), algorithm, error_curve=error_curve)
    assert time.perf_counter() - begin < 1.0
    message = str(stalled.value)
    assert words in message
    assert "scale the curve up" in message
    assert name in message
    assert float(message.split("u = ")[1].split(",", maxsplit=1)[0]) == pytest.approx(place, abs=1e-3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_a_curve_that_is_large_enough_does_not(name, scale):
    for algorithm in (1, 2, 3):
        assert greedy(load_curve(name, scale=scale), limits(), algorithm, variant="theta").n > 700


@pytest.mark.parametrize("mode", ["compat", "physical"])
@pytest.mark.parametrize("algorithm", [1, 2, 3, 4])
def test_a_start_without_direction_stalls(mode, algorithm):
    with pytest.raises(StalledError, match=r"u = 0, step 0: \|C'\| = 0 .* a cusp.*split the curve there"):
        greedy(REST, limits(), algorithm, mode=mode)


def test_a_cusp_on_the_way_stalls():
    begin = time.perf_counter()
    for mode, algorithm in (("compat", 1), ("compat", 2), ("physical", 2), ("physical", 3)):
        with pytest.raises(StalledError, match=r"u = 0\.(49|50).*a cusp"):
            greedy(CUSP, limits(), algorithm, mode=mode, error_curve="own")
    assert time.perf_counter() - begin < 1.0


def test_a_straight_stretch_stops_the_push_up():
    line = NurbsCurve([[0, 0], [100, 50]], [0, 0, 1, 1], 1, name="line")
    for variant in ("theta", "root"):
        with pytest.raises(StalledError, match=r'straight and nothing stops the push-up, use mode="physical"'):
            greedy(line, limits(), 4, **REPAIRED, variant=variant)
        run = greedy(line, limits(), 4, mode="physical", variant=variant)
        assert run.row("feed").count == 0
        assert run.chord_error.max() < 1e-12


def test_the_number_of_steps_is_limited():
    with pytest.raises(StalledError, match="max_steps = 1000 points are not enough; raise max_steps"):
        greedy(CURVES["teardrop"], limits(), 1, max_steps=1000)
    n = greedy(CURVES["teardrop"], limits(), 2).n
    assert greedy(CURVES["teardrop"], limits(), 2, max_steps=n).n == n
    with pytest.raises(StalledError):
        greedy(CURVES["teardrop"], limits(), 2, max_steps=n - 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algorithm": 5}, "algorithm = 5 must be 1, 2, 3 or 4"),
        ({"algorithm": True}, "algorithm = True"),
        ({"mode": "real"}, "mode = 'real' must be 'compat' or 'physical'"),
        ({"variant": "fast"}, "variant = 'fast'"),
        ({"error_curve": "circle"}, "error_curve = 'circle' must be 'teardrop' or 'own'"),
        ({"mode": "physical", "error_curve": "teardrop"}, 'is a defect of mode "compat"'),
        ({"mode": "physical", "step_feed": "command"}, 'is a defect of mode "compat"'),
        ({"taylor": "second"}, "taylor = 'second'"),
        ({"braking": "late"}, "braking = 'late'"),
        ({"safety": 1.5}, r"safety = 1.5 must lie in \(0, 1\]"),
        ({"safety": -1.0}, "safety = -1.0"),
        ({"u_rise": 1.0}, "u_rise = 1.0"),
        ({"u_fall": 0.0}, "u_fall = 0.0"),
        ({"min_feed": np.inf}, "min_feed = inf must be finite"),
        ({"max_steps": 0}, "max_steps = 0 must be a whole number > 0"),
        ({"max_steps": 1.5}, "max_steps = 1.5"),
        ({"limits": limits(feed=np.inf)}, "feed = inf must be finite"),
        ({"limits": limits(chord_error=np.inf)}, "chord_error = inf must be finite for Algorithm 2"),
        ({"limits": Limits(20.0, [30.0] * 3, [30.0] * 3, [200.0] * 3, axes="UVW")}, "the limits have 3 axes"),
        ({"curve": load_curve("flank"), "limits": Limits(20.0, [30.0] * 5, [30.0] * 5, [200.0] * 5)}, "rotary axes"),
    ],
)
def test_what_is_not_allowed_is_named(changes, message):
    arguments = {"curve": CURVES["teardrop"], "limits": limits(), "algorithm": 2} | changes
    with pytest.raises(InputError, match=message):
        greedy(**arguments)


def test_limits_that_are_absent_do_not_bind():
    free = Limits(20.0, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
    for algorithm in (1, 2, 3, 4):
        run = greedy(CURVES["snailshell"], free, algorithm, mode="physical")
        assert run.violations == ()
        assert np.all(run.limit == 20.0)


def test_the_benchmark_times_only_runs_that_keep_the_tolerance(monkeypatch):
    monkeypatch.setattr(benchmark, "REPEATS", 1)
    rows = benchmark.speed_table(2000)
    assert [row["run"] for row in rows] == [label for label, *_ in benchmark.SPEED]
    assert all(row["points"] >= 2000 and row["seconds_per_million"] > 0.0 for row in rows)
    wrong = {"error_curve": "teardrop"}
    monkeypatch.setattr(benchmark, "greedy", lambda *a, **options: greedy(*a, **(options | wrong)))
    assert [row["seconds_per_million"] for row in benchmark.speed_table(2000)[1:]] == [None] * 5


def test_the_benchmark_prints_and_writes_what_was_found():
    shown = []
    rows = benchmark.published_table()
    benchmark.show_published(rows, shown.append)
    assert "9204 with a difference" in shown[1]
    assert [row["reproduced"] for row in rows] == [n for name in NAMES for n in MADE[name]]
    assert "snailshell" in json.dumps(rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "variant", "error_curve", "turns", "seconds"),
    [
        (1, "theta", "teardrop", 300, 2.0),
        (2, "theta", "teardrop", 300, 2.0),
        (2, "theta", "own", 100, 2.0),
        (3, "root", "own", 140, 10.0),
        (4, "root", "own", 145, 10.0),
    ],
)
def test_a_million_steps(algorithm, variant, error_curve, turns, seconds):
    """Processor time of a whole call, measurement included, for a million steps; the best of a few."""
    expressions = CURVES["hypotrochoid"].expressions
    curve = FormulaCurve(expressions, (0.0, 6.0 * pi * turns), name="many turns")
    assert curve.pieces.breaks.size > 0
    greedy(CURVES["hypotrochoid"], limits(), algorithm, variant=variant, error_curve=error_curve)
    best = np.inf
    for _ in range(5):
        begin = time.process_time()
        run = greedy(curve, limits(), algorithm, variant=variant, error_curve=error_curve, max_steps=2_000_000)
        best = min(best, time.process_time() - begin)
        if best / run.n * 1e6 <= seconds:
            break
    assert run.n > 950_000
    assert best / run.n * 1e6 <= seconds

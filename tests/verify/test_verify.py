"""The check against closed forms, what it refuses, and its report."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
from pathlib import Path

import cases
import numpy as np
import pytest
from check_plans import (
    AXIS_LIMITS,
    SINGLE_LIMITS,
    check,
    constant_feed,
    failing,
    lift,
    lowered,
    nodes_of,
    package,
    profile_on,
    sampled,
    scurve,
    unlimited,
    with_columns,
    with_lengths,
)

import planner.law
from planner import quantity
from planner.compiled import prototypes
from planner.errors import InputError
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.samples import Samples


def test_scurve_on_a_line_uses_each_limit_exactly(line, line_limits, line_plan):
    report = check(line, line_limits, line_plan)
    assert report.ok
    assert report.violations == ()
    for axis, share in (("X", 0.6), ("Y", 0.8)):
        for name, top in zip(AXIS_LIMITS, (100.0, 1000.0, 20000.0), strict=True):
            assert report.row(name, axis).worst == pytest.approx(share * top, rel=1e-12)
            assert report.row(name, axis).ratio == pytest.approx(1.0, rel=1e-12)
            assert report.row(name, axis).unit == ("mm/s", "mm/s^2", "mm/s^3")[AXIS_LIMITS.index(name)]
    for name in ("feed", "tangential acceleration", "tangential jerk"):
        assert report.row(name).ratio == pytest.approx(1.0, rel=1e-12)
    assert report.row("chord error").worst < 1e-13
    assert report.start_feed == report.end_feed == 0.0


def test_samples_of_an_scurve_on_a_line_reach_but_never_exceed_it(line, line_limits, line_plan):
    # 50 ms of constant jerk hold many periods, so the differences reach the limits, whatever the phase.
    for period in (1e-3, 0.73e-3):
        report = check(line, line_limits, sampled(line, line_plan, period))
        assert report.ok
        for name in AXIS_LIMITS:
            for axis in "XY":
                assert report.row(name, axis).ratio == pytest.approx(1.0, rel=1e-6)
        assert report.row("tangential jerk").ratio == pytest.approx(1.0, rel=1e-6)
        assert report.row("feed").ratio == pytest.approx(1.0, rel=1e-9)


def test_circle_at_constant_feed(circle):
    v, radius = 100.0, 50.0
    limits = Limits(v, [v] * 2, [v**2 / radius] * 2, [v**3 / radius**2] * 2, period=2e-3)
    profile = profile_on(circle, limits, lift(circle, constant_feed(circle, v, 1000)))
    report = check(circle, limits, profile)
    assert report.ok
    for axis in "XY":
        assert report.row("velocity", axis).worst == pytest.approx(v, rel=1e-11)
        assert report.row("acceleration", axis).worst == pytest.approx(v**2 / radius, rel=1e-9)
        assert report.row("jerk", axis).worst == pytest.approx(v**3 / radius**2, rel=1e-6)
        assert report.row("acceleration step", axis).worst < 1e-7
    half = radius * np.sin(0.5 * v * limits.period / radius)
    assert report.row("chord error").worst == pytest.approx(radius - np.sqrt(radius**2 - half**2), rel=1e-9, abs=0.0)
    assert report.row("tangential acceleration").worst < 1e-6
    assert report.start_feed == pytest.approx(v)
    assert report.end_feed == pytest.approx(v)


def test_circle_of_samples_at_constant_feed(circle):
    """A plan that starts and ends at speed: inside, the differences are those of a circle of known radius."""
    v, radius, count = 100.0, 50.0, 1000
    period = circle.length / v / count
    profile = profile_on(circle, unlimited(), lift(circle, constant_feed(circle, v, 1000)))
    samples = sampled(circle, profile, period)
    report = check(circle, unlimited(), samples)
    half = radius * np.sin(np.pi / count)
    assert report.row("feed").worst == pytest.approx(2.0 * half / period, rel=1e-10)
    assert report.row("chord error").worst == pytest.approx(radius - np.sqrt(radius**2 - half**2), rel=1e-8)
    assert report.start_feed == pytest.approx(v, rel=1e-5)
    # From a point that is held, the first period at speed v is an acceleration of v / T and a jerk of v / T^2.
    assert report.row("acceleration", "Y").worst == pytest.approx(v / period, rel=1e-4)
    assert report.row("jerk", "Y").worst == pytest.approx(v / period**2, rel=1e-2)


def test_ramp_on_a_circle_has_the_jerk_of_the_closed_form(circle):
    """On a circle s''' = j adds to -v^3/R^2 along the path, and 3 v a / R across it."""
    radius, limits = 50.0, unlimited()
    motion = scurve(circle.length, 80.0, 500.0, 8000.0, 120)
    t, s, v, a = motion
    knots = circle.arclength.s(circle._candidate_breaks())
    report = check(circle, limits, profile_on(circle, limits, lift(circle, with_lengths(motion, knots))))
    # dense closed form over the phases
    best = np.zeros((2, 2))
    for k in range(t.size - 1):
        j = (a[k + 1] - a[k]) / (t[k + 1] - t[k])
        w = np.linspace(0.0, t[k + 1] - t[k], 200)
        sk, vk, ak = s[k] + v[k] * w + a[k] * w**2 / 2 + j * w**3 / 6, v[k] + a[k] * w + j * w**2 / 2, a[k] + j * w
        angle = sk / radius
        along, across = np.stack([-np.sin(angle), np.cos(angle)]), np.stack([-np.cos(angle), -np.sin(angle)])
        best[0] = np.maximum(best[0], np.abs(ak * along + vk**2 / radius * across).max(axis=1))
        jerk = (j - vk**3 / radius**2) * along + 3.0 * vk * ak / radius * across
        best[1] = np.maximum(best[1], np.abs(jerk).max(axis=1))
    for j, axis in enumerate("XY"):
        assert report.row("acceleration", axis).worst == pytest.approx(best[0, j], rel=1e-5)
        assert report.row("jerk", axis).worst == pytest.approx(best[1, j], rel=1e-5)
    assert report.row("tangential jerk").worst == pytest.approx(8000.0, rel=1e-4)


def test_limits_that_are_absent_are_measured_all_the_same(ellipse, ellipse_plan):
    for plan in (ellipse_plan, sampled(ellipse, ellipse_plan, 1e-3)):
        report = check(ellipse, unlimited(), plan)
        assert report.ok
        for name in SINGLE_LIMITS:
            assert report.row(name).ratio == 0.0
            assert report.row(name).worst > 0.0
        for name in AXIS_LIMITS:
            assert report.row(name, "X").worst > 0.0


def test_a_plan_for_another_curve_is_refused(line, line_limits, line_plan, circle):
    with pytest.raises(InputError, match=r"made for another curve: line .* not circle"):
        check(circle, line_limits, line_plan)
    twin = NurbsCurve([[0.0, 0.0], [60.0, 80.0]], [0, 0, 1, 1], 1, name="the same line under another name")
    assert check(twin, line_limits, line_plan).ok


def test_a_curve_is_known_by_its_definition_which_the_same_object_has(monkeypatch, line, line_limits, line_plan):
    again = cases.line(60.0, 80.0)
    assert again is not line
    assert check(again, line_limits, line_plan) == check(line, line_limits, line_plan)
    asked = []
    monkeypatch.setattr(type(line), "fingerprint", property(asked.append))
    check(line, line_limits, line_plan)
    assert not asked


def test_arguments_are_validated(line, line_limits, line_plan):
    three = Limits(1.0, [1.0] * 3, [1.0] * 3, [1.0] * 3, axes="XZA")
    with pytest.raises(InputError, match="3 axes"):
        check(line, three, line_plan)
    for density in (3, 2.5, True):
        with pytest.raises(InputError, match="density"):
            check(line, line_limits, line_plan, density=density)
    for tolerance in (-1e-9, np.nan, np.inf):
        with pytest.raises(InputError, match="tolerance"):
            check(line, line_limits, line_plan, tolerance=tolerance)
    with pytest.raises(InputError, match="dict"):
        check(line, line_limits, {})
    samples = sampled(line, line_plan, 1e-3)
    with pytest.raises(InputError, match=r"shape \(1151, 3\)"):
        check(line, line_limits, Samples(1e-3, samples.t, samples.u, np.zeros((samples.t.size, 3))))
    with pytest.raises(InputError, match="m >= 2"):
        check(line, line_limits, Samples(1e-3, samples.t[:1], samples.u[:1], samples.position[:1]))
    with pytest.raises(InputError, match="period = 0"):
        check(line, line_limits, Samples(0.0, samples.t, samples.u, samples.position))
    with pytest.raises(InputError, match="must be one-dimensional, equal"):
        check(line, line_limits, with_columns(line_plan, u=line_plan.u[1:]))
    with pytest.raises(InputError, match='no row "jerk" for the axis "Z"'):
        check(line, line_limits, line_plan).row("jerk", "Z")


@pytest.mark.parametrize(
    ("name", "column", "index", "value"),
    [
        ("finite values", "u_rate", 3, np.nan),
        ("finite values", "t", 0, -np.inf),
        ("time order", "t", 3, 0.05),
        ("time order", "t", 0, -0.01),
        ("path start", "u", 0, 1e-9),
        ("path end", "u", -1, 1.0 - 1e-9),
        ("reversal", "u_rate", 3, -1e-3),
        ("table columns", "s", 4, 90.0),
        ("table columns", "feed", 4, 100.0 * (1 + 1e-8)),
        ("table columns", "acceleration", 4, 1.0),
        ("table columns", "jerk", 4, 1.0),
        ("binding limit", "binding", 4, 2),
        ("binding limit", "binding", 4, -1),
        ("binding limit", "binding", 4, 100),
    ],
)
def test_a_defective_table_is_found(line, line_limits, line_plan, name, column, index, value):
    broken = getattr(line_plan, column).copy()
    broken[index] = value
    report = check(line, line_limits, with_columns(line_plan, **{column: broken}))
    assert (name, "") in failing(report)
    if name in ("table columns", "binding limit"):
        assert failing(report) == {(name, "")}
        assert report.row(name).t == line_plan.t[4]


def test_a_jump_of_position_is_found(ellipse, ellipse_plan):
    k = 100
    nodes = [np.insert(column, k, column[k]) for column in nodes_of(ellipse_plan)]
    nodes[1][k] -= 1e-6
    row = check(ellipse, unlimited(), profile_on(ellipse, unlimited(), nodes)).row("position step")
    assert not row.ok
    assert row.worst == pytest.approx(1e-6 * ellipse.length / (2 * np.pi), rel=1e-6)
    assert row.t == nodes[0][k]


def test_standing_still_on_a_closed_curve_is_not_a_plan(ellipse):
    """Start and end of a closed curve are one point; the whole of the path is still missing."""
    t = np.arange(5) * 1e-3
    still = Samples(1e-3, t, np.zeros(5), ellipse.derivatives(np.zeros(5), 0)[0])
    assert ("path end", "") in failing(check(ellipse, unlimited(), still))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("sample times", lambda s: dataclasses.replace(s, t=s.t + np.where(np.arange(s.t.size) == 7, 1e-9, 0.0))),
        ("sample times", lambda s: dataclasses.replace(s, t=s.t * (1 + 1e-9))),
        ("path end", lambda s: dataclasses.replace(s, t=s.t[:-1], u=s.u[:-1], position=s.position[:-1])),
        ("path end", lambda s: dataclasses.replace(s, position=s.position + np.where(s.u == 1.0, 1e-12, 0.0)[:, None])),
        (
            "path start",
            lambda s: dataclasses.replace(s, position=s.position + np.where(s.u == 0.0, 1e-12, 0.0)[:, None]),
        ),
        ("finite values", lambda s: dataclasses.replace(s, u=np.where(np.arange(s.t.size) == 7, np.nan, s.u))),
        ("reversal", lambda s: dataclasses.replace(s, u=np.where(np.arange(s.t.size) == 600, s.u[598], s.u))),
    ],
)
def test_defective_samples_are_found(line, line_limits, line_plan, name, change):
    # 1.1505 s is no whole number of periods; the end point is reached within the last one.
    samples = sampled(line, line_plan, 1.1e-3)
    assert check(line, line_limits, samples).ok
    assert (name, "") in failing(check(line, line_limits, change(samples)))


def test_rounding_is_granted_and_no_more(line, line_limits, line_plan):
    """At 0.1 ms an error of 8e-12 mm already is a jerk of 8e-12 * 3 / 1e-12 mm/s^3; rounding is far below."""
    samples = sampled(line, line_plan, 1e-4)
    report = check(line, line_limits, samples)
    assert report.ok
    assert 0.0 < report.row("jerk", "X").slack < 0.3
    position = samples.position.copy()
    position[int(0.03 / 1e-4), 0] += 8e-12
    assert ("jerk", "X") in failing(check(line, line_limits, Samples(1e-4, samples.t, samples.u, position)))


def test_nodes_closer_than_double_precision_resolves_are_granted_their_rounding(circle):
    """Nodes a rounding apart: their interval holds any jerk, none of which a machine could see."""
    v = 100.0
    motion = constant_feed(circle, v, 1000)
    s = np.sort(np.append(motion[1], np.nextafter(motion[1, 501], np.inf)))
    t = s / v
    keep = np.append(True, np.diff(t) > 0.0)
    assert np.diff(t[keep]).min() < 1e-15
    nodes = lift(circle, np.stack([t, s, np.full(s.size, v), np.zeros(s.size)])[:, keep])
    limits = Limits(v, [v] * 2, [v**2 / 50.0] * 2, [v**3 / 2500.0 * (1 + 1e-6)] * 2)
    report = check(circle, limits, profile_on(circle, limits, nodes))
    assert report.ok
    assert report.row("acceleration step", "X").slack < 1e-3


def test_the_last_digit_of_the_time_counts_where_that_of_the_parameter_does_not():
    """Near u = 0 a table holds u to any precision, but not the times that belong to it."""
    curve = FormulaCurve({"X": "50*cos(u)", "Y": "50*sin(u)"}, (-np.pi, np.pi))
    close = np.array([-2e-6, -1e-6, 1e-6, 2e-6])
    u = np.concatenate([np.linspace(-np.pi, -0.01, 300), close, np.linspace(0.01, np.pi, 300)])
    limits = Limits(50.0, [50.0] * 2, [50.0] * 2, [50.0] * 2)
    nodes = (u + np.pi, u, np.ones(u.size), np.zeros(u.size))
    profile = profile_on(curve, limits, nodes)
    assert 50.0 * np.abs(profile.at(np.pi + close[:-1] + 1e-7).u_jerk).max() > 1000.0
    report = check(curve, limits, profile)
    assert report.ok
    assert report.row("jerk", "Y").worst == pytest.approx(50.0, rel=1e-6)


def test_report_reads_as_a_table(line, line_limits, line_plan):
    good = str(check(line, line_limits, line_plan))
    assert good.startswith("every limit holds")
    assert "FAILS" not in good
    slow = lowered(line_limits, "jerk", 1, 0.5)
    bad = str(check(line, slow, line_plan))
    assert bad.startswith("1 of ")
    (marked,) = [text for text in bad.splitlines() if text.startswith("FAILS")]
    assert "jerk Y" in marked
    assert "mm/s^3" in marked


def test_report_and_rows_are_frozen(line, line_limits, line_plan):
    report = check(line, line_limits, line_plan)
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.rows = ()
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.rows[0].worst = 0.0
    keys = [(row.limit, row.axis) for row in report.rows]
    assert len(keys) == len(set(keys))


def test_the_check_knows_nothing_of_the_planner():
    files = sorted(Path(inspect.getfile(package)).parent.rglob("*.py"))
    assert {"__init__", "between_nodes", "chords", "differences", "findings", "motion"} <= {file.stem for file in files}
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))]
    imported = {
        f"{node.module}.{name.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for name in node.names
        if node.level > 0 or (node.module or "").startswith("planner")
    }
    # planner.quantity is a table of names and orders: see that it cannot hold a formula.
    shared = {name for name in imported if not name.startswith(("planner.verify.", "planner.quantity."))}
    assert "numpy" not in Path(quantity.__file__).read_text(encoding="utf-8")
    assert shared == {
        "planner.certificate.Certificate",
        "planner.compiled.core",  # of which only what its own header declares, see below
        "planner.certificate.CertificateSection",
        "planner.errors.InputError",
        "planner.geometry.curve.Curve",
        "planner.frames.Tabular",  # how a report shows itself
        "planner.gauss.gauss_legendre",  # a table of numbers, held by test_gauss.py
        "planner.sets.union",  # numbers in order, held by test_sets.py
        "planner.geometry.curve.FeedCaps",
        "planner.types.BoolArray",
        "planner.types.FloatArray",
        "planner.types.IntArray",
        # held by oracles of their own, tests/geometry/test_differential.py and test_chord.py
        "planner.geometry.chord.distance_to_chord",
        *(f"planner.geometry.differential.{name}" for name in ("curvature", "dot", "norm")),
        "planner.inputs.require_instance",
        "planner.machine.limits.Limits",
        "planner.machine.limits.require_limits",
        "planner.profile.BINDING_SHARE",  # what a table means by the limit that holds
        "planner.profile.FeedrateProfile",
        "planner.samples.Samples",
    }
    assert not [node for node in nodes if isinstance(node, ast.Import) and "planner" in ast.dump(node)]
    room = Path(inspect.getfile(package)).parent
    called = {
        name for file in files for name in re.findall(r"\bcore\.(\w+)(?:\.bind)?\(", file.read_text(encoding="utf-8"))
    }
    assert called == set(prototypes((room / "verify.h").read_text(encoding="utf-8")))
    source = "".join(file.read_text(encoding="utf-8") for file in room.rglob("*.[ch]"))
    included = {name for name in re.findall('#include "(.*)"', source) if not name.startswith("planner/verify/")}
    assert included == {
        "planner/core.h",
        "planner/geometry/curve_inline.h",  # find_piece, a bisection
        "planner/geometry/differential_inline.h",  # the chain rule, held by test_differential.py
    }


def test_types_are_what_they_say(line, line_limits, line_plan):
    for row in check(line, line_limits, line_plan).rows:
        for field in ("worst", "allowed", "ratio", "t", "u", "slack"):
            assert type(getattr(row, field)) is float
        assert type(row.ok) is bool


@pytest.mark.parametrize("allowed", [1e-9, 1e-3])
def test_chords_that_cannot_be_the_highest_are_left_out_and_change_nothing(monkeypatch, allowed):
    """Samples of 0.01 to 0.3 steps on an ellipse: the highest chord is that of looking at them all."""
    chords = importlib.import_module("planner.verify.chords")
    ellipse = FormulaCurve({"X": "30*cos(u)", "Y": "3*sin(u)"}, (0.0, 2.0 * np.pi))
    u = np.concatenate([[0.0], np.cumsum(np.random.default_rng(4).uniform(0.01, 0.3, 60_000))])
    u = u / u[-1] * 2.0 * np.pi
    samples = Samples(1e-3, 1e-3 * np.arange(u.size), u, ellipse.derivatives(u, 0)[0])
    looked_at = []
    heights = chords._heights
    monkeypatch.setattr(chords, "_heights", lambda *given: looked_at.append(given[1][1]) or heights(*given))
    found = chords.sample_chord(ellipse, samples, u, 24, allowed=allowed, rounding=1e-14)
    assert sum(looked_at) < 0.2 * u.size
    monkeypatch.setattr(chords, "_within", lambda _curve, u, _rounding: np.full(u.size - 1, np.inf))
    assert chords.sample_chord(ellipse, samples, u, 24, allowed=allowed, rounding=1e-14) == found
    assert sum(looked_at) > u.size


def spiked_line(width, times):
    """A line on which the jerk J = 20000 mm/s^3 is ``times`` J for ``width`` s; its nodes are exact but for rounding."""
    steps = [(0.02, 1.0), (0.02, -1.0), (0.01, 0.5), (width, times), (0.01, 0.5), (0.02, -0.5)]
    h = np.array([step for step, _ in steps])
    jerk = 20000.0 * np.array([share for _, share in steps])
    state = np.zeros((3, h.size + 1))
    for k in range(h.size):
        s, v, a = state[:, k]
        state[:, k + 1] = (
            s + h[k] * (v + h[k] * (a / 2.0 + h[k] * jerk[k] / 6.0)),
            v + h[k] * (a + h[k] * jerk[k] / 2.0),
            a + h[k] * jerk[k],
        )
    length = float(state[0, -1])
    curve = NurbsCurve([[0.0, 0.0], [length, 0.0]], [0, 0, 1, 1], 1)
    inf = [np.inf, np.inf]
    limits = Limits(np.inf, inf, inf, [20000.0, 20000.0])
    return curve, limits, (np.concatenate([[0.0], np.cumsum(h)]), *(state / length))


@pytest.mark.parametrize("width", [1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize(("times", "holds"), [(0.5, True), (0.99, True), (1.01, False), (10.0, False), (-10.0, False)])
def test_digits_do_not_hide_a_spike_of_the_jerk(width, times, holds):
    curve, limits, nodes = spiked_line(width, times)
    row = check(curve, limits, profile_on(curve, limits, nodes)).row("jerk", "X")
    assert row.ok is holds


def test_the_check_evaluates_the_law_by_itself(ellipse, ellipse_plan, used_up, monkeypatch):
    """It takes nodes from a plan: no formula of the law between them is the planner's."""
    expected = check(ellipse, used_up["profile"], ellipse_plan)

    def broken(*_):
        raise AssertionError("the check asked the planner")

    for name in ("at", "coefficients", "dilated", "only", "joined", "forward_at_stops"):
        monkeypatch.setattr(TimeLaw, name, broken)
    monkeypatch.setattr(planner.law, "quintic_coefficients", broken)
    assert check(ellipse, used_up["profile"], ellipse_plan) == expected
    with pytest.raises(AssertionError, match="asked the planner"):
        ellipse_plan.at(0.0)

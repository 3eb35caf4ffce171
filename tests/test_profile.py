"""The profile as a function of time, and the limit that it names at each node."""

from __future__ import annotations

import html
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cases import MILL, line_arc_line, mill, square
from profile_reference import binding_at_nodes

from planner import (
    FeedrateProfile,
    InputError,
    Limits,
    check,
    load_curve,
    load_limits,
    plan_feedrate,
    write_table,
)
from planner.geometry.curve import Curve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.output.table import write_samples
from planner.profile import make_profile
from planner.samples import Samples

LINE = NurbsCurve([[0.0, 0.0], [40.0, 30.0]], [0, 0, 50, 50], 1)


def law_of(*coefficients: float) -> TimeLaw:
    """Twenty-one nodes, over one second, of a polynomial u(t) from 0 to 50 with these coefficients from t on."""
    p = np.polynomial.Polynomial([0.0, *coefficients]) * (50.0 / sum(coefficients))
    t = np.linspace(0.0, 1.0, 21)
    u = p(t)
    u[-1] = 50.0
    return TimeLaw(t, u, p.deriv(1)(t), p.deriv(2)(t))


def named(curve: Curve, limits: Limits, nodes: TimeLaw, slowed: float | None = None) -> list[str]:
    if slowed is not None:
        nodes = nodes.dilated(slowed)
    factors = None if slowed is None else np.full(nodes.t.size, slowed)
    profile = make_profile(curve, limits, nodes, method="given", slowed=factors)
    return [profile.limit_names[k] for k in profile.binding]


def limits_with(**changes: object) -> Limits:
    free = [np.inf] * 2
    return Limits(**({"feed": np.inf, "velocity": free, "acceleration": free, "jerk": free} | changes))  # type: ignore[arg-type]


# u = 50 (t + t^2 + t^3) / 3 along a line at 3-4-5: rates at the end 100, 133.3 and 100 mm/s, mm/s^2 and mm/s^3
CASES = {
    "feed": {"feed": 100.0},
    "velocity X": {"velocity": [80.0, np.inf]},
    "velocity Y": {"velocity": [np.inf, 60.0]},
    "acceleration X": {"acceleration": [400.0 / 3.0 * 0.8, np.inf]},
    "acceleration Y": {"acceleration": [np.inf, 400.0 / 3.0 * 0.6]},
    "jerk X": {"jerk": [80.0, np.inf]},
    "jerk Y": {"jerk": [np.inf, 60.0]},
    "tangential acceleration": {"tangential_acceleration": 400.0 / 3.0},
    "tangential jerk": {"tangential_jerk": 100.0},
}


@pytest.mark.parametrize("slowed", [None, 1.1])
@pytest.mark.parametrize("name", CASES)
def test_what_is_used_up_to_half_a_percent_binds_slowed_down_or_not(name: str, slowed: float | None) -> None:
    nodes = law_of(1.0, 1.0, 1.0)
    everywhere = "jerk" in name
    for share, binds in ((0.9945, False), (0.9955, True)):
        changes = {key: np.asarray(value) / share for key, value in CASES[name].items()}
        found = named(LINE, limits_with(**changes), nodes, slowed)
        assert found[-1] == (name if binds else "none")
        assert set(found[:-1]) == ({name} if binds and everywhere else {"none"})


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_on_a_bent_path_the_motion_of_each_axis_decides(order: int, axis: int) -> None:
    """X = 6 u^2 - u, Y = 9 u - 2 u^3 run by u = 5 t (1 + t): polynomials in t, and what binds is read off them."""
    u = np.polynomial.Polynomial([0.0, 5.0, 5.0])
    motion = (6.0 * u**2 - u, 9.0 * u - 2.0 * u**3)[axis]
    curve = FormulaCurve({"X": "6*u**2-u", "Y": "9*u-2*u**3"}, (0.0, 10.0))
    t = np.linspace(0.0, 1.0, 31)
    nodes = TimeLaw(t, u(t), u.deriv(1)(t), u.deriv(2)(t))
    kind = ("velocity", "acceleration", "jerk")[order - 1]
    share = np.abs(motion.deriv(order)(t))
    for k in (3, 11, 17, 30):
        allowed = [np.inf, np.inf]
        allowed[axis] = share[k] / 0.9951
        found = named(curve, limits_with(**{kind: allowed}), nodes)
        assert found == [f"{kind} {'XY'[axis]}" if s > 0.995 * allowed[axis] else "none" for s in share]


@pytest.mark.parametrize("slowed", [None, 1.1])
def test_the_chord_error_binds_slowed_down_or_not(slowed: float | None) -> None:
    circle = load_curve("circle")  # radius 50 mm
    t = np.linspace(0.0, circle.length / 80.0, 41)
    u = circle.arclength.u(80.0 * t)
    u[0], u[-1] = circle.domain
    speed = np.sqrt(np.sum(circle.derivatives(u, 1)[1] ** 2, axis=-1))
    nodes = TimeLaw(t, u, 80.0 / speed, np.zeros(41))
    for share, binds in ((0.994, False), (0.996, True)):
        half = 0.5 * 80.0 / share * 1e-3
        limits = limits_with(chord_error=50.0 - np.sqrt(50.0**2 - half**2))
        assert set(named(circle, limits, nodes, slowed)) == {"chord error" if binds else "none"}


def test_of_several_limits_the_one_used_most_is_named() -> None:
    limits = limits_with(feed=100.0 / 0.997, velocity=[80.0 / 0.999, 60.0 / 0.998], tangential_jerk=100.0 / 0.996)
    found = named(LINE, limits, law_of(1.0, 1.0, 1.0))
    assert found == [*["tangential jerk"] * 20, "velocity X"]


def test_shares_are_those_of_the_time_nearest_to_a_node() -> None:
    nodes = law_of(1.0, 1.0, 1.0)
    profile = make_profile(LINE, limits_with(), nodes, method="given")
    binding = np.array([1] * 5 + [2] * 10 + [0] * 6, dtype=np.int8)
    found = FeedrateProfile(**(vars(profile) | {"binding": binding})).shares()
    assert list(found) == [profile.limit_names[k] for k in (2, 0, 1)]
    assert list(found.values()) == pytest.approx([0.5, 0.275, 0.225])


def test_a_time_outside_of_a_plan_is_named() -> None:
    nodes = law_of(1.0)
    profile = make_profile(LINE, limits_with(), nodes, method="given")
    assert profile.at([0.0, 1.0]).u.tolist() == [0.0, 50.0]
    for outside, first in (([0.5, -0.1, 2.0], "-0.1"), ([1.5], "1.5"), ([np.nan], "nan")):
        with pytest.raises(InputError, match=rf"t = {first} must lie within \[0, 1\.0\]"):
            profile.at(outside)


def test_a_double_node_holds_either_side_of_a_break() -> None:
    """A corner at u = 1 where |C'| doubles: the left node reads the first leg, the right one the second."""
    bent = NurbsCurve([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]], [0, 0, 1, 2, 2], 1)
    t, u = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0, 2.0])
    profile = make_profile(
        bent, limits_with(), TimeLaw(t, u, np.array([0.5, 1.5, 1.5, 0.5]), np.zeros(4)), method="given"
    )
    assert profile.feed.tolist() == [0.5, 1.5, 3.0, 1.0]
    # the jerk of the interval after a node; before a break and at the end, of the one before
    inner = 6.0 * (10.0 * (1.0 - 0.5) - 4.0 * 1.0)
    assert profile.jerk == pytest.approx([inner, -inner, -2.0 * inner, 2.0 * inner], rel=1e-12)


def test_the_jerk_at_nodes_is_that_of_the_law_to_the_last_one() -> None:
    """A polynomial of the fifth degree is its own quintic; at 3-4-5 the arc length is u."""
    nodes = law_of(1.0, -2.0, 3.0, 1.0, -0.5)
    p = np.polynomial.Polynomial([0.0, 1.0, -2.0, 3.0, 1.0, -0.5]) * (50.0 / 2.5)
    profile = make_profile(LINE, limits_with(), nodes, method="given")
    assert profile.jerk == pytest.approx(p.deriv(3)(nodes.t), rel=1e-8)
    assert profile.at(profile.t).jerk == pytest.approx(profile.jerk, rel=1e-12)


def test_where_the_tip_rests_and_other_axes_move_it_has_no_motion() -> None:
    points = [[0.0, 0.0], [0.0, 1.0], [0.0, 3.0], [0.0, 4.0]]
    turn = NurbsCurve(points, [0, 0, 0, 0, 1, 1, 1, 1], 3, axes=["X", "A"])
    t = np.linspace(0.0, 1.0, 11)
    limits = Limits(100.0, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2, axes=["X", "A"])
    u = np.polynomial.Polynomial([0.0, 0.2, 0.8])
    profile = make_profile(turn, limits, TimeLaw(t, u(t), u.deriv(1)(t), u.deriv(2)(t)), method="given")
    states = profile.at(np.linspace(0.0, 1.0, 37))
    for motion in (profile, states):
        assert not np.any([motion.s, motion.feed, motion.acceleration, motion.jerk])
    assert profile.u_rate.min() > 0.0


def test_what_was_planned_cannot_be_written_over() -> None:
    nodes = law_of(1.0)
    profile = make_profile(LINE, limits_with(), nodes, method="given")
    samples = Samples(0.5, np.array([0.0, 0.5, 1.0]), np.array([0.0, 25.0, 50.0]), np.zeros((3, 2)))
    columns = [profile.t, profile.u, profile.u_rate, profile.u_acceleration, profile.s, profile.feed]
    columns += [profile.acceleration, profile.jerk, profile.binding, samples.t, samples.u, samples.position]
    for column in columns:
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 1.0


def test_a_plan_is_called_like_a_function() -> None:
    profile = make_profile(LINE, limits_with(), law_of(1.0, -2.0, 3.0), method="given")
    times = np.linspace(0.0, profile.duration, 7).reshape(7, 1)
    called, at = profile(times), profile.at(times)
    assert all(np.array_equal(getattr(called, name), getattr(at, name)) for name in vars(at))
    assert called.feed.shape == (7, 1)
    assert float(profile(0.5).u) == float(profile.at(0.5).u)


def plan_of_two_axes() -> FeedrateProfile:
    return make_profile(LINE, limits_with(), law_of(1.0, -2.0, 3.0), method="given", lower_bound=0.5)


def test_a_plan_and_samples_are_tables_with_the_columns_of_their_files(tmp_path: Path) -> None:
    """To pandas as to a loop: one row a node, or a sample, under the names that the files give them."""
    pd = pytest.importorskip("pandas")
    profile = plan_of_two_axes()
    samples = Samples(0.5, np.array([0.0, 0.5, 1.0]), np.array([0.0, 25.0, 50.0]), np.arange(6.0).reshape(3, 2))
    write_table(tmp_path / "t.csv", profile, limits_with())
    write_samples(tmp_path / "s.csv", LINE, samples, check(LINE, limits_with(), samples))
    for table, name in ((profile, "t.csv"), (samples, "s.csv")):
        file = pd.read_csv(tmp_path / name, comment="#")
        for frame in (table.to_frame(), pd.DataFrame(table)):
            pd.testing.assert_frame_equal(frame, file, check_dtype=False, rtol=1e-12, atol=0.0)
            assert len(frame) == len(table)
    assert [row.binding for row in profile] == [profile.limit_names[k] for k in profile.binding]
    assert profile.nodes == len(profile) == len(list(profile))


def test_columns_are_made_a_frame_where_pandas_is_and_a_dict_where_it_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    profile, asked = plan_of_two_axes(), []
    monkeypatch.setitem(
        sys.modules, "pandas", SimpleNamespace(DataFrame=lambda columns: asked.append(columns) or "frame")
    )
    assert profile.to_frame() == "frame"
    monkeypatch.setitem(sys.modules, "pandas", None)
    plain = profile.to_frame()
    assert type(plain) is dict
    assert list(plain) == list(asked[0])
    assert plain["X_mm"] == pytest.approx(0.8 * profile.u, rel=1e-12)
    assert np.array_equal(plain["feed_mm_s"], profile.feed)


def test_a_plan_and_samples_are_shown_in_two_lines() -> None:
    profile = plan_of_two_axes()
    nasty = NurbsCurve([[0.0, 0.0], [40.0, 30.0]], [0, 0, 50, 50], 1, name="<b>" * 300)
    long = replace(profile, curve=nasty, method="m" * 500, notes=("a note",) * 9)
    samples = Samples(1e-3, 1e-3 * np.arange(1000), np.linspace(0.0, 50.0, 1000), np.zeros((1000, 2)))
    for shown in (profile, replace(profile, lower_bound=np.nan), samples):
        lines = repr(shown).splitlines()
        assert len(lines) == 2
        assert all(len(line) <= 100 for line in lines)
        assert html.escape(lines[0]) in shown._repr_html_()
    assert len(repr(long).splitlines()) == 2
    assert "<b>" not in long._repr_html_()
    assert repr(profile) == (
        "FeedrateProfile of nurbs: 1 s, 21 nodes, method given, feasible\n"
        "    lower bound 0.5 s, computed with the plan; 0 notes"
    )
    assert "lower bound there is none" not in repr(replace(profile, lower_bound=np.nan))
    assert repr(samples).startswith("Samples: 1000, one every 1 ms until 0.999 s, of X Y\n")


NODES = {
    "teardrop": (lambda: load_curve("teardrop"), MILL, {}),
    "feed, chord and tangential limits": (
        lambda: load_curve("butterfly", scale=10.0),
        mill(300.0, chord_error=1e-4, tangential_acceleration=700.0, tangential_jerk=9e3),
        {},
    ),
    "double nodes at stops": (lambda: square(10.0), MILL, {}),
    "curvature jumps": (line_arc_line, MILL, {}),
    "five axes": (lambda: load_curve("flank"), load_limits("five-axis"), {}),
    "no jerk limit": (lambda: load_curve("teardrop"), Limits(100.0, [250] * 2, [900] * 2, [np.inf] * 2), {}),
}


@pytest.mark.parametrize("case", NODES)
def test_what_binds_is_what_arrays_say(case):
    make, limits, options = NODES[case]
    curve = make()
    law = plan_feedrate(curve, limits, intervals=120, **options).law
    for slowed in (None, np.linspace(1.0, 1.3, law.t.size)):
        profile = make_profile(curve, limits, law, method="given", slowed=slowed)
        along, names = binding_at_nodes(curve, limits, law, np.ones(law.t.size) if slowed is None else slowed)
        found = np.stack([profile.feed, profile.acceleration, profile.jerk])
        if curve.dim == 2:
            np.testing.assert_array_equal(found, along)
        else:  # sums of three products and more, in another order
            assert (np.abs(found - along) <= 1e-12 * np.abs(along).max(axis=1, keepdims=True)).all()
        assert [profile.limit_names[k] for k in profile.binding] == names
        assert len(set(names)) > 1


def test_a_share_that_is_no_number_is_named():
    """As by argmax: a defect is not passed over."""
    law = law_of(1.0, -2.0, 3.0)
    rate = law.u_rate.copy()
    rate[4] = np.nan
    broken = TimeLaw(law.t, law.u, rate, law.u_acceleration)
    profile = make_profile(LINE, limits_with(), broken, method="given")
    names = binding_at_nodes(LINE, limits_with(), broken, np.ones(law.t.size))[1]
    assert [profile.limit_names[k] for k in profile.binding] == names
    assert names[4] != "none"

"""Machine limits: the four feedrate limits against closed forms, and machine files, good and bad."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import nurbs_curves

from planner import CurveError, FeedrateLimits, InputError, Limits, feedrate_limits, load_curve, load_limits
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import chord_feed_limit
from planner.machine.machine_file import EXAMPLE_MACHINES

PLAIN = {"feed": 100, "velocity": [250, 200], "acceleration": [1000, 800], "jerk": [2e4, 1e4]}


def limits(**changes):
    return Limits(**(PLAIN | changes))


class TestLimits:
    def test_defaults_and_types(self):
        plain = limits()
        assert (plain.feed, plain.chord_error, plain.period) == (100.0, np.inf, 1e-3)
        assert (plain.tangential_acceleration, plain.tangential_jerk) == (np.inf, np.inf)
        assert (plain.dim, plain.axes) == (2, ("X", "Y"))
        assert plain.velocity.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            plain.velocity[0] = 1.0
        with pytest.raises(AttributeError):
            plain.feed = 5.0

    def test_infinity_means_no_limit(self):
        free = limits(
            feed=np.inf, velocity=[np.inf, 5], acceleration=[np.inf] * 2, jerk=[1, np.inf], chord_error=np.inf
        )
        assert free.velocity.tolist() == [np.inf, 5.0]

    @pytest.mark.parametrize("key", ["feed", "chord_error", "period", "tangential_acceleration", "tangential_jerk"])
    @pytest.mark.parametrize("value", [0, -1.0, np.nan, -np.inf, "5", None, True, [1.0], 1j, 10**400])
    def test_single_values_are_positive_numbers(self, key, value):
        with pytest.raises(InputError, match=f"{key} = .* must be a number > 0"):
            limits(**{key: value})

    def test_period_is_finite(self):
        with pytest.raises(InputError, match="period = inf must be finite"):
            limits(period=np.inf)

    @pytest.mark.parametrize("key", ["velocity", "acceleration", "jerk"])
    @pytest.mark.parametrize(
        ("value", "message"),
        [
            ([1, 0], r"\[1\] = 0.0 must be > 0; use inf for no limit"),
            ([-5, 1], r"\[0\] = -5.0 must be > 0; use inf for no limit"),
            ([1, np.nan], r"\[1\] = nan must be > 0"),
            ([], "must be a sequence"),
            (0, " = 0.0 must be > 0; use inf for no limit"),
            (np.float64(-5), " = -5.0 must be > 0; use inf for no limit"),
            (np.nan, " = nan must be > 0"),
            (True, "True is not a number"),
            ([[1, 2]], "must be a sequence"),
            (["1", 2], "'1' is not a number"),
            ("12", "'12' is not a number"),
            ([True, 1], "True is not a number"),
            ([1, None], "None is not a number"),
            (None, "None is not a number"),
            ([1, [2]], "not a number|differ in length"),
            ([1, 10**400], "too large"),
        ],
    )
    def test_axis_values_are_positive_numbers(self, key, value, message):
        with pytest.raises(InputError, match=rf"^{key}.*{message}"):
            limits(**{key: value})

    @pytest.mark.parametrize("key", ["velocity", "acceleration", "jerk"])
    def test_one_value_for_every_axis(self, key):
        with pytest.raises(InputError, match="each needs one for every axis"):
            limits(**{key: [1.0, 2.0, 3.0]})

    def test_one_number_holds_for_every_axis(self):
        spread = Limits(100, velocity=250, acceleration=1000.0, jerk=np.float64(2e4), axes=["X", "Z"])
        assert spread == limits(velocity=[250] * 2, acceleration=[1000] * 2, jerk=[2e4] * 2, axes=["X", "Z"])
        assert limits(velocity=250) == limits(velocity=[250, 250])
        mixed = limits(jerk=np.inf)
        assert (mixed.axes, mixed.jerk.tolist()) == (("X", "Y"), [np.inf, np.inf])

    def test_numbers_without_axes_take_those_of_the_curve(self):
        scalar = Limits(100, 250, 1000, 2e4, chord_error=1e-3)
        assert (scalar.dim, scalar.axes) == (0, ())
        for curve in (load_curve("circle"), FormulaCurve({"Z": "u", "X": "u**2", "Y": "u"}, (0.0, 1.0))):
            per_axis = [[value] * curve.dim for value in (250.0, 1000.0, 2e4)]
            wanted = Limits(100, *per_axis, chord_error=1e-3, axes=curve.axes)
            assert scalar.for_curve(curve) == scalar.on(curve) == wanted
        assert scalar.with_feed(7.0).without_jerk().on(curve) == wanted.with_feed(7.0).without_jerk()
        u = np.linspace(0.0, 1.0, 9)
        np.testing.assert_array_equal(
            feedrate_limits(curve, scalar, u).lowest, feedrate_limits(curve, wanted, u).lowest
        )

    def test_one_number_is_no_limit_of_an_axis_that_turns(self):
        flank = load_curve("flank")
        for key in ("velocity", "acceleration", "jerk"):
            with pytest.raises(
                InputError, match=rf"{key} = 5 is one number for every axis, but A turns .* X, Y, Z, A, C"
            ):
                Limits(**{"feed": 9, "velocity": np.inf, "acceleration": np.inf, "jerk": np.inf} | {key: 5}).on(flank)
        assert Limits(9, np.inf, np.inf, np.inf).on(flank).jerk.tolist() == [np.inf] * 5

    def test_equal_limits_are_equal_and_hash_alike(self):
        assert limits() == limits()
        assert hash(limits()) == hash(limits())
        assert len({limits(), limits(feed=100.0), limits(velocity=(250, 200))}) == 1
        changed = [
            *(
                {key: 0.5}
                for key in ("feed", "chord_error", "period", "rapid", "tangential_acceleration", "tangential_jerk")
            ),
            *({key: [250, 201]} for key in ("velocity", "acceleration", "jerk")),
            {"axes": ["X", "Z"]},
        ]
        assert len({limits(), *(limits(**change) for change in changed)}) == 1 + len(changed)
        assert limits() != "limits"
        assert limits() != Limits(100, 250, 1000, 2e4)

    def test_repr_is_two_lines_that_say_every_value(self):
        text = repr(limits(chord_error=1e-3, tangential_jerk=5.0, jerk=[2e4, np.inf]))
        assert text.splitlines() == [
            "Limits(feed=100, chord_error=0.001, period=0.001, tangential_jerk=5,",
            "       axes='XY', velocity=[250, 200], acceleration=[1000, 800], jerk=[20000, inf])",
        ]
        for machine in (limits(), load_limits("mill"), Limits(1, 2, 3, 4)):
            assert eval(repr(machine), {"Limits": Limits, "inf": np.inf}) == machine

    def test_html_has_a_row_a_limit(self):
        html = limits(axes=["X", "C"], jerk=[2e4, np.inf])._repr_html_()
        rows = [row.split("</td><td>") for row in html.replace("<table>", "").split("<tr><td>")[1:]]
        assert [row[:2] for row in rows[1:]] == [
            ["feed", "path"],
            *([what, axis] for what in ("velocity", "acceleration") for axis in "XC"),
            ["jerk", "X"],
            ["period", ""],
        ]
        assert rows[5][2].startswith("800 rad/s^2")

    def test_at_most_six_axes(self):
        with pytest.raises(InputError, match="7 axes are given; at most 6"):
            limits(velocity=np.ones(7), acceleration=np.ones(7), jerk=np.ones(7))

    @pytest.mark.parametrize("axes", [["X"], ["X", "X"], ["X", "Q"], ["X", 1], 5, ["x", "y"], ["X", "Y", "Z"]])
    def test_axes_are_different_known_names(self, axes):
        with pytest.raises(InputError, match="axes"):
            limits(axes=axes)

    def test_missing_values_are_named_by_python(self):
        with pytest.raises(TypeError, match="jerk"):
            Limits(100, [1, 1], [1, 1])

    def test_changed_copies(self):
        plain = limits(chord_error=1e-3, tangential_jerk=5.0, axes=["Y", "C"])
        changed = plain.with_feed(7.0).with_period(2e-3)
        assert (plain.feed, changed.feed, changed.period) == (100.0, 7.0, 2e-3)
        assert (changed.chord_error, changed.tangential_jerk, changed.axes) == (1e-3, 5.0, ("Y", "C"))
        for bad in (0, -1, np.nan):
            with pytest.raises(InputError, match="feed"):
                plain.with_feed(bad)

    def test_axes_of_a_curve_are_picked_by_name(self):
        machine = load_limits("five-axis")
        curve = FormulaCurve({"C": "u", "X": "u", "Z": "u**2"}, (0.0, 1.0))
        picked = machine.for_curve(curve)
        assert picked.axes == ("C", "X", "Z")
        assert picked.velocity.tolist() == [0.8, 100.0, 100.0]
        assert picked.jerk.tolist() == [1.5, 3000.0, 3000.0]
        assert (picked.period, picked.chord_error) == (machine.period, machine.chord_error)
        assert machine.for_curve(load_curve("flank")) is machine
        with pytest.raises(InputError, match="the machine has no axis B"):
            machine.for_curve(FormulaCurve({"X": "u", "B": "u"}, (0.0, 1.0)))

    def test_number_of_axes_must_be_that_of_the_curve(self):
        with pytest.raises(InputError, match=r"the limits have 2 axes \(X, Y\), but flank has 5 \(X, Y, Z, A, C\)"):
            feedrate_limits(load_curve("flank"), limits(), 0.5)


class TestFeedrateLimits:
    def test_line(self):
        line = NurbsCurve([[0, 0], [30, 40]], [0, 0, 2, 2], 1)
        got = feedrate_limits(line, limits(chord_error=1e-3), np.linspace(0.0, 2.0, 5))
        np.testing.assert_array_equal(got.command, 100.0)
        np.testing.assert_allclose(got.axis_velocity, min(250 / 0.6, 200 / 0.8), rtol=1e-15)
        np.testing.assert_array_equal(got.chord_error, np.inf)
        np.testing.assert_array_equal(got.normal_acceleration, np.inf)
        np.testing.assert_array_equal(got.lowest, 100.0)

    def test_circle(self):
        radius, error, period, safety = 50.0, 1e-3, 2e-3, 0.18
        circle = load_curve("circle")
        machine = limits(chord_error=error, period=period)
        u = np.linspace(0.0, 1.0, 101)
        normal = (circle.derivatives(u, 0)[0] - [radius, 0.0]) / radius
        tangent = np.abs(normal[:, ::-1])
        for side in ("left", "right"):
            got = feedrate_limits(circle, machine, u, safety=safety, side=side)
            chord = 2.0 / period * np.sqrt(radius**2 - (radius - error) ** 2)
            np.testing.assert_allclose(got.chord_error, chord, rtol=1e-11)
            with np.errstate(divide="ignore"):
                speed = np.min([250.0, 200.0] / tangent, axis=1)
                turn = np.sqrt(safety * radius * np.min([1000.0, 800.0] / np.abs(normal), axis=1))
            np.testing.assert_allclose(got.axis_velocity, speed, rtol=1e-11)
            np.testing.assert_allclose(got.normal_acceleration, turn, rtol=1e-11)

    def test_lowest_of_the_four(self):
        u = np.linspace(0.0, 6.0, 200)
        got = feedrate_limits(load_curve("butterfly", scale=10.0), limits(chord_error=1e-4), u)
        rows = [got.command, got.axis_velocity, got.chord_error, got.normal_acceleration]
        np.testing.assert_array_equal(got.lowest, np.min(rows, axis=0))
        assert len({int(i) for i in np.argmin(rows, axis=0)}) >= 2

    @pytest.mark.parametrize("shape", [(), (3,), (2, 3), (0,)])
    def test_shape_follows_the_parameter(self, shape):
        got = feedrate_limits(load_curve("circle"), limits(), np.full(shape, 0.3))
        assert isinstance(got, FeedrateLimits)
        for row in (got.command, got.axis_velocity, got.chord_error, got.normal_acceleration, got.lowest):
            assert row.shape == shape

    def test_chord_limit_takes_the_radius_where_the_error_exceeds_it(self):
        machine = limits(chord_error=0.5, period=1e-3)
        # e = rho: (2/T) sqrt(2 rho^2 - rho^2) = 2 rho / T, the diameter in one period
        np.testing.assert_allclose(chord_feed_limit(np.array([1 / 0.5, 1 / 0.1, 1e6]), machine), [1e3, 200.0, 2e-3])
        # Below the radius the sagitta of the chord V T is e exactly.
        for radius in (0.6, 5.0, 1e4):
            chord = float(chord_feed_limit(np.array(1.0 / radius), machine)) * 1e-3
            assert radius - np.sqrt(radius**2 - 0.25 * chord**2) == pytest.approx(0.5, rel=1e-9)
        assert float(chord_feed_limit(np.array(0.0), machine)) == np.inf

    def test_chord_limit_rises_with_radius_and_error(self):
        radii = np.geomspace(1e-6, 1e6, 200)
        by_radius = chord_feed_limit(1.0 / radii, limits(chord_error=1e-3))
        assert (np.diff(by_radius) > 0.0).all()
        errors = [float(chord_feed_limit(np.array(2.0), limits(chord_error=e))) for e in np.geomspace(1e-6, 0.5, 50)]
        assert all(a < b for a, b in pairwise(errors))

    def test_no_limits_give_infinity(self):
        free = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
        np.testing.assert_array_equal(feedrate_limits(load_curve("circle"), free, [0.1, 0.5]).lowest, np.inf)

    def test_five_axes_are_measured_along_the_tip(self):
        flank, machine = load_curve("flank"), load_limits("five-axis")
        u = np.array([0.05, 0.33, 0.71])
        got = feedrate_limits(flank, machine, u)
        # Differences over the tip's arc length, independent of the chain rule.
        s, h = flank.arclength.s(u), 1e-3
        q = [flank.derivatives(flank.arclength.u(s + k * h), 0)[0] for k in (-1, 0, 1)]
        first, second = (q[2] - q[0]) / (2 * h), (q[2] - 2 * q[1] + q[0]) / h**2
        np.testing.assert_allclose(got.axis_velocity, np.min(machine.velocity / np.abs(first), axis=1), rtol=1e-5)
        turn = np.sqrt(np.min(machine.acceleration / np.abs(second), axis=1))
        np.testing.assert_allclose(got.normal_acceleration, turn, rtol=1e-4)
        np.testing.assert_array_equal(got.chord_error, chord_feed_limit(flank.tip.curvature(u), machine))
        np.testing.assert_array_equal(got.command, np.inf)

    def test_resting_tip_has_no_feedrate_limit_but_the_command(self):
        points = [[0, 0, 0], [3, 4, 1], [3, 4, 2], [6, 8, 2]]
        curve = NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "A"])
        machine = Limits(50, [9, 9, 9], [9, 9, 9], [9, 9, 9], chord_error=1e-3, axes=["X", "Y", "A"])
        np.testing.assert_array_equal(feedrate_limits(curve, machine, [1.2, 1.9]).lowest, 50.0)

    @pytest.mark.parametrize("safety", [0.0, -0.5, 1.0001, np.nan, np.inf, "1", None])
    def test_safety_factor_is_in_0_to_1(self, safety):
        with pytest.raises(InputError, match="safety = "):
            feedrate_limits(load_curve("circle"), limits(), 0.5, safety=safety)

    def test_parameter_outside_the_domain_is_refused(self):
        with pytest.raises(InputError, match="must lie within"):
            feedrate_limits(load_curve("circle"), limits(), 1.5)

    @settings(max_examples=40)
    @given(nurbs_curves(max_degree=4), st.sampled_from([1e-3, 0.5, 20.0]))
    def test_lengths_scaled_together_scale_every_limit(self, curve, factor):
        row = np.arange(1.0, curve.dim + 1.0)
        machine = Limits(100, 50 * row, 900 * row, 1e4 * row, chord_error=1e-3)
        sized = Limits(100 * factor, 50 * factor * row, 900 * factor * row, 1e4 * row, chord_error=1e-3 * factor)
        large = NurbsCurve(curve.control_points * factor, curve.knots, curve.degree, curve.weights)
        u = np.linspace(*curve.domain, 7)
        a, b = feedrate_limits(curve, machine, u), feedrate_limits(large, sized, u)
        np.testing.assert_allclose(b.axis_velocity, factor * a.axis_velocity, rtol=1e-9)
        np.testing.assert_allclose(b.chord_error, factor * a.chord_error, rtol=1e-7)
        np.testing.assert_allclose(b.normal_acceleration, factor * a.normal_acceleration, rtol=1e-6)


HEAD = {"feed_mm_s": 100.0, "chord_error_mm": 0.001, "period_s": 0.002}
X = {"name": "X", "velocity_mm_s": 250.0, "acceleration_mm_s2": 1000, "jerk_mm_s3": 20000.0}
A = {"name": "A", "velocity_rad_s": 0.4, "acceleration_rad_s2": 0.5, "jerk_rad_s3": 1.5}
HEAD_KEYS = "feed_mm_s, rapid_mm_s, chord_error_mm, period_s, tangential_acceleration_mm_s2, tangential_jerk_mm_s3"


def toml(value):
    """Literal of a value; text in quotes is taken as it is."""
    if isinstance(value, float):
        return repr(value)
    return value[1:] if isinstance(value, str) and value.startswith("=") else json.dumps(value)


@pytest.fixture
def write(tmp_path):
    """Write a machine file from its head and its axes."""

    def write_file(head, *axes):
        lines = [f"{key} = {toml(value)}" for key, value in head.items()]
        for axis in axes:
            lines += ["[[axis]]", *(f"{key} = {toml(value)}" for key, value in axis.items())]
        path = tmp_path / "machine.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        return path

    return write_file


def without(table, key):
    return {name: value for name, value in table.items() if name != key}


BAD_FILES = {
    "feed zero": ((HEAD | {"feed_mm_s": 0}, X), "feed_mm_s = 0 must be a number > 0; use inf"),
    "feed negative": ((HEAD | {"feed_mm_s": -5.0}, X), "feed_mm_s = -5.0 must be a number > 0; use inf"),
    "feed nan": ((HEAD | {"feed_mm_s": "=nan"}, X), "feed_mm_s = nan must be"),
    "feed a text": ((HEAD | {"feed_mm_s": "100"}, X), "feed_mm_s = '100' must be a number > 0"),
    "feed a truth value": ((HEAD | {"feed_mm_s": True}, X), "feed_mm_s = True must be a number > 0"),
    "feed a date": ((HEAD | {"feed_mm_s": "=1979-05-27"}, X), "feed_mm_s = datetime.* must be a number > 0"),
    "feed a list": ((HEAD | {"feed_mm_s": [1]}, X), r"feed_mm_s = \[1\] must be a number > 0"),
    "feed beyond doubles": ((HEAD | {"feed_mm_s": 10**400}, X), "feed_mm_s = 1000.* must be a number > 0"),
    "feed missing": ((without(HEAD, "feed_mm_s"), X), f'"feed_mm_s" is missing; the keys are {HEAD_KEYS}'),
    "feed in mm/min": (
        (without(HEAD, "feed_mm_s") | {"feed_mm_min": 6000}, X),
        f'unknown key "feed_mm_min"; the keys are {HEAD_KEYS}',
    ),
    "period zero": ((HEAD | {"period_s": 0}, X), "period_s = 0 must be a finite number > 0"),
    "period infinite": ((HEAD | {"period_s": np.inf}, X), "period_s = inf must be a finite number > 0"),
    "period in ms": ((without(HEAD, "period_s") | {"period_ms": 1}, X), 'unknown key "period_ms"'),
    "unknown key": ((HEAD | {"speed": 1}, X), f'unknown key "speed"; the keys are {HEAD_KEYS}'),
    "no axes": ((HEAD,), r'one "\[\[axis\]\]" table for each axis'),
    "axis a number": ((HEAD | {"axis": 5},), r'one "\[\[axis\]\]" table for each axis'),
    "axis a list": ((HEAD | {"axis": [1]},), r'one "\[\[axis\]\]" table for each axis'),
    "axis without name": ((HEAD, without(X, "name")), r'"axis\[0\].name" is missing; the keys are name, velocity'),
    "axis unknown": ((HEAD, X | {"name": "Q"}), r"axis\[0\].name = 'Q' must be one of X, Y, Z, A, B, C, U, V, W"),
    "axis lower case": ((HEAD, X | {"name": "x"}), r"axis\[0\].name = 'x' must be one of X"),
    "axis a number's name": ((HEAD, X | {"name": 1}), r"axis\[0\].name = 1 must be one of X"),
    "axis twice": ((HEAD, X, A, X), 'axis "X" is given twice'),
    "seven axes": ((HEAD, A, *(X | {"name": n} for n in "XYZUVW")), "7 axes are given; at most 6"),
    "jerk missing": (
        (HEAD, X, without(A, "jerk_rad_s3")),
        r'"axis\[1\] \(A\).jerk_rad_s3" is missing; the keys are name',
    ),
    "jerk zero": ((HEAD, X | {"jerk_mm_s3": 0}), r"axis\[0\] \(X\).jerk_mm_s3 = 0 must be a number > 0; use inf"),
    "velocity negative": ((HEAD, X, A | {"velocity_rad_s": -1.0}), r"axis\[1\] \(A\).velocity_rad_s = -1.0 must be"),
    "linear axis in rad": (
        (HEAD, without(X, "velocity_mm_s") | {"velocity_rad_s": 1.0}),
        r'unknown key "axis\[0\] \(X\).velocity_rad_s"; the keys are name, velocity_mm_s, acceleration_mm_s2, jerk',
    ),
    "rotary axis in mm": (
        (HEAD, A | {"velocity_mm_s": 1.0}),
        r'unknown key "axis\[0\] \(A\).velocity_mm_s"; the keys are name, velocity_rad_s, acceleration_rad_s2',
    ),
    "unknown key of an axis": ((HEAD, X | {"backlash_mm": 0.1}), r'unknown key "axis\[0\] \(X\).backlash_mm"'),
}


class TestMachineFiles:
    def test_values_and_defaults(self, write):
        machine = load_limits(write(HEAD, A, X))
        assert (machine.feed, machine.chord_error, machine.period) == (100.0, 0.001, 0.002)
        assert machine.axes == ("A", "X")
        assert machine.velocity.tolist() == [0.4, 250.0]
        assert machine.acceleration.tolist() == [0.5, 1000.0]
        assert machine.jerk.tolist() == [1.5, 20000.0]
        bare = load_limits(write({"feed_mm_s": 5}, X))
        assert (bare.chord_error, bare.period) == (np.inf, 1e-3)
        assert (bare.tangential_acceleration, bare.tangential_jerk) == (np.inf, np.inf)

    def test_infinity_means_no_limit(self, write):
        free = dict.fromkeys(without(HEAD, "period_s"), np.inf) | {"tangential_jerk_mm_s3": np.inf}
        machine = load_limits(write(free, X | {"jerk_mm_s3": np.inf}))
        assert (machine.feed, machine.jerk[0], machine.tangential_jerk) == (np.inf, np.inf, np.inf)

    def test_order_of_the_keys_does_not_matter(self, write):
        shuffled = dict(reversed(X.items()))
        assert load_limits(write(HEAD, shuffled)).velocity.tolist() == [250.0]

    @pytest.mark.parametrize(("tables", "message"), BAD_FILES.values(), ids=BAD_FILES.keys())
    def test_bad_file_is_refused_by_its_key(self, write, tables, message):
        path = write(*tables)
        with pytest.raises(InputError, match=message) as caught:
            load_limits(path)
        assert str(caught.value).startswith(str(path))
        assert not isinstance(caught.value, CurveError)

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (b"", '"feed_mm_s" is missing'),
            (b"feed_mm_s = = 1", "not a valid TOML file"),
            (b"feed_mm_s = 1\nfeed_mm_s = 2", "not a valid TOML file"),
            (bytes(range(256)), "is not text in UTF-8"),
            (b"a = " + b"[" * 100_000, "not a valid TOML file"),
            (b"feed_mm_s = " + b"9" * 5000, "not a valid TOML file"),
            (b'{"feed_mm_s": 1}', "not a valid TOML file"),
        ],
    )
    def test_file_that_is_no_toml(self, tmp_path, content, message):
        path = tmp_path / "machine.toml"
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            load_limits(path)

    def test_missing_file_directory_and_other_things(self, tmp_path):
        with pytest.raises(InputError, match=r"none.toml: cannot be read \(No such file"):
            load_limits(tmp_path / "none.toml")
        with pytest.raises(InputError, match="is not a file"):
            load_limits(tmp_path)
        with pytest.raises(InputError, match="the example machines are mill, five-axis"):
            load_limits("lathe")
        for other in (None, 5, b"mill", ["mill"]):
            with pytest.raises(InputError, match="must be the path of a file"):
                load_limits(other)
        with pytest.raises(InputError, match="null byte"):
            load_limits("a\0b")

    def test_example_machines(self):
        assert EXAMPLE_MACHINES == ("mill", "five-axis")
        mill, five = load_limits("mill"), load_limits("five-axis")
        assert mill.axes == ("X", "Y", "Z")
        assert (mill.feed, mill.chord_error, mill.period) == (100.0, 1e-3, 1e-3)
        assert (mill.velocity[0], mill.acceleration[1], mill.jerk[2]) == (250.0, 1000.0, 20000.0)
        # Ma et al. 2022, section 4.3
        assert five.axes == ("X", "Y", "Z", "A", "C")
        assert five.velocity.tolist() == [100, 100, 100, 0.4, 0.8]
        assert five.acceleration.tolist() == [500, 500, 500, 0.5, 0.5]
        assert five.jerk.tolist() == [3000, 3000, 3000, 1.5, 1.5]
        assert (five.chord_error, five.period) == (0.000125, 0.002)

"""Limits of a machine: values, axes, equality, and how they show themselves."""

import numpy as np
import pytest

from planner import InputError, Limits, feedrate_limits, load_curve, load_limits
from planner.geometry.formula import FormulaCurve

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
        five = load_limits("five-axis")
        lines = repr(five).splitlines()
        assert [line.split("=")[0] for line in lines] == ["Limits(chord_error", "       acceleration"]
        assert max(map(len, lines)) <= 100
        for machine in (limits(), load_limits("mill"), five.with_feed(50.0), Limits(1, 2, 3, 4)):
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

    def test_at_most_nine_axes_and_more_than_six_by_name(self):
        def of(count, **axes):
            return limits(velocity=np.ones(count), acceleration=np.ones(count), jerk=np.ones(count), **axes)

        assert of(9, axes=tuple("XYZABCUVW")).axes == tuple("XYZABCUVW")
        assert of(6).axes == tuple("XYZUVW")
        with pytest.raises(InputError, match="limits: 7 axes need their names, out of X Y Z A B C U V W"):
            of(7)
        with pytest.raises(InputError, match="10 axes are given; at most 9"):
            of(10)

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

    def test_functions_pick_the_axes_of_a_curve_by_name(self):
        machine = load_limits("five-axis")
        curve = FormulaCurve({"C": "u", "X": "u", "Z": "u**2"}, (0.0, 1.0))
        assert machine.on(curve) == machine.for_curve(curve)
        swapped = limits(velocity=[1.0, 2.0], axes=["Y", "X"])  # as many as the curve has, in another order
        assert swapped.on(load_curve("circle")).velocity.tolist() == [2.0, 1.0]
        plain = FormulaCurve({"U": "u", "V": "u**2"}, (0.0, 1.0))
        assert limits(velocity=[1.0, 2.0]).on(plain).velocity.tolist() == [1.0, 2.0]

    def test_number_of_axes_must_be_that_of_the_curve(self):
        with pytest.raises(InputError, match=r"the limits have 2 axes \(X, Y\), but flank has 5 \(X, Y, Z, A, C\)"):
            feedrate_limits(load_curve("flank"), limits(), 0.5)


@pytest.mark.parametrize("reserve", [0.0, 0.1, 0.5])
def test_a_reserve_is_left_of_jerk_and_acceleration(reserve):
    whole = Limits(100.0, [250.0, 200.0], [1000.0, 800.0], [20000.0, np.inf], tangential_jerk=9000.0)
    part = whole.with_reserve(reserve)
    assert part.jerk == pytest.approx((1.0 - reserve) * whole.jerk)
    assert part.acceleration == pytest.approx((1.0 - reserve / 3.0) * whole.acceleration)
    assert part.tangential_jerk == pytest.approx((1.0 - reserve) * 9000.0)
    assert part.tangential_acceleration == np.inf
    assert (part.feed, part.velocity.tolist()) == (100.0, [250.0, 200.0])
    back = part.without_reserve(reserve)
    assert back.jerk == pytest.approx(whole.jerk, rel=1e-15)


@pytest.mark.parametrize("reserve", [-0.1, 0.6, np.nan])
def test_a_reserve_that_is_none_is_refused(reserve):
    with pytest.raises(InputError, match=r"override_reserve = .* must lie within 0 and 0\.5"):
        Limits(100.0, 250.0, 1000.0, 20000.0).with_reserve(reserve)

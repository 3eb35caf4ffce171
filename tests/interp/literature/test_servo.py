"""The position loop against an integrator of its differential equations, and the contour errors of 2002."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from interp.literature.feedshapes import FeedShape, filter_axes, interpolate_constant, interpolate_shape
from interp.literature.servo import XY_TABLE, AxisDrive, contour_error, track
from planner import load_curve
from planner.errors import InputError

PERIOD = 1e-3
LAST_DIGIT = 1e-4
# Largest path error of the command, contour error (largest, rms while moving) and lags of X and Y, mm.
BEFORE = {
    "trapezoid": (0.0, 0.1815, 0.1152, 1.025, 0.673),
    "bell": (0.0, 0.1815, 0.1156, 1.025, 0.673),
    "exponential": (0.0, 0.1815, 0.1156, 1.025, 0.673),
}
AFTER = {
    "moving average": (2.0574, 2.2315, 1.8523, 0.983, 0.645),
    "half-sine": (1.1737, 1.3510, 1.0698, 1.001, 0.657),
    "exponential": (0.9710, 1.1490, 0.7434, 1.005, 0.660),
}


@pytest.fixture(scope="module")
def circle():
    return load_curve("circle")


def before(circle, kind, ramp=0.5):
    return interpolate_shape(circle, FeedShape(kind, circle.length, 100.0, ramp), PERIOD).samples.position


def after(circle, kind, ramp=0.5):
    return filter_axes(interpolate_constant(circle, 100.0, PERIOD).samples, kind, ramp).position


def figures(circle, command):
    tracking = track(command, PERIOD)
    error = contour_error(circle, tracking.actual)
    rms = np.sqrt(np.mean(error[: tracking.moving] ** 2))
    return contour_error(circle, command).max(), error.max(), rms, *np.abs(tracking.lag).max(axis=0)


def radial(position):
    return np.abs(np.hypot(position[:, 0] - 50.0, position[:, 1]) - 50.0)


# ---- the numbers of the paper's experiment -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", BEFORE)
def test_contour_error_with_the_acceleration_before_interpolation(circle, kind):
    found = figures(circle, before(circle, kind))
    assert found[:3] == pytest.approx(BEFORE[kind][:3], abs=LAST_DIGIT)
    assert found[3:] == pytest.approx(BEFORE[kind][3:], abs=1e-3)


@pytest.mark.parametrize("kind", AFTER)
def test_contour_error_with_the_acceleration_after_interpolation(circle, kind):
    found = figures(circle, after(circle, kind))
    assert found[:3] == pytest.approx(AFTER[kind][:3], abs=LAST_DIGIT)
    assert found[3:] == pytest.approx(AFTER[kind][3:], abs=1e-3)


def test_the_contour_error_is_smaller_before_than_after_interpolation(circle):
    ratio = figures(circle, after(circle, "moving average"))[1] / figures(circle, before(circle, "trapezoid"))[1]
    assert ratio == pytest.approx(12.3, abs=0.1)
    # a ten times shorter ramp leaves less of it
    short = (
        figures(circle, after(circle, "moving average", 0.05))[1],
        figures(circle, before(circle, "trapezoid", 0.05))[1],
    )
    assert short == pytest.approx((0.2023, 0.1815), abs=LAST_DIGIT)


# ---- the loop ------------------------------------------------------------------------------------------------------


def test_dc_gains_and_steady_lags():
    assert [d.gain / d.stiffness for d in XY_TABLE] == pytest.approx([0.98983, 0.93394], abs=1e-5)
    assert [d.steady_lag for d in XY_TABLE] == pytest.approx([10.257e-3, 6.725e-3], abs=1e-6)


def test_a_steady_motion_lags_by_the_steady_lag():
    command = np.outer(np.arange(4000) * PERIOD, [100.0, 100.0])
    lag = track(command, PERIOD, settling=0.0).lag[-1]
    # held for a period, the command is half a period late on average
    expected = [100.0 * d.steady_lag for d in XY_TABLE]
    assert lag == pytest.approx(expected, abs=2e-3)


def test_the_difference_equation_is_the_differential_one_between_samples(circle):
    command = before(circle, "trapezoid")[:400]
    tracking = track(command, PERIOD, settling=0.05)
    for j, drive in enumerate(XY_TABLE):
        state = np.array([tracking.command[0, j], 0.0, 0.0])  # position, velocity, acceleration
        for k in range(len(tracking.t) - 1):
            assert tracking.actual[k, j] == pytest.approx(state[0], abs=1e-7)
            rate = (tracking.command[k, j] - tracking.command[max(k - 1, 0), j]) / PERIOD
            volts = drive.position_gain * (tracking.command[k, j] - state[0]) + drive.feed_forward * rate
            if k % 40:  # most periods by the exact step of a linear system, some by an integrator
                state = exact_period(drive, state, volts)
                continue

            def slope(_, x, drive=drive, volts=volts):
                return [x[1], x[2], drive.gain * volts - drive.stiffness * x[1] - drive.damping * x[2]]

            state = solve_ivp(slope, (0.0, PERIOD), state, rtol=1e-10, atol=1e-12).y[:, -1]


def exact_period(drive, state, volts):
    from scipy.linalg import expm

    a = np.zeros((4, 4))
    a[0, 1] = a[1, 2] = 1.0
    a[2, 1:] = -drive.stiffness, -drive.damping, drive.gain
    return (expm(a * PERIOD) @ np.append(state, volts))[:3]


def test_a_command_at_rest_is_kept_and_a_step_settles_at_its_end():
    rest = track([[3.0, -4.0]] * 10, PERIOD)
    assert rest.actual == pytest.approx(rest.command, abs=1e-12)
    step = track([[0.0, 0.0]] * 2 + [[1.0, 2.0]], PERIOD, settling=1.0)
    assert step.moving == 3
    assert step.actual[-1] == pytest.approx([1.0, 2.0], abs=1e-9)


def test_axes_alike_keep_a_circle_round(circle):
    alike = track(before(circle, "bell"), PERIOD, (XY_TABLE[0], XY_TABLE[0]))
    different = track(before(circle, "bell"), PERIOD)
    assert radial(alike.actual).max() < 0.25 * radial(different.actual).max()


def test_what_cannot_be_tracked_is_refused():
    with pytest.raises(InputError, match=r"position has the shape \(5, 3\)"):
        track(np.zeros((5, 3)), PERIOD)
    with pytest.raises(InputError, match="settling = -1"):
        track(np.zeros((5, 2)), PERIOD, settling=-1.0)
    with pytest.raises(InputError, match="period"):
        track(np.zeros((5, 2)), 0.0)
    wild = AxisDrive(112570.543, 601.677, 113727.10, 4000.0, 0.6)
    with pytest.raises(InputError, match="unstable"):
        track(np.zeros((5, 1)), PERIOD, (wild,))


# ---- the contour error ---------------------------------------------------------------------------------------------


def test_the_contour_error_of_a_circle_is_radial(circle):
    rng = np.random.default_rng(4)
    angle = np.append(rng.uniform(0.0, 2.0 * np.pi, 400), [np.pi, np.pi - 1e-6, np.pi + 1e-6])
    points = rng.uniform(48.0, 52.0, angle.size)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + [
        50.0,
        0.0,
    ]
    assert contour_error(circle, points) == pytest.approx(radial(points), abs=1e-9)


def test_the_contour_error_of_an_open_path_reaches_to_its_ends():
    curve = load_curve("snailshell")
    ends = curve.derivatives(curve.domain, 1)
    outward = np.stack([-ends[1, 0], ends[1, 1]]) / np.linalg.norm(ends[1], axis=1)[:, None]
    assert contour_error(curve, ends[0] + 0.01 * outward) == pytest.approx([0.01, 0.01], abs=1e-9)


def test_the_contour_error_needs_linear_axes(circle):
    with pytest.raises(InputError, match="needs linear axes alone"):
        contour_error(load_curve("flank"), np.zeros((2, 5)))
    with pytest.raises(InputError, match=r"must be \(m, 2\)"):
        contour_error(circle, np.zeros((2, 3)))

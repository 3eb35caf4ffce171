"""Figures: what is drawn is what the plan does, and the same plan gives the same file."""

from __future__ import annotations

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from motions import plan_along, scurve

from planner import InputError, Limits, Samples, load_curve, load_limits
from planner.geometry.nurbs import NurbsCurve
from planner.output.plots import _COLUMNS, _envelope, figure_format, plot_plan, save_plot

FEED, ACCELERATION, JERK = 100.0, 1000.0, 20000.0
LIMITS = Limits(120.0, [250.0, 250.0], [1500.0, 2000.0], [25000.0, np.inf], chord_error=1e-3, period=2e-3)
CIRCLE = load_curve("circle")
RADIUS = 50.0
FORMATS = pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])


@pytest.fixture(scope="module")
def plan():
    return plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), LIMITS)


@pytest.fixture(scope="module")
def figure(plan):
    return plot_plan(CIRCLE, LIMITS, plan)


def panel(figure, label):
    """The panel whose vertical axis says so."""
    found = [axes for axes in figure.get_axes() if axes.get_ylabel().startswith(label)]
    assert len(found) == 1, label
    return found[0]


def lines(axes):
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}


class TestContent:
    def test_the_path_is_coloured_by_feed(self, figure):
        (path,) = [c for c in figure.get_axes()[0].collections if isinstance(c, LineCollection)]
        points = np.concatenate(path.get_segments())
        assert np.abs(np.hypot(points[:, 0] - RADIUS, points[:, 1]) - RADIUS).max() < 1e-6
        assert path.get_array().max() == pytest.approx(FEED)
        assert path.axes.get_aspect() == 1.0
        assert (path.axes.get_xlabel(), path.axes.get_ylabel()) == ("X, mm", "Y, mm")

    def test_feed_runs_under_the_command(self, figure):
        (axes,) = [axes for axes in figure.get_axes() if axes.get_xlabel() == "arc length, mm"]
        found = lines(axes)
        assert found["feed"][:, 1].max() == pytest.approx(FEED)
        assert found["feed"][-1, 0] == pytest.approx(CIRCLE.length)
        assert set(found["limit: command"][:, 1]) == {LIMITS.feed}
        # 2/T sqrt(2 r e - e^2) on a circle is 316 mm/s: above the panel
        assert "limit: chord error" not in found

    def test_accelerations_are_shares_of_the_limits(self, figure, plan):
        found = lines(panel(figure, "acceleration"))
        h = 1e-4
        for j, name in enumerate("XY"):
            t, share = found[name][(found[name][:, 0] > 2 * h) & (found[name][:, 0] < plan.duration - 2 * h)].T
            x = [CIRCLE.derivatives(plan.at(t + k * h).u, 0)[0][:, j] for k in (-1, 0, 1)]
            assert share == pytest.approx((x[2] - 2.0 * x[1] + x[0]) / h**2 / LIMITS.acceleration[j], abs=2e-3)

    def test_an_axis_without_a_limit_is_left_out(self, figure):
        found = lines(panel(figure, "jerk"))
        assert "X" in found
        assert "Y" not in found
        # the motion starts along -y or +y with its full jerk; on x only what the curvature adds is left
        assert np.abs(found["X"][:, 1]).max() < 1.0

    def test_tangential_limits_are_drawn(self, plan):
        limits = Limits(120.0, [250.0] * 2, [1500.0] * 2, [25000.0] * 2, tangential_acceleration=2.0 * ACCELERATION)
        found = lines(panel(plot_plan(CIRCLE, limits, plan), "acceleration"))
        assert np.abs(found["tangential"][:, 1]).max() == pytest.approx(0.5)

    @pytest.mark.parametrize("given_samples", [False, True])
    def test_chord_error_is_the_sagitta_of_one_period(self, plan, given_samples):
        period = LIMITS.period
        samples = None
        if given_samples:
            period = 5e-3
            t = np.append(np.arange(0.0, plan.duration, period), plan.duration)
            u = plan.at(t).u
            samples = Samples(period, t, u, CIRCLE.derivatives(u, 0)[0])
        found = panel(plot_plan(CIRCLE, LIMITS, plan, samples), "chord error").get_lines()[0].get_xydata()
        sagitta = RADIUS * (1.0 - np.cos(0.5 * FEED * period / RADIUS))
        assert found[:, 1].max() == pytest.approx(1e3 * sagitta, rel=1e-3)

    def test_lanes_fill_the_share_of_each_limit(self):
        limits = Limits(FEED, [250.0] * 2, [1500.0] * 2, [25000.0] * 2)
        plan = plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), limits)
        (axes,) = [axes for axes in plot_plan(CIRCLE, limits, plan).get_axes() if axes.get_xlabel() == "time, s"]
        assert [text.get_text().split("  ")[0] for text in axes.get_yticklabels()] == ["feed"]
        (lane,) = axes.collections
        filled = sum(np.ptp(path.vertices[:, 0]) for path in lane.get_paths())
        assert filled / plan.duration == pytest.approx(plan.shares()["feed"], abs=0.01)
        assert filled / plan.duration == pytest.approx(1.0 - 0.3 / plan.duration, abs=0.02)

    def test_a_path_in_space_is_drawn_in_space(self):
        curve = NurbsCurve([[0, 0, 0], [40, 5, 10], [10, 60, 30], [70, 60, -20]], [0, 0, 0, 0, 1, 1, 1, 1], 3)
        limits = load_limits("mill")
        profile = plan_along(curve, scurve(curve.length, 60.0, 500.0, 5000.0), limits)
        axes = plot_plan(curve, limits, profile).get_axes()
        assert [a.get_zlabel() for a in axes if a.name == "3d"] == ["Z, mm"]

    def test_a_plane_path_in_space_is_drawn_in_its_plane(self):
        curve = NurbsCurve([[0, 7, 0], [40, 7, 10], [10, 7, 30], [70, 7, -20]], [0, 0, 0, 0, 1, 1, 1, 1], 3)
        limits = load_limits("mill")
        profile = plan_along(curve, scurve(curve.length, 60.0, 500.0, 5000.0), limits)
        axes = plot_plan(curve, limits, profile).get_axes()
        assert (axes[0].get_xlabel(), axes[0].get_ylabel()) == ("X, mm", "Z, mm")

    def test_one_linear_axis_is_unrolled(self):
        knots = [0, 0, 0, 0, 1, 1, 1, 1]
        curve = NurbsCurve([[0, 0], [20, 1], [40, 0], [60, 2]], knots, 3, axes=("X", "C"))
        limits = load_limits("five-axis").for_curve(curve)
        profile = plan_along(curve, scurve(curve.length, 20.0, 100.0, 2000.0), limits)
        axes = plot_plan(curve, limits, profile).get_axes()
        assert (axes[0].get_xlabel(), axes[0].get_ylabel()) == ("arc length, mm", "X, mm")

    def test_large_plans_are_thinned_out(self, plan):
        fine = plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), LIMITS, None)
        times = np.linspace(0.0, fine.duration, 60_000)
        fine = plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), LIMITS, times)
        found = plot_plan(CIRCLE, LIMITS, fine)
        for axes in found.get_axes():
            for line in axes.get_lines():
                assert line.get_xydata().shape[0] <= 4 * _COLUMNS
        assert lines(panel(found, "acceleration"))["X"][:, 1].max() == pytest.approx(
            lines(panel(plot_plan(CIRCLE, LIMITS, plan), "acceleration"))["X"][:, 1].max(), rel=1e-3
        )

    def test_limits_of_another_machine_are_refused(self, plan):
        with pytest.raises(InputError, match="3 axes"):
            plot_plan(CIRCLE, load_limits("mill"), plan)


class TestEnvelope:
    @given(seed=st.integers(0, 1000), count=st.integers(4 * _COLUMNS + 1, 20_000))
    def test_each_column_keeps_its_extremes(self, seed, count):
        rng = np.random.default_rng(seed)
        x = np.sort(rng.uniform(0.0, 3.0, count))
        y = rng.standard_cauchy(count)
        thin_x, thin_y = _envelope(x, y)
        assert thin_x.size <= 4 * _COLUMNS
        assert np.all(np.diff(thin_x) >= 0.0)
        assert (thin_x[0], thin_x[-1]) == (x[0], x[-1])
        assert (thin_y.min(), thin_y.max()) == (y.min(), y.max())
        compared = 0
        for k in range(1, _COLUMNS - 1, 97):
            lo, hi = (x[0] + (x[-1] - x[0]) * (k + edge) / _COLUMNS for edge in (1e-9, 1.0 - 1e-9))
            inside, kept = y[(x > lo) & (x < hi)], thin_y[(thin_x > lo) & (thin_x < hi)]
            if inside.size:
                compared += 1
                assert (kept.min(), kept.max()) == (inside.min(), inside.max())
        assert compared > 0.9 * len(range(1, _COLUMNS - 1, 97))

    def test_a_short_line_is_left_alone(self):
        x = np.linspace(0.0, 1.0, 100)
        assert _envelope(x, x**2)[0] is x


class TestFiles:
    @FORMATS
    def test_the_same_plan_gives_the_same_bytes_under_any_settings(self, tmp_path, plan, figure, suffix):
        save_plot(tmp_path / f"one{suffix}", figure)
        with mpl.rc_context({"font.size": 20.0, "lines.linewidth": 5.0, "svg.hashsalt": "other"}):
            save_plot(tmp_path / f"other{suffix}", plot_plan(CIRCLE, LIMITS, plan))
            assert mpl.rcParams["font.size"] == 20.0
        content = (tmp_path / f"one{suffix}").read_bytes()
        assert content == (tmp_path / f"other{suffix}").read_bytes()
        assert content.startswith({".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}[suffix])

    def test_another_suffix_is_refused(self, tmp_path, figure):
        with pytest.raises(InputError, match=r'plan.gif: the suffix "\.gif" must be one of \.png, \.pdf, \.svg'):
            save_plot(tmp_path / "plan.gif", figure)
        with pytest.raises(InputError, match="must be one of"):
            figure_format("plan")

    def test_an_output_that_cannot_be_written_leaves_nothing(self, tmp_path, figure):
        with pytest.raises(InputError, match="there is no directory"):
            save_plot(tmp_path / "missing" / "plan.png", figure)
        (tmp_path / "plan.png").mkdir()
        with pytest.raises(InputError, match="it is a directory"):
            save_plot(tmp_path / "plan.png", figure)
        assert list(tmp_path.rglob("*")) == [tmp_path / "plan.png"]

    def test_pyplot_is_never_loaded(self):
        code = "import sys, planner.output.plots; assert 'matplotlib.pyplot' not in sys.modules"
        subprocess.run([sys.executable, "-c", code], check=True)

"""Figures: what is drawn is what the plan does, and the same plan gives the same file."""

from __future__ import annotations

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from cases import PROJECT
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.text import Text
from motions import largest_rates, line_of_a_program, plan_along, scurve
from pictures import width_of

import feedplan
from planner import InputError, Limits, Samples, check, load_curve, load_limits
from planner.geometry.nurbs import NurbsCurve
from planner.output.figures import _COLUMNS, envelope, figure_format, save_plot
from planner.output.palette import RAPID, limit_colour
from planner.output.panel_choice import PLAN_PANELS
from planner.output.plots import plot_plan
from planner.output.traces import trace_plan

FEED, ACCELERATION, JERK = 100.0, 1000.0, 20000.0
LIMITS = Limits(120.0, [250.0, 250.0], [1500.0, 2000.0], [25000.0, np.inf], chord_error=1e-3, period=2e-3)
CIRCLE = load_curve("circle")
RADIUS = 50.0
FORMATS = pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])


@pytest.fixture(scope="module")
def plan():
    return plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), LIMITS)


@pytest.fixture(scope="module")
def space_plan():
    """A plan of a path in space, with its limits."""
    curve = NurbsCurve([[0, 0, 0], [40, 5, 10], [10, 60, 30], [70, 60, -20]], [0, 0, 0, 0, 1, 1, 1, 1], 3)
    limits = load_limits("mill")
    return plan_along(curve, scurve(curve.length, 60.0, 500.0, 5000.0), limits), limits


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
        assert [text.get_text().split("  ")[0] for text in axes.texts] == ["feed"]
        (lane,) = axes.collections
        assert to_hex(lane.get_facecolor()[0]) == limit_colour("feed")
        filled = sum(np.ptp(path.vertices[:, 0]) for path in lane.get_paths())
        assert filled / plan.duration == pytest.approx(plan.shares()["feed"], abs=0.01)
        assert filled / plan.duration == pytest.approx(1.0 - 0.3 / plan.duration, abs=0.02)

    def test_a_path_in_space_is_seen_in_parallel(self, space_plan):
        """What is drawn is the path times a matrix of two orthonormal columns: every direction has one scale."""
        profile, limits = space_plan
        axes = plot_plan(profile.curve, limits, profile, panels="path").get_axes()[0]
        assert axes.get_aspect() == 1.0
        (drawn,) = [c for c in axes.collections if isinstance(c, LineCollection) and c.get_array() is not None]
        points = np.concatenate([drawn.get_segments()[0][:1], [segment[1] for segment in drawn.get_segments()]])
        assert points.shape[0] > 1000
        t = trace_plan(profile.curve, limits, profile, 400_000)
        at = np.unique(np.searchsorted(t.s, np.linspace(0.0, t.s[-1], 2500)).clip(0, t.s.size - 1))
        view = np.linalg.lstsq(t.position[at], points, rcond=None)[0]
        assert t.position[at] @ view == pytest.approx(points, abs=1e-9)
        assert view.T @ view == pytest.approx(np.eye(2), abs=1e-9)
        assert view[2] == pytest.approx([0.0, np.sqrt(0.75)], abs=1e-9)  # Z is upright
        low, high = t.position.min(axis=0), t.position.max(axis=0)
        said = axes.get_title(loc="left").replace("\N{MINUS SIGN}", "-").splitlines()
        assert said == [f"{name} {a:.4g} to {b:.4g} mm" for name, a, b in zip("XYZ", low, high, strict=True)]
        assert {text.get_text() for text in axes.texts} == {"X", "Y", "Z"}

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
            plot_plan(CIRCLE, Limits(50.0, [100.0] * 3, [1000.0] * 3, [20000.0] * 3, axes="XZU"), plan)


class TestEnvelope:
    @given(seed=st.integers(0, 1000), count=st.integers(4 * _COLUMNS + 1, 20_000))
    def test_each_column_keeps_its_extremes(self, seed, count):
        rng = np.random.default_rng(seed)
        x = np.sort(rng.uniform(0.0, 3.0, count))
        y = rng.standard_cauchy(count)
        thin_x, thin_y = envelope(x, y)
        assert thin_x.size <= 4 * _COLUMNS
        assert np.all(np.diff(thin_x) >= 0.0)
        assert (thin_x[0], thin_x[-1]) == (x[0], x[-1])
        assert (thin_y.min(), thin_y.max()) == (y.min(), y.max())
        # Every column of the panel, but for those that a point lies at the edge of: rounding may put it on either side.
        place = (x - x[0]) / (x[-1] - x[0]) * _COLUMNS
        at_edge = np.abs(place - np.round(place)) < 1e-9
        at_edge[[0, -1]] = False  # the first and the last point have a side
        unclear = np.zeros(_COLUMNS + 1, dtype=bool)
        unclear[np.round(place[at_edge]).astype(int)] = True
        clear = ~(unclear[:-1] | unclear[1:])
        edges = x[0] + (x[-1] - x[0]) * np.arange(1, _COLUMNS) / _COLUMNS
        every, kept = (self.extremes(*line, edges) for line in ((x, y), (thin_x, thin_y)))
        assert np.array_equal(every[:, clear], kept[:, clear])
        # Four points a column on average leave exp(-4) of the columns empty: 22 of 1200, and never 60.
        assert np.sum(np.isfinite(every[0]) & clear) > 0.95 * _COLUMNS

    @staticmethod
    def extremes(x, y, edges):
        """Smallest and largest value of each column, inf and -inf where it has none."""
        column = np.searchsorted(edges, x, side="right")
        found = np.array([[np.inf], [-np.inf]]) * np.ones(edges.size + 1)
        np.minimum.at(found[0], column, y)
        np.maximum.at(found[1], column, y)
        return found

    def test_a_short_line_is_left_alone(self):
        x = np.linspace(0.0, 1.0, 100)
        assert envelope(x, x**2)[0] is x


@pytest.fixture(scope="module")
def program_figure():
    profile, limits = line_of_a_program()
    return plot_plan(profile.curve, limits, profile)


class TestProgram:
    def test_the_colours_follow_the_cutting_moves(self, program_figure):
        cutting, rapid = (c for c in program_figure.get_axes()[0].collections if isinstance(c, LineCollection))
        assert cutting.get_clim() == pytest.approx((0.0, 20.0))
        assert set(np.round(np.asarray(cutting.get_array()), 9)) == {20.0}
        assert to_hex(rapid.get_color()[0]) == RAPID
        (run,) = rapid.get_segments()
        assert (run[:, 0].min(), run[:, 0].max()) == pytest.approx((100.0, 200.0), abs=1e-3)
        x = np.concatenate(cutting.get_segments())[:, 0]
        assert not np.any((x > 100.1) & (x < 199.9))
        assert [text.get_text() for text in program_figure.get_axes()[0].get_legend().get_texts()] == ["rapid"]

    def test_the_f_words_are_steps_also_above_the_machines_feed(self, program_figure):
        (axes,) = [axes for axes in program_figure.get_axes() if "feed" in lines(axes)]
        x, y = lines(axes)["limit: F word"].T
        assert x == pytest.approx([0.0, 100.0, 100.0, 200.0, 200.0, 300.0])
        assert y == pytest.approx([20.0, 20.0, np.nan, np.nan, 30.0, 30.0], nan_ok=True)
        assert set(lines(axes)["limit: command"][:, 1]) == {25.0}


def long_path():
    """Long and flat in space, of an axis far below 0."""
    curve = NurbsCurve(
        [[-900, 0, 0], [8, 3, 0], [14, 0, 15], [28, 3, -1]], [0, 0, 0, 0, 1, 1, 1, 1], 3, name="part-of-long-name"
    )
    limits = load_limits("mill")
    return plan_along(curve, scurve(curve.length, 60.0, 500.0, 5000.0), limits), limits


def program_in_space():
    """A few moves of a program with rapids, planned."""
    job = feedplan.load_job(str(PROJECT / "tests/data/programs/stops.ngc"), "mill", tolerance=0.01)
    return job.plan(), job.limits


def five_axes():
    """All the axes of a machine with two rotary ones."""
    points = [[0, 0, 0, 0, 0], [20, 1, 9, 0.2, 0.1], [40, 0, 5, 0.4, 1], [60, 2, 0, 0, 0]]
    curve = NurbsCurve(points, [0, 0, 0, 0, 1, 1, 1, 1], 3, axes=("X", "Y", "Z", "A", "C"))
    limits = load_limits("five-axis").for_curve(curve)
    return plan_along(curve, scurve(curve.length, 20.0, 100.0, 2000.0), limits), limits


def circle():
    """A circle with limits along the path."""
    limits = Limits(
        120.0, [250.0] * 2, [1500.0] * 2, [25000.0] * 2, 1e-3, tangential_acceleration=1500.0, tangential_jerk=3e4
    )
    return plan_along(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK), limits), limits


SHOWN = {
    "circle": circle, "long path": long_path, "F words": line_of_a_program, "program in space": program_in_space,
    "five axes": five_axes,
}  # fmt: skip


class TestPeaks:
    @pytest.mark.parametrize("what", ["acceleration", "jerk"])
    def test_no_line_of_a_plan_that_holds_leaves_its_limit(self, what):
        """Where a program stops, its path breaks: each side of a break is drawn by its own derivatives."""
        profile, limits = program_in_space()
        assert check(profile.curve, limits, profile).ok
        (axes,) = plot_plan(profile.curve, limits, profile, panels=what).get_axes()
        shares = [line[:, 1] for name, line in lines(axes).items() if name in {"X", "Y", "Z"}]
        assert len(shares) == 3
        peaks = [np.abs(share).max() for share in shares]
        # The rounding of nodes 70 us apart is worth 4e-5 there, and more with the third power of how close they are.
        closest = np.diff(profile.t)[np.diff(profile.t) > 0.0].min()
        assert max(peaks) < 1.0 + 2.5 * 4e-5 * max(1.0, (70e-6 / closest) ** 3)
        assert what != "jerk" or min(peaks) > 0.999
        assert not axes.texts

    def test_a_peak_far_above_the_limit_is_named(self, plan):
        limits = Limits(120.0, [250.0] * 2, [1500.0] * 2, [25000.0, 1000.0])
        largest = largest_rates(CIRCLE, scurve(CIRCLE.length, FEED, ACCELERATION, JERK))[2, 1] / 1000.0
        assert largest > 20.0
        (axes,) = plot_plan(CIRCLE, limits, plan, panels="jerk").get_axes()
        assert np.abs(lines(axes)["Y"][:, 1]).max() == pytest.approx(largest, rel=1e-3)
        assert [text.get_text() for text in axes.texts] == [f"peaks to {largest:.3g}"]
        assert axes.get_ylim()[1] < 5.0


class TestChoice:
    def test_panels_are_those_that_are_asked_for(self, plan):
        figure = plot_plan(CIRCLE, LIMITS, plan, panels="jerk, path,velocity")
        assert [axes.get_ylabel().split("\n")[0] for axes in figure.get_axes()] == [
            "Y, mm",
            "feed, mm/s",
            "jerk",
            "velocity",
        ]
        taller = plot_plan(CIRCLE, LIMITS, plan, panels=("jerk", "path", "velocity", "binding"))
        assert taller.get_figheight() > figure.get_figheight()

    def test_shares_of_velocity_are_those_of_the_motion(self, plan):
        (axes,) = plot_plan(CIRCLE, LIMITS, plan, panels="velocity").get_axes()
        t, share = lines(axes)["X"].T
        h = 1e-5
        inner = (t > h) & (t < plan.duration - h)
        x = [CIRCLE.derivatives(plan.at(t[inner] + k * h).u, 0)[0][:, 0] for k in (-1, 1)]
        assert share[inner] == pytest.approx((x[1] - x[0]) / (2 * h) / LIMITS.velocity[0], abs=1e-4)

    @pytest.mark.parametrize(
        ("chosen", "message"),
        [
            ("path,speed", 'panels: "speed" is not one of path, feed, velocity, acceleration, jerk, chord, binding'),
            ("feed,feed", 'panels: "feed" is given twice'),
            ("", 'panels: "" is not one of'),
            ((), "none is given"),
        ],
    )
    def test_unknown_panels_are_refused(self, plan, chosen, message):
        with pytest.raises(InputError, match=message):
            plot_plan(CIRCLE, LIMITS, plan, panels=chosen)

    def test_a_panel_that_would_be_empty_is_left_out_or_refused(self, plan):
        limits = Limits(120.0, [250.0] * 2, [1500.0] * 2, [np.inf] * 2)
        labels = [axes.get_ylabel() for axes in plot_plan(CIRCLE, limits, plan).get_axes()]
        assert not [label for label in labels if label.startswith("jerk")]
        with pytest.raises(InputError, match='"jerk" would be empty'):
            plot_plan(CIRCLE, limits, plan, panels="jerk")

    @pytest.mark.parametrize("width", [0.0, -85.0, 79.0, 421.0, np.nan, np.inf])
    def test_bad_widths_are_refused(self, plan, width):
        with pytest.raises(InputError, match="mm wide is not possible: allowed is 80 to 420 mm"):
            plot_plan(CIRCLE, LIMITS, plan, width_mm=width)

    @FORMATS
    @pytest.mark.parametrize("width", [85.0, 170.0])
    def test_the_file_is_as_wide_as_asked(self, tmp_path, plan, suffix, width):
        path = tmp_path / f"plan{suffix}"
        save_plot(path, plot_plan(CIRCLE, LIMITS, plan, width_mm=width, panels="feed,jerk"))
        assert width_of(path) == pytest.approx(width, abs=0.13)  # a pixel

    @pytest.mark.parametrize("width", [80.0, 85.0, 130.0, 180.0])
    @pytest.mark.parametrize("shown", SHOWN)
    def test_labels_are_readable_inside_the_page_and_apart(self, monkeypatch, shown, width):
        profile, limits = SHOWN[shown]()
        every = plot_plan(profile.curve, limits, profile, width_mm=width, panels=PLAN_PANELS)
        usual = plot_plan(profile.curve, limits, profile, width_mm=width)
        for figure in (every, usual):
            canvas = FigureCanvasAgg(figure)
            drawn = []
            draw = Text.draw

            def record(text, renderer, *args, _draw=draw, _drawn=drawn, **options):
                if text.get_visible() and text.get_text().strip():
                    _drawn.append(text)
                _draw(text, renderer, *args, **options)

            monkeypatch.setattr(Text, "draw", record)
            canvas.draw()
            monkeypatch.undo()
            assert len(drawn) > 30
            boxes = {}
            for text in drawn:
                box = text.get_window_extent(canvas.get_renderer())
                assert 6.9 < text.get_fontsize() < 8.1
                assert figure.bbox.x0 - 1.0 <= box.x0 < box.x1 <= figure.bbox.x1 + 1.0, text
                assert figure.bbox.y0 - 1.0 <= box.y0 < box.y1 <= figure.bbox.y1 + 1.0, text
                assert [other for other, place in boxes.items() if place.overlaps(box)] == [], text
                boxes[text] = box

    @pytest.mark.parametrize("width", [85.0, 180.0])
    def test_what_breaks_is_said_in_one_line(self, plan, width):
        tight = Limits(120.0, [250.0] * 2, [500.0] * 2, [2500.0] * 2)
        report = check(CIRCLE, tight, plan)
        assert {row.limit for row in report.violations} >= {"acceleration", "jerk"}
        title, broken = plot_plan(CIRCLE, tight, plan, width_mm=width).get_suptitle().splitlines()
        assert title == f"circle: {plan.duration:.5g} s, s-curve"
        worst = max(report.violations, key=lambda row: row.ratio)
        assert broken.startswith(f"BREAKS ITS LIMITS: {worst.limit} ")
        assert "\n" not in plot_plan(CIRCLE, LIMITS, plan, width_mm=width).get_suptitle()


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

"""Programs judged by LinuxCNC itself, where it is installed."""

from dataclasses import replace

import numpy as np
import pytest
from cases import drives

from benchmarks.linuxcnc import rt
from benchmarks.linuxcnc.interpreter import interpret, is_installed
from benchmarks.linuxcnc.machine import largest_distance, run_program
from interp.plan_file import plan_bytes
from planner import plan_feedrate, write_ngc
from planner.geometry.nurbs import NurbsCurve

needs_linuxcnc = pytest.mark.skipif(
    not is_installed(), reason="LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)"
)


@pytest.fixture(scope="module")
def planned():
    points = [[5, 0], [30, 0], [30, 20], [10, 30], [0, 10], [-20, 20], [-20, 0]]
    curve = NurbsCurve(points, [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4], 3, name="bend")
    return curve, plan_feedrate(curve, drives(80))


@needs_linuxcnc
@pytest.mark.parametrize("mode", ["feed", "inverse_time"])
def test_the_interpreter_makes_the_blocks_that_were_written(tmp_path, planned, mode):
    curve, profile = planned
    written = write_ngc(tmp_path / "bend.ngc", curve, profile, tolerance=0.01, mode=mode)
    canonical = interpret(tmp_path / "bend.ngc")
    assert canonical.counts["STRAIGHT_FEED"] == written.blocks
    exact = curve.derivatives(np.linspace(*curve.domain, 20001), 0)[0]
    there = np.column_stack([exact, np.zeros(len(exact))])
    assert largest_distance(canonical.points, there, 2000) <= 1e-4  # rs274 prints four decimals


@needs_linuxcnc
def test_the_interpreter_refuses_what_is_wrong(tmp_path):
    path = tmp_path / "wrong.ngc"
    path.write_text("G1 X1 F100\nG2 X5\nM2\n")
    with pytest.raises(ValueError, match="R i j k words all missing for arc"):
        interpret(path)


@needs_linuxcnc
@pytest.mark.slow
@pytest.mark.parametrize("mode", ["feed", "inverse_time"])
def test_the_machine_takes_the_time_that_is_said(tmp_path, planned, mode):
    """At the plan's own acceleration."""
    curve, profile = planned
    written = write_ngc(tmp_path / "bend.ngc", curve, profile, tolerance=0.01, mode=mode)
    run = run_program(tmp_path / "bend.ngc", [250.0] * 3, [1000.0] * 3)
    assert run.cut_time == pytest.approx(written.duration, rel=0.01)
    exact = curve.derivatives(np.linspace(*curve.domain, 20001), 0)[0]
    assert largest_distance(run.position, np.column_stack([exact, np.zeros(len(exact))]), 2000) <= 0.01


def test_the_distance_to_a_polyline():
    vertices = np.array([[0, 0, 0], [10, 0, 0], [10, 0, 0], [10, 10, 0]], dtype=float)
    points = np.array([[1, 0.1, 0], [9.7, -0.2, 0], [10.3, 5, 0]])
    assert largest_distance(points, vertices) == pytest.approx(0.3)


@pytest.mark.skipif(not rt.can_build(), reason="needs LinuxCNC with halcompile, and leave to write to its modules")
def test_a_thread_of_linuxcnc_runs_the_plan(planned):
    """The component, built and loaded, while its knobs are turned: the step's own positions, within every limit."""
    curve, _ = planned
    limits = drives(80)
    profile = plan_feedrate(curve, limits.with_reserve(rt.RESERVE))
    profile = replace(profile, origin=replace(profile.origin, override_reserve=rt.RESERVE))
    content = plan_bytes(profile, limits)
    knobs = [(0.3, "sets hold 1"), (0.5, "sets hold 0"), (0.3, "sets override 0.3"), (0.4, "sets override 1")]
    with rt.component():
        trace = rt.run_plan(content, 2, knobs)
    assert rt.off_step(trace, content) <= rt.ALLOWED
    assert max(rt.ratios(trace, limits).values()) <= 1.0
    assert trace.hold.any()
    assert trace.rate.min() == 0.0
    assert trace.done[-1]


def test_a_trace_that_breaks_a_limit_is_seen():
    t = 1e-3 * np.arange(200)
    position = np.stack([0.5 * 2000.0 * t**2, 0.0 * t], axis=1)  # twice the acceleration, and a jump of it at both ends
    names = ("override", "hold", "run", "done", "rate", "feed", "clocks")
    trace = rt.Trace(position, **{name: np.zeros(200) for name in names})
    found = rt.ratios(trace, drives(80))
    assert found["acceleration"] >= 1.999
    assert found["jerk"] > 50.0


def test_the_knobs_end_with_all_let_go():
    knobs = rt.random_knobs(10.0)
    assert knobs == rt.random_knobs(10.0)
    assert [command for _, command in knobs[-2:]] == ["sets hold 0", "sets override 1"]

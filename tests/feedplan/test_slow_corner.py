"""The corner that costs most time: which it is, what it costs, and the motions past it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import PROGRAMS

from feedplan.job import load_job
from feedplan.slow_corner import slowest_corner
from planner.output.corner_view import distance_from
from planner.programs.times import times_at

HEAD = "G21 G90 G64 P0.01\nF6000\nG0 X0 Y0\n"


@pytest.fixture
def planned(tmp_path):
    """A program, planned; returns its job and its plan."""

    def plan(text, path="separate", **options):
        file = tmp_path / "part.ngc"
        file.write_text(text + "M2\n")
        job = load_job(file, "mill", path=path, **options)
        return job, job.plan()

    return plan


class TestWhich:
    def test_the_one_that_costs_most(self, planned):
        points = np.array([[0, 0], [20, 0], [40, 15], [40, 45], [10, 45], [10, 40]], dtype=float)
        job, profile = planned(HEAD + "G1 " + "".join(f"X{x:g} Y{y:g}\n" for x, y in points[1:]))
        length = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = times_at(profile, 0.5 * (job.path.u[:-1] + job.path.u[1:]))
        lost = np.diff(middle) - 0.5 * (length[:-1] + length[1:]) / 100.0
        at = int(np.argmax(lost))
        slow = slowest_corner(job, profile)
        assert slow.lines == (4 + at, 5 + at)
        assert slow.lost == pytest.approx(lost[at])
        ends = [p[:2] for p in (slow.corner.before, slow.corner.vertex, slow.corner.after)]
        assert np.array(ends) == pytest.approx(points[at : at + 3])
        assert slow.corner.tolerance == 0.01

    def test_where_f_is_low_a_corner_costs_little(self, planned):
        slow = slowest_corner(*planned(HEAD + "G1 X20\nX40 Y15\nF60\nX40 Y20\nX35 Y20\n"))
        assert slow.lines == (4, 5)

    def test_tolerances_are_those_in_force(self, planned):
        text = HEAD + "G1 X20\nY20\nG64 P0.05\nX0\nY0\n"
        assert slowest_corner(*planned(text)).corner.tolerance == 0.01
        assert slowest_corner(*planned(text, tolerance=0.02)).corner.tolerance == 0.02
        assert slowest_corner(*planned(text, tolerance=0.02, share=0.5)).corner.tolerance == 0.01
        assert slowest_corner(*planned(text, share=0.5)).corner.tolerance == 0.005

    @pytest.mark.parametrize(
        "text",
        [
            "G1 X20\n",
            "G1 X20\nX40 Y2\n",
            "G61\nG1 X20\nY20\n",
            "G1 X20\nG4 P1\nY20\n",
            "G1 X20\nG0 Y20\n",
            "G1 X20\nG3 X20 Y10 I-5 J5\n",
            "G1 X20\nY0.09\n",
        ],
        ids=["one line", "no turn", "exact", "dwell", "rapid", "arc", "short"],
    )
    def test_what_is_no_corner(self, planned, text):
        assert slowest_corner(*planned(HEAD + text)) is None

    def test_a_curve_has_none(self):
        job = load_job("circle", "mill")
        assert slowest_corner(job, job.plan(intervals=60)) is None


class TestWhat:
    def test_it_costs_what_it_takes_longer_than_at_the_feed(self, planned):
        job, profile = planned(HEAD + "G1 X40\nY40\n")
        slow = slowest_corner(job, profile)
        start, end = times_at(profile, 0.5 * (job.path.u[:-1] + job.path.u[1:]))
        assert slow.lost == pytest.approx(end - start - 40.0 / 100.0)
        # A stop would cost v / a + a / j beyond the way, the corner saves 2 (6 A / J)^(1/3) of it.
        saved = 2.0 * np.cbrt(6.0 * 0.01 / np.sqrt(2.0) / 20000.0)
        assert slow.lost == pytest.approx(100.0 / 1000.0 + 1000.0 / 20000.0 - saved, rel=1e-2)

    @pytest.mark.parametrize("path", ["separate", "joint"])
    def test_the_motion_is_that_of_the_plan(self, planned, path):
        job, profile = planned(HEAD + "G1 X40\nY40\n", path)
        (motion,) = slowest_corner(job, profile).corner.passes
        assert motion.label == "this plan"
        assert motion.position[0][:2] == pytest.approx([20.0, 0.0], abs=0.01)
        assert motion.position[-1][:2] == pytest.approx([40.0, 20.0], abs=0.01)
        h = np.diff(motion.t)[:, None]
        mean = 0.5 * (motion.velocity[1:] + motion.velocity[:-1])
        assert np.diff(motion.position, axis=0) / h == pytest.approx(mean, abs=0.01)
        feed = profile.at(motion.t).feed
        assert np.linalg.norm(motion.velocity, axis=1) == pytest.approx(feed, abs=1e-6)

    def test_other_plans_pass_the_same_corner(self, planned):
        text = HEAD + "G1 X20\nX40 Y15\nX40 Y45\nX10 Y45\n"
        wide = planned(text, tolerance=0.05)
        job, profile = planned(text)
        slow = slowest_corner(job, profile, {"within 50 um": wide})
        assert [motion.label for motion in slow.corner.passes] == ["this plan", "within 50 um"]
        least = [np.linalg.norm(m.position - slow.corner.vertex, axis=1).min() for m in slow.corner.passes]
        assert least == pytest.approx([0.01, 0.05], rel=0.01)

    def test_a_joint_path_costs_less_and_keeps_the_tolerance(self, planned):
        text = HEAD + "G1 X20\nY20\nX0\n"
        found = {kind: slowest_corner(*planned(text, kind)) for kind in ("joint", "separate")}
        assert found["joint"].lost < found["separate"].lost - 0.01
        (motion,) = found["joint"].corner.passes
        corner = dataclasses.replace(found["joint"].corner, passes=(motion,))
        off = np.abs(distance_from(corner, motion.position))
        assert 0.009 < off.max() <= 0.01 * (1.0 + 1e-6)

    def test_a_degree_counts_as_a_mm(self, planned, tmp_path):
        file = tmp_path / "part.ngc"
        file.write_text("G21 G90 G64 P0.01\nF3000\nG0 X0 A0\nG1 X20\nX21 A30\nM2\n")
        job = load_job(file, "four-axis", path="separate")
        slow = slowest_corner(job, job.plan())
        assert slow.corner.after.max() == pytest.approx(30.0)
        assert slow.corner.passes[0].position[-1][-1] == pytest.approx(15.0, abs=0.5)

    def test_the_zigzag(self):
        job = load_job(PROGRAMS / "zigzag.ngc", "mill")
        slow = slowest_corner(job, job.plan())
        assert slow.corner.turn == pytest.approx(90.0)
        assert slow.lost > 0.09

"""JointTrajectory of ROS 2: read as YAML, run through by the controller's rule, it is the plan."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from cases import PROGRAMS

from planner import BrokenLimitError, InputError, load_curve, load_limits, plan_feedrate
from planner.output.joint_trajectory import JOINT_TOLERANCE_MM, SLACK, _float, write_joint_trajectory

PLANS = ("butterfly-nurbs", "teardrop", "flank", str(PROGRAMS / "slots.ngc"))


@pytest.fixture(scope="module", params=PLANS)
def planned(request):
    name = request.param
    curve = load_curve(name, tolerance=0.01) if name.endswith(".ngc") else load_curve(name)
    limits = load_limits("five-axis" if "A" in curve.axes else "mill").for_curve(curve)
    return curve, limits, plan_feedrate(curve, limits)


@pytest.fixture(scope="module")
def message(planned, tmp_path_factory):
    file = tmp_path_factory.mktemp("ros") / "trajectory.yaml"
    done = write_joint_trajectory(file, planned[2], planned[1])
    return yaml.safe_load(file.read_text()), done


def arrays(curve, found):
    """Times in ns, and positions, velocities and accelerations (3, n, dim) in mm, rad and s."""
    points = found["points"]
    ticks = np.array([10**9 * p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] for p in points])
    scale = np.array([1e3 if unit == "mm" else 1.0 for unit in curve.axis_units])
    rows = [[p[key] for p in points] for key in ("positions", "velocities", "accelerations")]
    return ticks, np.array(rows) * scale


def hermite(ticks, states, probes=7):
    """What the controller runs: six equations for the quintic of each interval, solved as they stand.

    Returns times, positions and three derivatives, (4, k, dim).
    """
    out = [], []
    for k in range(ticks.size - 1):
        h = (ticks[k + 1] - ticks[k]) / 1e9
        # in x = t / h, so that the system is well conditioned
        rows = [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 2, 0, 0, 0],
            [1] * 6,
            [0, 1, 2, 3, 4, 5],
            [0, 0, 2, 6, 12, 20],
        ]
        right = [s[i] * h**n for i in (k, k + 1) for n, s in enumerate(states)]
        c = np.linalg.solve(np.array(rows, dtype=float), np.array(right))
        x = np.linspace(0.0, 1.0, probes)
        poly = [np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyder(c, n)).T / h**n for n in range(4)]
        out[0].append(ticks[k] / 1e9 + x * h)
        out[1].append(np.stack(poly))
    return np.concatenate(out[0]), np.concatenate(out[1], axis=1)


class TestMessage:
    def test_it_has_the_fields_of_the_message_and_no_other(self, planned, message):
        curve, found = planned[0], message[0]
        assert set(found) == {"header", "joint_names", "points"}
        assert found["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        assert found["joint_names"] == list(curve.axes)
        for point in found["points"]:
            assert set(point) == {"positions", "velocities", "accelerations", "time_from_start"}
            assert all(type(x) is float for key in ("positions", "velocities", "accelerations") for x in point[key])
            assert set(point["time_from_start"]) == {"sec", "nanosec"}
            assert 0 <= point["time_from_start"]["nanosec"] < 10**9

    def test_it_begins_and_ends_at_rest_where_the_plan_does(self, planned, message):
        curve, _, profile = planned
        ticks, states = arrays(curve, message[0])
        assert ticks[0] == 0
        assert abs(ticks[-1] - profile.duration * 1e9) <= 0.5
        assert (np.diff(ticks) >= 50_000).all()
        assert not states[1:, [0, -1]].any()
        ends = curve.derivatives(profile.u[[0, -1]], 0)[0]
        assert np.abs(states[0, [0, -1]] - ends).max() <= 1e-12

    def test_the_controllers_quintics_are_the_plan(self, planned, message):
        """By an oracle of its own: position within the tolerance, velocity, acceleration and jerk within the limits."""
        curve, limits, profile = planned
        found, done = message
        ticks, states = arrays(curve, found)
        t, q = hermite(ticks, states)
        plan = curve.derivatives(profile.at(np.minimum(t, profile.duration)).u, 0)[0]
        off = np.abs(q[0] - plan).max()
        assert off <= JOINT_TOLERANCE_MM * 1.1
        assert done.deviation <= JOINT_TOLERANCE_MM
        own = limits.on(curve)
        for rate, allowed in zip(q[1:], (own.velocity, own.acceleration, own.jerk), strict=True):
            assert (np.abs(rate) <= allowed * (1.0 + SLACK)).all()
        assert done.used <= 1.0 + SLACK
        assert done.points == ticks.size

    def test_most_nodes_are_left_out(self, planned, message):
        assert message[1].points < 0.65 * planned[2].t.size

    def test_a_tighter_tolerance_takes_more_points(self, planned, message, tmp_path):
        _, limits, profile = planned
        done = write_joint_trajectory(tmp_path / "t.yaml", profile, limits, tolerance=1e-9)
        assert done.deviation <= 1e-9
        assert message[1].points < done.points < profile.t.size


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, 1e-5, -3.5e-17, 1e22, 1.5e300, 5e-324, 123456789.25, -2e-7])
def test_every_float_is_a_float_to_yaml(value):
    """YAML 1.1 takes 1e-05 for a text."""
    found = yaml.safe_load(f"[{_float(value)}]")[0]
    assert type(found) is float
    assert found == value


@pytest.fixture(scope="module")
def circle():
    curve = load_curve("circle")
    limits = load_limits("mill").for_curve(curve)
    return curve, limits, plan_feedrate(curve, limits, intervals=200)


class TestRefusals:
    @pytest.mark.parametrize(
        ("names", "message"),
        [
            (["x"], "joint names x must be 2 different ones, for X Y"),
            (["x", "x"], "joint names x, x must be 2 different ones"),
            (["x", ""], "joint name '' must be of letters"),
            (["x", "y: 1"], "joint name 'y: 1' must be of letters"),
        ],
    )
    def test_names(self, circle, tmp_path, names, message):
        with pytest.raises(InputError, match=message):
            write_joint_trajectory(tmp_path / "t.yaml", circle[2], circle[1], joint_names=names)
        assert list(tmp_path.iterdir()) == []

    def test_names_are_written(self, circle, tmp_path):
        write_joint_trajectory(tmp_path / "t.yaml", circle[2], circle[1], joint_names=["on", "arm/joint_2"])
        assert yaml.safe_load((tmp_path / "t.yaml").read_text())["joint_names"] == ["on", "arm/joint_2"]

    def test_a_plan_that_breaks_a_limit(self, circle, tmp_path):
        with pytest.raises(BrokenLimitError, match="not written: the plan "):
            write_joint_trajectory(tmp_path / "t.yaml", circle[2], circle[1].with_feed(10.0))
        assert list(tmp_path.iterdir()) == []

    def test_a_plan_that_does_not_end_at_rest(self, circle, tmp_path):
        curve, limits, _ = circle
        profile = plan_feedrate(curve, limits, intervals=200, periodic=True)
        with pytest.raises(
            InputError, match="the plan has a feed at its start; a controller takes points from rest to rest"
        ):
            write_joint_trajectory(tmp_path / "t.yaml", profile, limits)

    def test_tolerance(self, circle, tmp_path):
        with pytest.raises(InputError, match=r"tolerance = 0\.0 must be a number > 0"):
            write_joint_trajectory(tmp_path / "t.yaml", circle[2], circle[1], tolerance=0.0)

"""A plan as a ROS 2 message ``trajectory_msgs/JointTrajectory`` in YAML.

``joint_trajectory_controller`` runs through points that have position, velocity and acceleration by a quintic of time for
each joint.  So the points stand at nodes of the plan, where its jerk may jump: between two nodes the plan is smooth, and
the quintics are the plan to within a bound that is measured here.  Nodes are left out where the controller's quintics stay
within ``tolerance`` of the plan and their jerk within what the axes allow; the times are rounded to the nanoseconds of the
message first, and the plan is evaluated at the rounded times.

Units are those of REP 103: m, rad, s.  What is written is read by ``yaml.safe_load`` and by ``ros2 topic pub --stdin``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.errors import BrokenLimitError, InputError
from planner.files.whole_file import whole_file
from planner.geometry.curve import ROTARY_AXES
from planner.geometry.differential import chain_rule
from planner.inputs import positive_number, require_instance
from planner.law import quintic_coefficients
from planner.machine.limits import Limits, require_limits
from planner.profile import FeedrateProfile
from planner.types import FloatArray
from planner.verify import Report, check

JOINT_TOLERANCE_MM = 1e-6
"""Distance that a controller's quintics may have from the plan, mm; rad of rotary axes."""
SLACK = 1e-3  # of a limit: what the quintics may use more of it than the plan
_NANO = 1_000_000_000
_CLOSEST = 50_000  # ns; closer points would have digits of their positions for a jerk
_PROBES = 8  # between two points
_PASSES = 6  # each leaves out up to half of the points
_ROWS = 4096  # points that are written at once


@dataclass(frozen=True)
class JointPoints:
    """What was written.

    Attributes
    ----------
    points : int
    deviation : float
        Largest distance along an axis between the controller's quintics and the plan, mm or rad.
    used : float
        Largest share that the quintics use of the velocity, acceleration or jerk of an axis.
    longest : float
        Time between two points, s.
    """

    points: int
    deviation: float
    used: float
    longest: float


def write_joint_trajectory(
    path: str | Path,
    profile: FeedrateProfile,
    limits: Limits,
    *,
    joint_names: Sequence[str] | None = None,
    tolerance: float = JOINT_TOLERANCE_MM,
    report: Report | None = None,
) -> JointPoints:
    """Write a plan as a ``trajectory_msgs/JointTrajectory`` in YAML, whole or not at all.

    Parameters
    ----------
    path : str or Path
    profile : FeedrateProfile
    limits : Limits
    joint_names : sequence of str, optional
        Of the axes in their order; the names of the axes if left out.
    tolerance : float
        Distance that the controller's quintics may have from the plan along an axis, mm or rad.
    report : Report, optional
        What :func:`~planner.verify.check` says of the plan; checked here if left out.

    Returns
    -------
    JointPoints

    Raises
    ------
    InputError
        If there are not as many different names as axes, the plan does not begin and end at rest, or the file cannot be
        written.
    BrokenLimitError
        If the plan, or what the controller would make of it, breaks a limit.  Then no file is written.
    """
    require_instance(profile, FeedrateProfile, "profile")
    curve = profile.curve
    limits = require_limits(curve, limits)
    tolerance = positive_number(tolerance, "tolerance")
    names = joint_names_of(curve.axes, joint_names)
    report = check(curve, limits, profile) if report is None else report
    if not report.ok:
        raise BrokenLimitError(f"{path}: not written: the plan {report.summary()}; plan again within the limits")
    for where, rate in (("start", profile.u_rate[0]), ("end", profile.u_rate[-1])):
        if rate != 0.0:
            raise InputError(
                f"{path}: not written: the plan has a feed at its {where}; a controller takes points from rest to rest"
            )
    motion = _AxesOverTime(profile, limits, tolerance)
    ticks = motion.thinned(motion.nodes())
    deviation, used = (float(x.max()) for x in motion.measured(ticks))
    if used > 1.0 + SLACK:
        raise BrokenLimitError(
            f"{path}: not written: the controller's quintics would use {100.0 * used:.4g} % of a limit between points; plan "
            "with more nodes (--intervals)"
        )
    done = JointPoints(ticks.size, deviation, used, float(np.diff(ticks).max()) / _NANO)
    with whole_file(path) as file:
        for text in _yaml(names, motion, ticks, done):
            file.write(text.encode())
    return done


def joint_names_of(axes: Sequence[str], names: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the joints, those of the axes if left out; InputError unless there are as many different ones."""
    found = tuple(axes) if names is None else tuple(names)
    if len(found) != len(axes) or len(set(found)) != len(found):
        raise InputError(f"joint names {', '.join(found)} must be {len(axes)} different ones, for {' '.join(axes)}")
    plain = "_-./"
    bad = [name for name in found if not name or not all(c.isascii() and (c.isalnum() or c in plain) for c in name)]
    if bad:
        raise InputError(f"joint name {bad[0]!r} must be of letters, digits and {plain}")
    return found


class _AxesOverTime:
    """The axes over time, and what quintics between points are of them."""

    def __init__(self, profile: FeedrateProfile, limits: Limits, tolerance: float) -> None:
        self.profile, self.tolerance = profile, tolerance
        own = limits.on(profile.curve)
        self.allowed = np.stack([own.velocity, own.acceleration, own.jerk])

    def nodes(self) -> NDArray[np.int64]:
        """Times of the plan's nodes in ns, none closer to the one before than what is sensible."""
        ticks = np.unique(np.rint(self.profile.t * _NANO).astype(np.int64))
        kept = [int(ticks[0])]
        for tick in ticks[1:-1].tolist():
            if tick - kept[-1] >= _CLOSEST and int(ticks[-1]) - tick >= _CLOSEST:
                kept.append(tick)
        return np.array([*kept, int(ticks[-1])], dtype=np.int64)

    def thinned(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Leave points out, every other at most in one pass, where the quintics without them do as well."""
        for _ in range(_PASSES):
            inner = np.arange(1, ticks.size - 1, 2)
            if not inner.size:
                break
            coarse = np.delete(ticks, inner)
            deviation, used = self.measured(coarse)
            fine = self.measured(ticks)[1]
            before = np.maximum(fine[inner - 1], fine[inner])
            # An interval of the coarse ones for each inner point; behind the last one there may be one more, as it was.
            good = (deviation[: inner.size] <= self.tolerance) & (used[: inner.size] <= np.maximum(1.0, before))
            if not good.any():
                break
            ticks = np.delete(ticks, inner[good])
        return ticks

    def states(self, ticks: FloatArray | NDArray[np.int64]) -> FloatArray:
        """Position and three derivatives of the axes, (4, n, dim), at times in ns; exactly at rest where the plan ends."""
        duration = self.profile.duration
        t = np.where(ticks >= np.rint(duration * _NANO), duration, np.minimum(ticks / _NANO, duration))
        u, *rates = self.profile.law.at(t)
        q = self.profile.curve.derivatives(u, 3)
        states = np.stack([q[0], *chain_rule(q[1], q[2], q[3], *(rate[:, None] for rate in rates))])
        states[1:, (t == 0.0) | (t == duration)] = 0.0
        return states

    def quintics(self, ticks: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Length, s, of the intervals, and the coefficients (6, n - 1, dim) of what the controller runs on them."""
        q = self.states(ticks)
        h = np.diff(ticks)[:, None] / _NANO
        return h, quintic_coefficients(h, (q[0, :-1], q[1, :-1], q[2, :-1]), (q[0, 1:], q[1, 1:], q[2, 1:]))

    def measured(self, ticks: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Distance from the plan, and share of the limits that is used, on each interval, (n - 1,)."""
        h, c = self.quintics(ticks)
        deviation, used = np.zeros(h.size), np.zeros(h.size)
        for k in range(_PROBES + 1):
            x = h * (k / _PROBES)
            value = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
            rates = (
                c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5]))),
                2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5])),
                6.0 * c[3] + x * (24.0 * c[4] + x * 60.0 * c[5]),
            )
            plan = self.states(ticks[:-1] + x[:, 0] * _NANO)[0]
            deviation = np.maximum(deviation, np.abs(value - plan).max(axis=1))
            for rate, allowed in zip(rates, self.allowed, strict=True):
                used = np.maximum(used, (np.abs(rate) / allowed).max(axis=1))
        return deviation, used


def _yaml(names: Sequence[str], motion: _AxesOverTime, ticks: NDArray[np.int64], done: JointPoints) -> Iterator[str]:
    curve = motion.profile.curve
    scale = np.array([1.0 if axis in ROTARY_AXES else 1e-3 for axis in curve.axes])
    units = ", ".join(sorted({"rad" if axis in ROTARY_AXES else "m" for axis in curve.axes}))
    yield (
        f"# trajectory_msgs/msg/JointTrajectory of {' '.join(curve.name.split())}: {done.points} points, {units}, s\n"
        f"# quintics between the points are within {done.deviation:.2g} mm (rad) of the plan and use "
        f"{100.0 * done.used:.6g} % of a limit\n"
        "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}\n"
        f"joint_names: [{', '.join(repr(name) for name in names)}]\n"
        "points:\n"
    )
    for first in range(0, ticks.size, _ROWS):
        some = ticks[first : first + _ROWS]
        q, v, a = ((x * scale).tolist() for x in motion.states(some)[:3])
        for tick, *row in zip(some.tolist(), q, v, a, strict=True):
            lists = (f"[{', '.join(map(_float, values))}]" for values in row)
            said = zip(("positions", "velocities", "accelerations"), lists, strict=True)
            yield "- " + "\n  ".join(f"{key}: {text}" for key, text in said) + "\n"
            yield f"  time_from_start: {{sec: {tick // _NANO}, nanosec: {tick % _NANO}}}\n"


def _float(value: float) -> str:
    """Shortest text that YAML 1.1 reads as this float: its mantissa needs a point where there is an exponent."""
    text = repr(value + 0.0)
    mantissa, e, exponent = text.partition("e")
    return text if "." in mantissa or not e else f"{mantissa}.0e{exponent}"

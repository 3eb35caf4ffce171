"""Check of a plan between its nodes."""

from __future__ import annotations

import numpy as np

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.quantity import AXIS, FEED, JERK, QUANTITIES, Quantity
from planner.verify.chords import profile_chord
from planner.verify.findings import Report, Rows
from planner.verify.implied_columns import Nodes
from planner.verify.motion import Motion, Quintics
from planner.verify.scan import feed_under, machine_caps, scan_spans, worst_of
from planner.verify.sizes import ON_KNOT, VELOCITY_STEP, extent, position_rounding
from planner.verify.steps import check_corners, check_steps

_COLUMNS = ("t", "u", "u_rate", "u_acceleration", "s", "feed", "acceleration", "jerk", "binding")


def check_profile(curve: Curve, limits: Limits, profile: FeedrateProfile, density: int, rows: Rows) -> Report:
    """Measure a plan in the spans between its nodes and the curve's knots, and where these meet."""
    if not _check_table(curve, limits, profile, rows):
        return Report(tuple(rows.rows), np.nan, np.nan, np.nan, np.nan)
    motion = Motion.of(curve, Quintics.of(profile))
    scan = scan_spans(motion, density)
    table = rows.rows
    rows.rows = []
    turning_back = VELOCITY_STEP * float(np.abs(profile.u_rate).max())
    means = scan.means
    allowed = {(q.label, j): value for q in QUANTITIES for j, value in _places(limits, q)}
    for name, j, worst, slack, place in worst_of(motion, scan, density):
        if name == JERK.label and means[j][0] - means[j][1] > worst - slack:
            rows.add(name, means[j][0], limits.jerk[j], means[j][2], slack=means[j][1], j=j)
        elif j >= 0:
            rows.add(name, worst, allowed[name, j], place, slack=slack, j=j)
        elif name == FEED.label and curve.feed_caps is not None:
            rows.add(name, *feed_under(motion, scan, machine_caps(curve.feed_caps, limits), density), slack=slack)
        elif name == "reversal":
            rows.add(name, worst, 0.0, place, slack=slack + turning_back)
        else:
            rows.add(name, worst, allowed[name, j], place, slack=slack)
    if curve.feed_caps is not None:
        rows.add("programmed feed", *feed_under(motion, scan, curve.feed_caps, density))
    rounding = position_rounding(curve, np.clip(profile.u, *curve.domain))
    worst, place = profile_chord(motion, scan, limits.period, rounding)
    rows.add("chord error", worst, limits.chord_error, place, slack=rounding)
    check_steps(motion, scan, limits, rows, density)
    check_corners(motion, scan, limits, rows)
    ends = motion.measure(np.array([0, motion.interval.size - 1]), np.array([[0.0], [1.0]]))[0][:2, :, 0]
    return Report(tuple(rows.rows + table), *(float(value) for value in ends.reshape(-1)))


def _places(limits: Limits, quantity: Quantity) -> list[tuple[int, float]]:
    """Limits on a quantity with their axes, -1 of the path."""
    return list(enumerate(limits.of(quantity), start=0 if quantity in AXIS else -1))


def _check_table(curve: Curve, limits: Limits, profile: FeedrateProfile, rows: Rows) -> bool:
    """Check that the table is a time law over the whole curve; False where it cannot be evaluated at all."""
    columns = {name: getattr(profile, name) for name in _COLUMNS}
    t, u = profile.t, profile.u
    if t.ndim != 1 or t.size < 2 or any(column.shape != t.shape for column in columns.values()):
        shapes = ", ".join(f"{name} {column.shape}" for name, column in columns.items())
        raise InputError(
            f"the columns of the plan have the shapes {shapes}; they must be one-dimensional, equal, >= 2 long"
        )
    bad = ~np.isfinite(np.stack(list(columns.values()))).all(axis=0)
    at = int(np.argmax(bad))
    rows.add("finite values", int(bad.sum()), 0.0, (t[at], u[at]))
    if bad.any():
        return False
    back = np.concatenate([[abs(t[0])], np.maximum(-np.diff(t), 0.0)])
    at = int(np.argmax(back))
    late = t[-1] <= t[0]
    rows.add("time order", np.inf if late else back[at], 0.0, (t[at], u[at]))
    if late or back[at] > 0.0:
        return False
    u0, u1 = curve.domain
    per_u = extent(curve) / (u1 - u0)
    slack = ON_KNOT * extent(curve)
    rows.add("path start", abs(u[0] - u0) * per_u, 0.0, (t[0], u[0]), slack=slack)
    rows.add("path end", abs(u[-1] - u1) * per_u, 0.0, (t[-1], u[-1]), slack=slack)
    jump = np.where(np.diff(t) == 0.0, np.abs(np.diff(u)), 0.0)
    at = int(np.argmax(jump))
    rows.add("position step", jump[at] * per_u, 0.0, (t[at], u[at]), slack=slack)
    nodes = Nodes.of(curve, profile)
    off = np.max([column.used for column in nodes.columns()], axis=0)
    at = int(np.argmax(off))
    rows.add("table columns", off[at], 1.0, (t[at], u[at]))
    wrong = nodes.misnamed(profile.limits or limits)
    at = int(wrong[0]) if wrong.size else 0
    rows.add("binding limit", wrong.size, 0.0, (t[at], u[at]))
    return True

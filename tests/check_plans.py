"""Plans with a known motion, and what tests of the check need around them."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np

from planner import load_curve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.profile import make_profile
from planner.samples import Samples

# planner.verify is the function, not the package of the same name, so modules are asked for by name.
package = importlib.import_module("planner.verify")
searching = importlib.import_module("planner.verify.peaks")
check = package.check
AXIS_LIMITS = ("velocity", "acceleration", "jerk")
SINGLE_LIMITS = ("feed", "chord error", "tangential acceleration", "tangential jerk")
ELLIPSE = (40.0, 25.0)


def scurve(length, feed, acceleration, jerk, parts=1):
    """Nodes (t, s, v, a) of the seven constant-jerk phases from rest to rest, each cut into equal parts."""
    rise = acceleration / jerk
    hold = feed / acceleration - rise
    cruise = length / feed - (feed / acceleration + rise)
    assert hold > 0.0
    assert cruise > 0.0
    phases = [(rise, jerk), (hold, 0.0), (rise, -jerk), (cruise, 0.0), (rise, -jerk), (hold, 0.0), (rise, jerk)]
    rows = [(0.0, 0.0, 0.0, 0.0)]
    for duration, j in phases:
        t, s, v, a = rows[-1]
        for w in duration * np.arange(1, parts + 1) / parts:
            rows.append((t + w, s + v * w + a * w**2 / 2 + j * w**3 / 6, v + a * w + j * w**2 / 2, a + j * w))
    nodes = np.array(rows).T
    nodes[1:, -1] = length, 0.0, 0.0
    return nodes


def constant_feed(curve, feed, count):
    """Nodes (t, s, v, a) at constant feed, the knots of the curve among them."""
    s = np.linspace(0.0, curve.length, count + 1)
    knots = curve.arclength.s(curve._candidate_breaks())
    apart = np.abs(s[:, None] - knots).min(axis=1) if knots.size else np.full(s.size, np.inf)
    s = np.union1d(s[apart > 1e-9 * curve.length], knots)
    return np.stack([s / feed, s, np.full(s.size, feed), np.zeros(s.size)])


def lift(curve, motion, double=True):
    """Nodes (t, u, u_rate, u_acceleration) on a curve from nodes along its length; double ones at its knots."""
    t, s, v, a = motion
    u, knots = curve.arclength.u(s), curve._candidate_breaks()
    on_knot = np.zeros(u.size, dtype=bool)
    if knots.size:
        distance = np.abs(u[:, None] - knots)
        on_knot = distance.min(axis=1) < 1e-9
        u[on_knot] = knots[distance.argmin(axis=1)[on_knot]]
    i = np.repeat(np.arange(u.size), np.where(on_knot & double, 2, 1))
    before = np.append(i[1:] == i[:-1], False)
    d = np.where(before[:, None], curve.tip.derivatives(u[i], 2, side="left"), curve.tip.derivatives(u[i], 2))
    speed2 = np.sum(d[1] ** 2, axis=-1)
    bend = np.sum(d[1] * d[2], axis=-1)
    return t[i], u[i], v[i] / np.sqrt(speed2), a[i] / np.sqrt(speed2) - v[i] ** 2 * bend / speed2**2


def profile_on(curve, limits, nodes):
    return make_profile(curve, limits, TimeLaw(*nodes), method="test")


def plan_on(name, count=37):
    """A smooth law of time over a curve, whose nodes keep clear of its knots, so that spans begin between them."""
    curve = load_curve(name)
    u0, u1 = curve.domain
    x = np.linspace(0.0, 1.0, count)
    u = u0 + (u1 - u0) * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi))
    u[-1] = u1
    rate = (u1 - u0) * (1.0 - np.cos(2.0 * np.pi * x)) / 3.0
    nodes = (3.0 * x, u, rate, (u1 - u0) * 2.0 * np.pi * np.sin(2.0 * np.pi * x) / 9.0)
    return profile_on(curve, unlimited(curve.dim), nodes)


def with_columns(profile, **columns):
    """The plan with other values in some of its columns, those of the time law among them."""
    of_law = {name: columns.pop(name) for name in ("t", "u", "u_rate", "u_acceleration") if name in columns}
    return replace(profile, law=replace(profile.law, **of_law), **columns)


def nodes_of(profile):
    return [np.array(column) for column in (profile.t, profile.u, profile.u_rate, profile.u_acceleration)]


def sampled(curve, profile, period):
    """One point a period of the plan itself; the end point fills the last period."""
    count = int(np.ceil(profile.duration / period - 1e-9))
    t = np.arange(count + 1) * period
    u = profile.at(np.minimum(t, profile.duration)).u
    return Samples(period, t, u, curve.derivatives(u, 0)[0])


def unlimited(dim=2, **given_limits):
    free = [np.inf] * dim
    return Limits(**({"feed": np.inf, "velocity": free, "acceleration": free, "jerk": free} | given_limits))


def limits_at(report):
    """Limits that a plan in X and Y uses up exactly, by its own report."""
    rows = {name: [report.row(name, axis).worst for axis in "XY"] for name in AXIS_LIMITS}
    single = {name.replace(" ", "_"): report.row(name).worst for name in SINGLE_LIMITS}
    return Limits(**rows, **single)


def lowered(limits, name, axis_index, factor):
    key = name.replace(" ", "_")
    value = np.array(getattr(limits, key), dtype=float)
    if axis_index is None:
        value = float(value * factor)
    else:
        value[axis_index] *= factor
    return limits._replace(**{key: value})


def failing(report):
    return {(row.limit, row.axis) for row in report.violations}


def with_lengths(motion, lengths):
    """The same constant-jerk motion with nodes at further places."""
    t, s, v, a = motion
    extra = []
    for length in lengths:
        if np.abs(s - length).min() < 1e-9:
            continue
        k = int(np.searchsorted(s, length)) - 1
        j = (a[k + 1] - a[k]) / (t[k + 1] - t[k])
        roots = np.roots([j / 6, a[k] / 2, v[k], s[k] - length]) if abs(j) > 1e-9 else None
        w = (length - s[k]) / v[k] if roots is None else roots[np.argmin(abs(roots - (length - s[k]) / v[k]))].real
        extra.append((t[k] + w, length, v[k] + a[k] * w + j * w**2 / 2, a[k] + j * w))
    merged = np.concatenate([motion, np.array(extra).T.reshape(4, -1)], axis=1)
    return merged[:, np.argsort(merged[0])]


def tangential(curve, samples, acceleration, jerk):
    inf = [np.inf] * curve.dim
    limits = Limits(
        np.inf, inf, inf, inf, tangential_acceleration=acceleration, tangential_jerk=jerk, axes=curve.axes, period=1e-3
    )
    report = check(curve, limits, samples)
    return report.row("tangential acceleration"), report.row("tangential jerk")

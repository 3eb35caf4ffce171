"""What a profile says of its nodes, by numpy's arrays: the compiled pass over them gives the same bits on planar paths."""

import numpy as np

from planner.geometry.differential import chain_rule, curvature, rates_along
from planner.law import quintic_coefficients
from planner.machine.feed_limits import chord_feed_limit, commanded_feed
from planner.machine.limit_rows import limit_rows
from planner.profile import BINDING_SHARE
from planner.quantity import CHORD_ERROR, FEED, NONE, limit_names


def jerk_at_nodes(law):
    inner = np.diff(law.t) > 0.0
    gap = np.where(inner, np.diff(law.t), 1.0)
    ends = ((column[:-1], column[1:]) for column in (law.u, law.u_rate, law.u_acceleration))
    c = quintic_coefficients(gap, *zip(*ends, strict=True))
    at_end = 6.0 * c[3] + gap * (24.0 * c[4] + gap * 60.0 * c[5])
    forward = np.append(inner, False)
    return np.where(forward, np.append(6.0 * c[3], 0.0), np.append(0.0, at_end)), forward


def binding_at_nodes(curve, limits, law, slowed):
    """Time derivatives of the arc length (3, n), and the names of the limits that bind."""
    u3, forward = jerk_at_nodes(law)
    u, u1, u2 = law.u, law.u_rate, law.u_acceleration
    q, tip = (part.pieces.evaluate(u, 3, ~forward) for part in (curve, curve.tip))
    along = np.stack(rates_along(tip, u1, u2, u3))
    axis_rates = np.stack(chain_rule(q[1], q[2], q[3], u1[:, None], u2[:, None], u3[:, None]))
    with np.errstate(divide="ignore", invalid="ignore"):
        chord = along[0] / chord_feed_limit(curvature(tip), limits)
    used = {
        NONE: np.full(u.size, BINDING_SHARE),
        FEED.label: along[0] * slowed / commanded_feed(curve, limits, u, ~forward),
        CHORD_ERROR.label: np.nan_to_num(chord * slowed, nan=0.0, posinf=0.0),
    }
    for row in limit_rows(limits.on(curve)):
        rates = along if row.along else axis_rates[:, :, row.motion]
        terms = [w * rate * slowed**k for k, (w, rate) in enumerate(zip(row.weights, rates, strict=True), start=1) if w]
        value = np.sum(terms, axis=0)
        used[row.name] = value / np.where(value > 0.0, row.upper, row.lower)
    names, unlimited = limit_names(curve.axes), np.zeros(u.size)
    most = np.argmax(np.stack([used.get(name, unlimited) for name in names]), axis=0)
    return along, [names[k] for k in most]

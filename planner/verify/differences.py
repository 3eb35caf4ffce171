"""Check of samples by their differences, as a drive sees them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.errors import InputError
from planner.geometry.curve import Curve, FeedCaps
from planner.geometry.differential import dot, norm
from planner.machine.limits import Limits
from planner.quantity import AXIS, TANGENTIAL
from planner.samples import Samples
from planner.types import FloatArray
from planner.verify.chords import sample_chord
from planner.verify.findings import Place, Report, Rows
from planner.verify.scan import machine_caps
from planner.verify.sizes import EPS, extent, group_sizes, position_rounding
from planner.verify.tiplength import tip_steps

_PATH_TOLERANCE = 1e-9


def check_samples(curve: Curve, limits: Limits, samples: Samples, density: int, rows: Rows) -> Report:
    """Measure the differences of samples over one to three periods, and the chords between them."""
    if not _check_sequence(curve, samples, rows):
        return Report(tuple(rows.rows), np.nan, np.nan, np.nan, np.nan)
    table = rows.rows
    rows.rows = []
    period = samples.period
    u = np.clip(samples.u, *curve.domain)
    tip = curve.tip.derivatives(u, 0)[0]
    feeds = norm(np.diff(tip, axis=0)) / period
    tip_rounding = position_rounding(curve, u)
    k = int(feeds.argmax())
    if curve.feed_caps is None:
        rows.add("feed", feeds[k], limits.feed, _middle(samples, k + 0.5), slack=2.0 * tip_rounding / period)
    else:
        for name, caps in (("feed", machine_caps(curve.feed_caps, limits)), ("programmed feed", curve.feed_caps)):
            highest = _highest_caps(caps, u)
            k = int((feeds / highest).argmax())
            rows.add(name, feeds[k], highest[k], _middle(samples, k + 0.5), slack=2.0 * tip_rounding / period)
    worst, place = sample_chord(curve, samples, u, density, allowed=limits.chord_error, rounding=tip_rounding)
    rows.add("chord error", worst, limits.chord_error, place, slack=tip_rounding)
    # A position is known to half its last digit, its evaluation to about as much, and u moves it by |C_u| times half of
    # its own: e in all.  The n-th difference weighs its points with the binomials, whose sum is 2^n, so e costs at most
    # 2^n e / T^n; for the jerk 8 e / T^3.
    slope = np.abs(curve.derivatives(u, 1)[1] * u[:, None]).max(axis=0)
    rounding = EPS * (np.abs(samples.position).max(axis=0) + 0.5 * slope)
    moving, before = _held(samples, samples.position)
    for q in AXIS:
        n = q.order
        sizes = np.abs(np.diff(moving, n, axis=0)) / period**n
        for j in range(curve.dim):
            k = int(sizes[:, j].argmax())
            slack = 2.0**n * rounding[j] / period**n
            place = _middle(samples, k - before + 0.5 * n)
            rows.add(q.label, sizes[k, j], limits.of(q)[j], place, slack=slack, j=j)
    compared = bool(np.isfinite([limits.of(q) for q in TANGENTIAL]).any())
    steps, off = tip_steps(curve, u, exact=compared)
    moving, before = _held(samples, steps, resting=0.0)
    for q in TANGENTIAL:
        n = q.order
        size = np.abs(np.diff(moving, n - 1)) / period**n
        if size.size == 0:
            continue
        k = int(size.argmax())
        place = _middle(samples, k - before + 0.5 * n)
        rows.add(q.label, size[k], limits.of(q)[0], place, slack=2.0**n * off / period**n)
    change = np.diff(feeds) / period if feeds.size > 1 else np.zeros(1)
    ends = (feeds[0], feeds[-1], change[0], change[-1])
    return Report(tuple(rows.rows + table), *(float(value) for value in ends))


def _off_path(curve: Curve, u: FloatArray, apart: FloatArray) -> FloatArray:
    """Part of ``apart (m, dim)``, from C(u) to a position, that no digit of u accounts for.

    Where |C'| is large and u far from 0, as for a path of 1e7 mm within u = -67.09 .. -67.08, there are positions on the
    path between any two doubles.  A digit moves the point along the path, on a break either way, and never off it.
    """
    digit, off, least = EPS * np.abs(u), apart, dot(apart, apart)
    for side in ("right", "left"):
        slope = curve.derivatives(u, 1, side=side)[1]
        square = dot(slope, slope)
        nearest = np.divide(dot(apart, slope), square, out=np.zeros_like(u), where=square > 0.0)
        left = apart - slope * np.clip(nearest, -digit, digit)[:, None]
        nearer = dot(left, left) < least
        off, least = np.where(nearer[:, None], left, off), np.where(nearer, dot(left, left), least)
    return off


def _highest_caps(caps: FeedCaps, u: FloatArray) -> FloatArray:
    """Highest of the caps between each two samples: their mean feed is below it."""
    edges, cap = caps.edges, caps.feed
    first = np.clip(np.searchsorted(edges, u[:-1], side="right") - 1, 0, cap.size - 1)
    last = np.clip(np.searchsorted(edges, u[1:], side="left") - 1, first, cap.size - 1)
    bounds = np.stack([first, last + 1], axis=1).reshape(-1)
    return np.asarray(np.maximum.reduceat(np.append(cap, 0.0), bounds)[::2])


def _held(samples: Samples, values: FloatArray, resting: float | None = None) -> tuple[FloatArray, int]:
    """Samples, or steps between them, as the drives see them, and how many were put before the first.

    At an end at rest the point is held, three times for the third difference: the value there is repeated, or ``resting``
    put there.  At an end with a feed the path goes on: nothing is added, and the last period, which the end of the curve
    cuts short, is left out.
    """
    before = 3 if samples.start_feed == 0.0 else 0
    after = 3 if samples.end_feed == 0.0 else 0
    inner = values if after or values.shape[0] < 3 else values[:-1]
    width = [(before, after)] + [(0, 0)] * (values.ndim - 1)
    if resting is None:
        return np.pad(inner, width, mode="edge"), before
    return np.pad(inner, width, constant_values=resting), before


def _middle(samples: Samples, k: float) -> Place:
    """Time and parameter at a (half) index, the middle of the samples that a difference takes in."""
    k = min(max(k, 0.0), samples.t.size - 1.0)
    ends = [int(np.floor(k)), int(np.ceil(k))]
    return float(samples.t[ends].mean()), float(samples.u[ends].mean())


def _check_sequence(curve: Curve, samples: Samples, rows: Rows) -> bool:
    """Check that the samples are points of the whole curve, one a period; False where they cannot be measured."""
    t, u, position, period = samples.t, samples.u, samples.position, samples.period
    _require_shapes(curve, samples)
    bad = ~(np.isfinite(t) & np.isfinite(u) & np.isfinite(position).all(axis=1))
    at = int(np.argmax(bad))
    rows.add("finite values", int(bad.sum()), 0.0, (t[at], u[at]))
    if bad.any():
        return False
    off = np.abs(t - (np.round(t[0] / period) + np.arange(t.size)) * period)
    at = int(off.argmax())
    rows.add("sample times", off[at], 0.0, (t[at], u[at]), slack=4.0 * EPS * float(np.abs(t).max()))
    back = np.maximum(-np.diff(u), 0.0)
    at = int(back.argmax())
    rows.add("reversal", back[at] / period, 0.0, (t[at], u[at]))
    u0, u1 = curve.domain
    inside = np.clip(u, u0, u1)
    on_curve = curve.derivatives(inside, 0)[0]
    apart = np.abs(_off_path(curve, inside, position - on_curve))
    ranges = np.array([np.ptp(on_curve[:, j]) for j in range(curve.dim)])
    for j, size in enumerate(group_sizes(curve, ranges)):
        k = int(apart[:, j].argmax())
        rows.add("path error", apart[k, j], _PATH_TOLERANCE * (size + 1.0), (t[k], u[k]), j=j)
    ends = curve.derivatives(np.array([u0, u1]), 0)[0]
    per_u = extent(curve) / (u1 - u0)
    for name, k, end in (("path start", 0, u0), ("path end", -1, u1)):
        missing = max(float(np.abs(position[k] - ends[k]).max()), abs(float(u[k]) - end) * per_u)
        rows.add(name, missing, 0.0, (t[k], u[k]), slack=4.0 * EPS * float(np.abs(ends[k]).max()))
    return True


def _require_shapes(curve: Curve, samples: Samples) -> None:
    t, u, position = samples.t, samples.u, samples.position
    if not (np.isfinite(samples.period) and samples.period > 0.0):
        raise InputError(f"period = {samples.period!r} of the samples must be > 0 and finite")
    if t.ndim != 1 or t.size < 2 or u.shape != t.shape:
        raise InputError(f"the samples have t {t.shape} and u {u.shape}; both must be (m,) with m >= 2")
    wanted: Sequence[int] = (t.size, curve.dim)
    if position.shape != tuple(wanted):
        raise InputError(
            f"the samples' positions have the shape {position.shape}; {t.size} samples of {curve.name} with its axes "
            f"{', '.join(curve.axes)} need {tuple(wanted)}"
        )

"""The columns of a plan that follow from its time law: arc length, feed, acceleration, jerk, and the limit that binds.

A node is seen from the interval after it; before a break, and at the end, from the one before it.  Everything is measured
anew there from the curve and the time law; no column is believed.

The limit named at a node must be the one of which most is used, but for ``BINDING_TOLERANCE``; "none" counts as a limit
of which ``BINDING_SHARE`` is used, so it must be named where nothing is used more, and nowhere else.  A plan that was slowed
down as a whole says by how much (``slowed``); its limits count as they were used before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import BINDING_SHARE, FeedrateProfile
from planner.quantity import CHORD_ERROR, FEED, NONE, with_label
from planner.types import FloatArray, IntArray
from planner.verify.kept_chords import without_kept_chords
from planner.verify.motion import Quintics, measure_points
from planner.verify.quantities import names
from planner.verify.scan import machine_caps

BINDING_TOLERANCE = 1e-3  # of a limit
# What rounding on another machine may do to the columns: to arc length against that of the curve, to feed against the
# largest, to acceleration and jerk against the terms of which they are the sum.
_PLACE, _FEED, _RATE = 1e-9, 1e-9, 1e-9
_NO_DIGITS = 1e-300  # mm/s^2, mm/s^3; numbers as small as these, and what they are made of, have lost their digits
_HUGE = float(np.finfo(np.float64).max)  # in place of what overflows
_SLACKS = 4.0  # as many times what the rounding of the tabulated numbers can change in a jerk


@dataclass(frozen=True, eq=False)
class ImpliedColumn:
    """A column that follows from the time law.

    Attributes
    ----------
    name : str
        Attribute of the profile.
    shown, expected : (n,) arrays
        What the plan says and what follows from its time law.
    granted : (n,) array
        What they may differ by.
    """

    name: str
    shown: FloatArray
    expected: FloatArray
    granted: FloatArray

    @property
    def used(self) -> FloatArray:
        """Difference over what is granted, (n,)."""
        shown, expected, granted = map(np.ascontiguousarray, (self.shown, self.expected, self.granted))
        used = np.empty(shown.size)
        core.columns_used(used.size, shown, expected, granted, used)
        return used


@dataclass(frozen=True, eq=False)
class Nodes:
    """What a plan does at its nodes: quantities as in :mod:`planner.verify.quantities`, (k, n), and their slack."""

    curve: Curve
    profile: FeedrateProfile
    left: FloatArray
    bend: FloatArray  # curvature of the path of the tip, inf where it rests
    values: FloatArray
    slack: FloatArray
    terms: FloatArray  # (3, n): sizes of the terms that feed, acceleration and jerk of the tip are sums of

    @classmethod
    def of(cls, curve: Curve, profile: FeedrateProfile) -> Nodes:
        """Measure the nodes of a plan whose times increase."""
        law = Quintics.of(profile)
        moves = np.diff(profile.t) > 0.0
        left = ~np.append(moves, False)
        interval = np.maximum(np.cumsum(np.append(moves, False)) - np.append(moves, False) - left, 0)
        u = np.clip(profile.u, *curve.domain)
        # By the compiled pieces, as whoever writes the columns: of a fitted curve these have the third derivative.
        d = curve.pieces.evaluate(u, 3, left)
        tip = d if curve.tip is curve else curve.tip.pieces.evaluate(u, 3, left)
        third = law.rates(interval, left[:, None].astype(np.float64))[2, :, 0]
        rates = np.ascontiguousarray(np.stack([profile.u_rate, profile.u_acceleration, third])[:, :, None])
        values, slack = measure_points(d, tip, tip is d, rates, np.ascontiguousarray(law.slack[interval]))
        terms, bend = np.empty((3, u.size)), np.empty(u.size)
        core.columns_terms(u.size, tip.shape[2], tip, rates, values, terms, bend)
        return cls(curve, profile, left, bend, values[:, :, 0], slack[:, :, 0], terms)

    def columns(self) -> Iterator[ImpliedColumn]:
        """Arc length, feed, acceleration and jerk along the path."""
        profile, length = self.profile, self.curve.length or 1.0
        place = self.curve.arclength.s(np.clip(profile.u, *self.curve.domain))
        yield ImpliedColumn("s", profile.s, place, np.full(place.size, _PLACE * length))
        scale = max(float(np.abs(profile.feed).max()), 1e-300)
        yield ImpliedColumn("feed", profile.feed, self.values[0], np.full(place.size, _FEED * scale))
        for k, name in ((1, "acceleration"), (2, "jerk")):
            granted = _RATE * self.terms[k] + _SLACKS * self.slack[k] + _NO_DIGITS
            yield ImpliedColumn(name, getattr(profile, name), self.values[k], granted)

    def shares(self, limits: Limits) -> dict[str, tuple[FloatArray, FloatArray]]:
        """How much of each limit is used at the nodes, and what rounding can change in that, by the limit's name.

        A use that is no number counts as none.
        """
        labels, share, slack = self._uses(limits)
        return dict(zip(labels, zip(share, slack, strict=True), strict=True))

    def _uses(self, limits: Limits) -> tuple[list[str], FloatArray, FloatArray]:
        """Names of the limits (k), how much of each is used and what rounding can change in that, (k, n)."""
        profile, curve = self.profile, self.curve
        feed, count = np.abs(self.values[0]), profile.t.size
        caps: FloatArray | float = limits.feed
        if curve.feed_caps is not None:
            u = np.clip(profile.u, *curve.domain)
            sides = np.asarray(self.left, dtype=np.bool_)
            caps = np.minimum(machine_caps(curve.feed_caps, limits).at(u, sides), curve.feed_caps.at(u, sides))
        slowed = _slowed(profile) if profile.slowed else np.float64(1.0)
        # Of the chord its length, not its error.
        chord = _chord_share(self.bend, feed * limits.period, without_kept_chords(self.curve, limits).chord_error)
        rows = [(row, with_label(name), j) for row, (name, j) in enumerate(names(curve.dim))]
        others = [(row, quantity, j) for row, quantity, j in rows if quantity is not None and quantity is not FEED]
        labels = [NONE, FEED.label, CHORD_ERROR.label]
        first = len(labels)
        share, slack = np.empty((2, first + len(others), count))
        slack[:first] = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            share[0], share[1], share[2] = BINDING_SHARE, feed / caps * slowed, chord * slowed
        share[:first] = np.fmin(np.fmax(share[:first], 0.0), _HUGE)
        allowed = np.array([float(limits.of(quantity)[max(j, 0)]) for _, quantity, j in others])
        rate = np.stack([slowed**quantity.power for _, quantity, _ in others]) if profile.slowed else None
        on = np.array([row for row, *_ in others])
        core.columns_shares(count, on.size, on, allowed, rate, self.values, self.slack, share[first:], slack[first:])
        labels += [quantity.of(curve.axes[j] if j >= 0 else "") for _, quantity, j in others]
        return labels, share, slack

    def misnamed(self, limits: Limits) -> IntArray:
        """Nodes at which another limit is used more than the one that is named."""
        profile = self.profile
        labels, every, slack = self._uses(limits)
        row = np.array([labels.index(name) if name in labels else -1 for name in profile.limit_names])
        known = (profile.binding >= 0) & (profile.binding < len(profile.limit_names))
        at = np.where(known, row[np.where(known, profile.binding, 0)], -1)
        wrong = np.empty(at.size, dtype=np.bool_)
        core.columns_misnamed(at.size, every.shape[0], every, slack, at, BINDING_TOLERANCE, _SLACKS, wrong)
        return np.flatnonzero(wrong)


def _slowed(profile: FeedrateProfile) -> FloatArray:
    """By which factor the plan was slowed down at each node."""
    factor = np.ones(profile.t.size)
    for node, value in profile.slowed:
        factor[node:] = value
    return factor


def _chord_share(bend: FloatArray, chord: FloatArray, allowed: float) -> FloatArray:
    """Share of the longest chord that stays within ``allowed`` of a circle with the curvature ``bend``.

    A chord c leaves a circle of radius r by r - sqrt(r^2 - c^2 / 4); a chord as long as the circle is wide leaves it by r.
    Without a limit nothing of it is used, however tight the circle.
    """
    if np.isinf(allowed):
        return np.zeros_like(bend)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        radius = 1.0 / bend
        error = np.minimum(allowed, radius)
        longest = 2.0 * np.sqrt(error) * np.sqrt(2.0 * radius - error)
        share = chord / longest
    return np.asarray(np.where(np.isfinite(radius) & np.isfinite(share), share, 0.0))

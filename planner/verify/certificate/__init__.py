"""Verification of a lower bound from its certificate, the curve and the limits alone.

**What is proved.**  For any continuous l_j and any m_j along the path with sum |l_j| <= 1, and f_j = m_j / A_j - l_j' / J_j,
every plan takes at least (``docs/certificate.md`` has the proof)

    sum over sections of  int min over 0 < x <= cap of [(1 - sum |l|) x^(-1/2) + g x] dsigma - int sum |m| dsigma
                          + what the places between pieces and the ends cost                       (``atoms.py``).

The multipliers come from the certificate, everything else from the curve: its derivatives, its corners and curvature
jumps, and the caps by feed, axis velocity, chord error and the way from a stop (``pathspeeds.py``).  Where sum |l|
exceeds 1 all multipliers of the section are scaled down together.  So a certificate with other multipliers proves
another bound, and none proves a false one.

Exact up to rounding: sum |l| <= 1 (quadratics), the integral of sum |m|, the minimum at every point, the increase of
u(sigma), and the prices of single places.

Estimated: the integral between its points, as the disagreement of Gauss sums over halved parts; what is reported as
``allowance`` is the sum of their sizes, and it is subtracted.  A curve that hides a feature between points an eighth of
1/16 of a smooth stretch apart is not seen.  The ways from a stop are Gauss sums, made longer by 1e-6.

**For which plans.**  Those that pass the check, rest (without acceleration in whatever has a jerk limit) at the stops
that the report names, and change their acceleration by a step at curvature jumps only.  With a chord error limit: those
that keep to the feed at which the osculating circle has that error, as every method here does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from planner.certificate import Certificate, CertificateSection
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.geometry.differential import dot
from planner.inputs import require_instance
from planner.machine.limits import Limits, require_limits
from planner.profile import FeedrateProfile
from planner.quantity import ACCELERATION, JERK, Quantity, motion_names
from planner.types import FloatArray, IntArray
from planner.verify.certificate.atoms import SideTerms, end_term, passed, seam, sides, spared_around, stepped
from planner.verify.certificate.multipliers import Multipliers, require_increasing
from planner.verify.certificate.pathspeeds import Flags, path_points
from planner.verify.certificate.quadrature import SectionPath, Stretches, stretches_of
from planner.verify.certificate.shapes import require_valid
from planner.verify.kept_chords import without_kept_chords
from planner.verify.places import Places
from planner.verify.sizes import EPS, ON_KNOT

_CLAIM_ROUNDING = 1e-9  # of the bound: what another order of summation may change
_PLAN_TOLERANCE = 1e-6  # by which a plan may exceed its limits, and so be faster
_FEED_TOLERANCE = 1e-6  # of the largest feed: what counts as the same feed
_REVERSAL_SAMPLES = 65  # of a piece of the curve
_SEAM_TOLERANCE = 1e-6  # of tangent and curvature (times the length) where a periodic path closes


@dataclass(frozen=True)
class BoundReport:
    """What :func:`verify_bound` found.

    Attributes
    ----------
    proved : float
        Every plan named in ``statement`` takes at least so long, s.
    claimed : float
        What the certificate says, s.
    allowance : float
        What was subtracted for the quadrature, s.
    scale : float
        Smallest factor by which the multipliers of a section were scaled down; 1 where none were.
    stops : tuple of float
        Curve parameters, besides corners and ends, at which the certificate assumes that plans stop.
    statement : str
        What is proved, and for which plans.
    claimant : str
        Who claims it: "it" the certificate, or the table.
    duration : float
        Of the plan at hand, s; inf where there is none.
    other_limits : bool
        The plan was made for other limits than those that the bound was verified for.
    """

    proved: float
    claimed: float
    allowance: float
    scale: float
    stops: tuple[float, ...]
    statement: str
    claimant: str = "it"
    duration: float = np.inf
    other_limits: bool = False

    @property
    def ok(self) -> bool:
        """The certificate proves what is claimed, and no plan at hand denies it."""
        return not self.refusal

    @property
    def refusal(self) -> str:
        """What is wrong with the claim; empty where nothing is."""
        if not self.claimed <= self.proved + _CLAIM_ROUNDING * abs(self.proved):
            found = f"{self.proved:.9g} s" if self.proved > 0.0 else "nothing for these limits"
            hint = "; the plan was made for other limits than these: give those" if self.other_limits else ""
            return f"the certificate proves {found}, not the {self.claimed:.9g} s that {self.claimant} claims{hint}"
        if self.proved > self.duration * (1.0 + _PLAN_TOLERANCE):
            return (
                f"the certificate proves {self.proved:.9g} s, but the plan takes {self.duration:.9g} s: if it passes its "
                "check, this is an error of this program"
            )
        return ""


def verify_bound(curve: Curve, limits: Limits, certificate: Certificate) -> BoundReport:
    """Evaluate the lower bound that a certificate proves, by none of the code that found it.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        Those of the plans; the bound holds for these, whatever the multipliers were found with.
    certificate : Certificate

    Returns
    -------
    BoundReport

    Raises
    ------
    InputError
        If the certificate is for another curve, does not cover it, has a section that passes a corner or a knot of the
        curve without one of its own, or holds arrays that are no multipliers.
    """
    limits = without_kept_chords(curve, require_limits(curve, limits))
    require_instance(certificate, Certificate, "certificate")
    require_valid(certificate, curve)
    places = Places.of(curve)
    sections = [_SectionOnCurve.of(curve, limits, certificate, k, places) for k in range(len(certificate.sections))]
    _require_tangent(curve, sections)
    scales = [section.scale() for section in sections]
    if certificate.periodic:  # the multipliers must still meet where the path closes
        scales = [min(scales)] * len(scales)
    sections = [section.scaled(scale) for section, scale in zip(sections, scales, strict=True)]
    found = [section.value() for section in sections]
    total, allowance = (float(sum(values)) for values in zip(*found, strict=True))
    if certificate.periodic:
        total += _closing(sections, certificate)
    proved = total - allowance
    inner = np.array([section.u[0, -1] for section in certificate.sections[:-1]])
    stops = tuple(float(u) for u in inner[~places.on(places.corners, inner)])
    statement = _statement(curve, limits, certificate, stops, proved, steps=places.jumps.size > 0)
    return BoundReport(proved, float(certificate.bound), allowance, min(scales), stops, statement)


def verify_plan_bound(curve: Curve, limits: Limits, certificate: Certificate, plan: FeedrateProfile) -> BoundReport:
    """Verify a certificate and what a plan claims by it: that no plan with the same stops and ends is faster.

    Raises InputError as :func:`verify_bound`, and where the certificate is about plans with other ends or other stops.
    """
    require_instance(certificate, Certificate, "certificate")
    require_instance(plan, FeedrateProfile, "plan")
    largest = float(plan.feed.max())
    first, last = certificate.sections[0], certificate.sections[-1]
    for name, said, found in (("begin", first.start_feed, plan.feed[0]), ("end", last.end_feed, plan.feed[-1])):
        if np.isfinite(said) and abs(said - found) > _FEED_TOLERANCE * largest:
            raise InputError(
                f"the certificate is about plans that {name} with {said:.6g} mm/s; this plan {name}s with {found:.6g} mm/s"
            )
    if np.isfinite(first.start_acceleration):
        size = max(float(np.abs(plan.acceleration).max()), abs(first.start_acceleration))
        if abs(first.start_acceleration - plan.acceleration[0]) > _FEED_TOLERANCE * size:
            raise InputError(
                f"the certificate is about plans that begin with {first.start_acceleration:.6g} mm/s^2; this plan begins "
                f"with {plan.acceleration[0]:.6g} mm/s^2"
            )
    report = verify_bound(curve, limits, certificate)
    near = ON_KNOT * (curve.domain[1] - curve.domain[0])
    for u in report.stops:
        at = np.abs(plan.u - u) <= near
        if not at.any() or plan.feed[at].min() > _FEED_TOLERANCE * largest:
            raise InputError(f"the certificate is about plans that stop at u = {u:.9g}; this plan passes there")
    by_table = plan.lower_bound > report.claimed
    return replace(
        report,
        claimed=float(plan.lower_bound) if by_table else report.claimed,
        claimant="the table" if by_table else "it",
        duration=plan.duration,
        other_limits=plan.limits is not None and plan.limits != limits,
    )


@dataclass(frozen=True, eq=False)
class _SectionOnCurve:
    """A section of a certificate on its curve, laid out for the integral."""

    data: CertificateSection
    path: SectionPath
    stretches: Stretches
    joins: IntArray  # intervals before the places between pieces
    jumps: Flags  # whether the curvature jumps there

    @classmethod
    def of(cls, curve: Curve, limits: Limits, certificate: Certificate, k: int, places: Places) -> _SectionOnCurve:
        data = certificate.sections[k]
        jerk = [_motion(curve, name, JERK) for name in certificate.jerk_names]
        acceleration = [_motion(curve, name, ACCELERATION) for name in certificate.acceleration_names]
        parts = Multipliers.of(data, jerk, acceleration, curve.dim + 1)
        require_increasing(parts, f"section {k}")
        breaks, jumps = places.inside(data, f"section {k} of the certificate")
        rests = data.start_feed == 0.0, data.end_feed == 0.0
        speeds = np.stack([_end_speeds(curve, limits, parts, feed, at) for at, feed in enumerate(_feeds(data))])
        path = SectionPath(curve, limits, parts, speeds)
        double = np.flatnonzero(np.diff(parts.knot) > 1)
        u = parts.u[1, :-1]
        at = np.union1d(double, np.flatnonzero(places.on(breaks, u)))
        return cls(data, path, stretches_of(path, rests, breaks, jumps), at, places.on(jumps, u[at]))

    def scale(self) -> float:
        """Factor by which the multipliers have to shrink until sum |l| <= 1."""
        s = self.stretches
        load = float(self.path.parts.largest_load(s.interval, s.lower, s.upper).max())
        return 1.0 if load <= 1.0 else (1.0 - 8.0 * EPS) / load

    def scaled(self, factor: float) -> _SectionOnCurve:
        """Scale every multiplier."""
        path = SectionPath(self.path.curve, self.path.limits, self.path.parts.scaled(factor), self.path.speeds)
        return _SectionOnCurve(self.data, path, self.stretches, self.joins, self.jumps)

    def value(self) -> tuple[float, float]:
        """Lower bound on the time of the section but for a periodic seam, and what its quadrature may be off."""
        integral, allowance = self.path.integral(self.stretches)
        return integral - self.path.parts.acceleration_price() + self._between() + self._ends(), allowance

    def side(self, end: int) -> SideTerms:
        """The section's start (0) or end (1), from inside."""
        at = 0 if end == 0 else self.path.parts.h.size - 1
        return sides(self.path, self.stretches, np.array([at]), end)[0]

    def _between(self) -> float:
        """Price of the places between pieces."""
        at, jumps = self.joins, self.jumps
        if at.size == 0:
            return 0.0
        before, after = sides(self.path, self.stretches, at, 1), sides(self.path, self.stretches, at + 1, 0)
        at_jump = np.flatnonzero(jumps)
        spared = np.zeros((self.path.curve.dim + 1, at.size))
        if at_jump.size:
            _, least = self.path.sums(self.stretches)
            times = np.append(0.0, np.cumsum(least))
            part = np.searchsorted(self.stretches.interval, at[at_jump], side="right")
            spared[:, at_jump] = spared_around(self.path, self.stretches, times, times[part])
        return sum(
            stepped(a, b, self.path, spared[:, k]) if jumps[k] else passed(a, b)
            for k, (a, b) in enumerate(zip(before, after, strict=True))
        )

    def _ends(self) -> float:
        """Price of the ends: nothing at a rest, where neither speed nor acceleration is left."""
        price = 0.0
        start, end = _feeds(self.data)
        if start > 0.0:
            price += end_term(self.side(0), self.path, start, self.data.start_acceleration, -1.0)
        if end > 0.0:
            price += end_term(self.side(1), self.path, end, np.nan, 1.0)
        return price


def _feeds(data: CertificateSection) -> tuple[float, float]:
    return float(data.start_feed), float(data.end_feed)


def _end_speeds(curve: Curve, limits: Limits, parts: Multipliers, feed: float, end: int) -> FloatArray:
    """Speed of every motion at an end (K,): 0 at rest, by the feed, inf where it is free."""
    if feed == 0.0:
        return np.zeros(curve.dim + 1)
    i = np.array([0 if end == 0 else parts.h.size - 1])
    first = path_points(curve, limits, parts, i, np.array([float(end)]), np.array([end == 1])).first[:, 0]
    if np.isnan(feed) or not first[-1] > 0.0:
        return np.full(curve.dim + 1, np.inf)
    return np.asarray(np.abs(first) * (feed / first[-1]))


def _motion(curve: Curve, name: str, quantity: Quantity) -> int:
    """Index of the motion that a limit is of: an axis, or after them the tip's arc length."""
    names = motion_names(quantity.order, curve.axes)
    if name not in names:
        raise InputError(f'the certificate has multipliers of "{name}"; known are {", ".join(names)}')
    return names.index(name)


def _require_tangent(curve: Curve, sections: Sequence[_SectionOnCurve]) -> None:
    """Refuse multipliers of tangential limits where the tip turns back: its arc length has no second derivative there."""
    linear = np.array([unit == "mm" for unit in curve.axis_units])
    used = any(section.path.parts.jerk[-1].any() or section.path.parts.acceleration[-1].any() for section in sections)
    if linear.all() or not used:
        return
    edges = np.concatenate([[curve.domain[0]], curve._candidate_breaks(), [curve.domain[1]]])
    for lo, hi in pairwise(edges):
        u = np.linspace(lo, hi, _REVERSAL_SAMPLES)[1:-1]
        velocity = curve.derivatives(u, 1)[1][:, linear]
        back = np.flatnonzero(dot(velocity[1:], velocity[:-1]) < 0.0)
        if back.size:
            raise InputError(
                f"the certificate has multipliers of tangential limits, but the tip of {curve.name} turns back near u = "
                f"{u[back[0]]:.6g}, where its arc length has no second derivative; leave them out"
            )


def _closing(sections: Sequence[_SectionOnCurve], certificate: Certificate) -> float:
    """Price of the place where a periodic path closes."""
    first, last = sections[0], sections[-1]
    start, end = first.side(0), last.side(1)
    curve = first.path.curve
    if np.abs(start.turn - end.turn).max() > _SEAM_TOLERANCE:
        raise InputError(
            f"the certificate is periodic, but {curve.name} has another direction at its end than its start"
        )
    bend = max(float(np.abs([start.bend, end.bend]).max()), 1.0 / max(curve.length, 1e-300))
    smooth = bool(np.abs(start.bend - end.bend).max() <= _SEAM_TOLERANCE * bend)
    return seam(end, start, first.path, smooth)


def _statement(
    curve: Curve, limits: Limits, certificate: Certificate, stops: Sequence[float], proved: float, *, steps: bool
) -> str:
    """Say what is proved for which plans."""
    first, last = certificate.sections[0], certificate.sections[-1]
    if certificate.periodic:
        ends = "that pass its end into its start"
    else:
        start, end = (f"{feed:.6g} mm/s" if feed > 0.0 else "rest" for feed in (first.start_feed, last.end_feed))
        ends = f"from {start} to {end}"
        if np.isfinite(first.start_acceleration):
            ends += f", beginning with {first.start_acceleration:.6g} mm/s^2"
    if not proved > 0.0:
        return f"nothing for these limits about plans of {curve.name} {ends}"
    parts = [f"no plan of {curve.name} {ends} that keeps these limits takes less than {proved:.9g} s"]
    if stops:
        shown = ", ".join(f"{u:.6g}" for u in stops[:8]) + (", ..." if len(stops) > 8 else "")
        parts.append(f"for plans that stop at u = {shown} ({len(stops)} besides corners)")
    if np.isfinite(limits.chord_error):
        parts.append("for plans within the feed of the chord error by the osculating circle at every point")
    if steps:
        parts.append("for plans whose acceleration steps at curvature jumps only")
    return "; ".join(parts)

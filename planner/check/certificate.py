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
from dataclasses import dataclass

import numpy as np

from planner.certificate import Certificate, CertificateSection
from planner.check.atoms import Side, end_term, passed, seam, sides, spared_around, stepped
from planner.check.multipliers import IntArray, Multipliers, require_increasing
from planner.check.pathspeeds import Flags, path_points
from planner.check.quadrature import SectionPath, Stretches, lay_out
from planner.check.sizes import EPS, ON_KNOT
from planner.errors import InputError
from planner.geometry.curve import Curve, FloatArray
from planner.limits import Limits

_CLAIM_ROUNDING = 1e-9  # of the bound: what another order of summation may change
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
    """

    proved: float
    claimed: float
    allowance: float
    scale: float
    stops: tuple[float, ...]
    statement: str

    @property
    def ok(self) -> bool:
        """The certificate proves what it claims."""
        return self.claimed <= self.proved * (1.0 + _CLAIM_ROUNDING)


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
    limits.require_matches(curve)
    require_valid(certificate, curve)
    sections = [_Section.of(curve, limits, certificate, k) for k in range(len(certificate.sections))]
    scales = [section.scale() for section in sections]
    if certificate.periodic:  # the multipliers must still meet where the path closes
        scales = [min(scales)] * len(scales)
    sections = [section.scaled(scale) for section, scale in zip(sections, scales, strict=True)]
    found = [section.value() for section in sections]
    total, allowance = (float(sum(values)) for values in zip(*found, strict=True))
    if certificate.periodic:
        total += _closing(sections, certificate)
    proved = total - allowance
    stops = _assumed_stops(curve, certificate)
    statement = _statement(curve, limits, certificate, stops, proved)
    return BoundReport(proved, float(certificate.bound), allowance, min(scales), stops, statement)


@dataclass(frozen=True, eq=False)
class _Section:
    """A section of a certificate on its curve, laid out for the integral."""

    data: CertificateSection
    path: SectionPath
    stretches: Stretches
    joins: IntArray  # intervals before the places between pieces
    jumps: Flags  # whether the curvature jumps there

    @classmethod
    def of(cls, curve: Curve, limits: Limits, certificate: Certificate, k: int) -> _Section:
        data = certificate.sections[k]
        jerk = [_motion(curve, name, "jerk") for name in certificate.jerk_names]
        acceleration = [_motion(curve, name, "acceleration") for name in certificate.acceleration_names]
        parts = Multipliers.of(data, jerk, acceleration, curve.dim + 1)
        require_increasing(parts, f"section {k}")
        breaks, jumps = _inner_breaks(curve, data, k)
        rests = data.start_feed == 0.0, data.end_feed == 0.0
        speeds = np.stack([_end_speeds(curve, limits, parts, feed, at) for at, feed in enumerate(_feeds(data))])
        path = SectionPath(curve, limits, parts, speeds)
        double = np.flatnonzero(np.diff(parts.knot) > 1)
        u = parts.u[1, :-1]
        near = ON_KNOT * (curve.domain[1] - curve.domain[0])
        at = np.union1d(double, np.flatnonzero(_is_near(u, breaks, near)))
        return cls(data, path, lay_out(path, rests, breaks, jumps), at, _is_near(u[at], jumps, near))

    def scale(self) -> float:
        """Factor by which the multipliers have to shrink until sum |l| <= 1."""
        s = self.stretches
        load = float(self.path.parts.largest_load(s.interval, s.lower, s.upper).max())
        return 1.0 if load <= 1.0 else (1.0 - 8.0 * EPS) / load

    def scaled(self, factor: float) -> _Section:
        """Scale every multiplier."""
        path = SectionPath(self.path.curve, self.path.limits, self.path.parts.scaled(factor), self.path.speeds)
        return _Section(self.data, path, self.stretches, self.joins, self.jumps)

    def value(self) -> tuple[float, float]:
        """Lower bound on the time of the section but for a periodic seam, and what its quadrature may be off."""
        integral, allowance = self.path.integral(self.stretches)
        return integral - self.path.parts.acceleration_price() + self._between() + self._ends(), allowance

    def side(self, end: int) -> Side:
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


def _is_near(u: FloatArray, places: FloatArray, tolerance: float) -> Flags:
    """Which parameters u lie on one of the increasing places."""
    if places.size == 0:
        return np.zeros(u.shape, dtype=bool)
    k = np.clip(np.searchsorted(places, u), 1, places.size) - 1
    distance = np.minimum(np.abs(u - places[k]), np.abs(u - places[np.minimum(k + 1, places.size - 1)]))
    return np.asarray(distance <= tolerance)


def _inner_breaks(curve: Curve, data: CertificateSection, k: int) -> tuple[FloatArray, FloatArray]:
    """Parameters inside a section at which the curve has knots, and those at which its curvature jumps."""
    near = ON_KNOT * (curve.domain[1] - curve.domain[0])
    u0, u1 = float(data.u[0, 0]), float(data.u[0, -1])

    def inside(u: FloatArray) -> FloatArray:
        return u[(u > u0 + near) & (u < u1 - near)]

    breaks = inside(curve._candidate_breaks())
    missing = breaks[~_is_near(breaks, np.unique(data.u[0]), near)]
    if missing.size:
        raise InputError(f"section {k} of the certificate has no knot at u = {missing[0]:.9g}, where the curve has one")
    corners = inside(np.array([b.u for b in curve.breaks if b.geometric == 0]))
    if corners.size:
        raise InputError(
            f"section {k} of the certificate passes the corner at u = {corners[0]:.9g}; every plan stops there, so a "
            "section must end there"
        )
    return breaks, inside(np.array([b.u for b in curve.breaks if b.geometric == 1]))


def _motion(curve: Curve, name: str, what: str) -> int:
    """Index of the motion that a limit is of: an axis, or after them the tip's arc length."""
    names = [*(f"{what} {axis}" for axis in curve.axes), f"tangential {what}"]
    if name not in names:
        raise InputError(f'the certificate has multipliers of "{name}"; known are {", ".join(names)}')
    return names.index(name)


def _closing(sections: Sequence[_Section], certificate: Certificate) -> float:
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


def require_valid(certificate: Certificate, curve: Curve) -> None:
    """Raise InputError unless the certificate is one of this curve: its arrays fit, and its sections cover it."""
    if certificate.fingerprint != curve.fingerprint:
        raise InputError(
            f"the certificate is for another curve (hash {certificate.fingerprint[:12]}), not for {curve.name} "
            f"({curve.fingerprint[:12]}); give the curve, and the scale and tolerance, it was made with"
        )
    require_shapes(certificate)
    u0, u1 = curve.domain
    near = ON_KNOT * (u1 - u0)
    ends = [(float(s.u[0, 0]), float(s.u[0, -1])) for s in certificate.sections]
    meet = [u0, *(end for _, end in ends)], [*(start for start, _ in ends), u1]
    for before, after in zip(*meet, strict=True):
        if abs(before - after) > near:
            raise InputError(f"the certificate leaves out the curve between u = {before!r} and {after!r}")


def require_shapes(certificate: Certificate) -> None:
    """Raise InputError unless every array has its shape and finite values, and the ends make sense."""
    for names in (certificate.jerk_names, certificate.acceleration_names):
        if len(set(names)) != len(names):
            raise InputError(f"the certificate names a limit twice: {', '.join(names)}")
    if not certificate.sections:
        raise InputError("the certificate has no section")
    if not np.isfinite(certificate.bound):
        raise InputError(f"bound = {certificate.bound!r} of the certificate must be finite")
    last = len(certificate.sections) - 1
    for k, section in enumerate(certificate.sections):
        _require_arrays(section, certificate, f"section {k} of the certificate")
        for name, feed, outer in (("start", section.start_feed, k == 0), ("end", section.end_feed, k == last)):
            free = certificate.periodic and outer
            if not (np.isnan(feed) if free else np.isfinite(feed) and feed >= 0.0 and (outer or feed == 0.0)):
                allowed = "nan, free" if free else "0, a stop" if not outer else ">= 0 and finite"
                raise InputError(f"section {k} of the certificate: {name}_feed = {feed!r} must be {allowed}")
        if not np.isnan(section.start_acceleration) and not (
            section.start_feed > 0.0 and np.isfinite(section.start_acceleration)
        ):
            raise InputError(
                f"section {k} of the certificate: start_acceleration = {section.start_acceleration!r} must be nan, or "
                "finite at a start with a feed"
            )


def _require_arrays(section: CertificateSection, certificate: Certificate, where: str) -> None:
    n = section.sigma.size
    shapes = {
        "sigma": (n,),
        "u": (3, n),
        "jerk": (len(certificate.jerk_names), n + 1),
        "acceleration": (len(certificate.acceleration_names), n),
    }
    for name, shape in shapes.items():
        values = getattr(section, name)
        if values.shape != shape or values.dtype != np.float64 or n < 2:
            raise InputError(
                f"{where}: {name} is {values.dtype} {values.shape}; must be float64 {shape}, of 2 knots at least"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{where}: {name} has a value that is not finite")
    step, u = np.diff(section.sigma), section.u[0]
    bad = np.flatnonzero(step < 0.0)
    if bad.size:
        raise InputError(f"{where}: sigma[{bad[0] + 1}] = {section.sigma[bad[0] + 1]!r} is less than the one before")
    double = np.flatnonzero(step == 0.0)
    if double.size and (double[0] == 0 or double[-1] == n - 2 or (np.diff(double) == 1).any()):
        raise InputError(f"{where}: no knot may be threefold, and none at the ends double")
    bad = double[u[double] != u[double + 1]]
    if bad.size:
        raise InputError(f"{where}: u differs on the two sides of the double knot sigma[{bad[0]}]")
    if (np.diff(u) < 0.0).any():
        raise InputError(f"{where}: u[{int(np.argmax(np.diff(u) < 0.0)) + 1}] is less than the one before")


def _assumed_stops(curve: Curve, certificate: Certificate) -> tuple[float, ...]:
    """Where sections meet besides corners."""
    near = ON_KNOT * (curve.domain[1] - curve.domain[0])
    corners = np.array([b.u for b in curve.breaks if b.geometric == 0])
    inner = np.array([section.u[0, -1] for section in certificate.sections[:-1]])
    return tuple(float(u) for u in inner[~_is_near(inner, corners, near)])


def _statement(curve: Curve, limits: Limits, certificate: Certificate, stops: Sequence[float], proved: float) -> str:
    """Say what is proved for which plans."""
    first, last = certificate.sections[0], certificate.sections[-1]
    if certificate.periodic:
        ends = "that pass its end into its start"
    else:
        start, end = (f"{feed:.6g} mm/s" if feed > 0.0 else "rest" for feed in (first.start_feed, last.end_feed))
        ends = f"from {start} to {end}"
        if np.isfinite(first.start_acceleration):
            ends += f", beginning with {first.start_acceleration:.6g} mm/s^2"
    parts = [f"no plan of {curve.name} {ends} that keeps these limits takes less than {proved:.9g} s"]
    if stops:
        shown = ", ".join(f"{u:.6g}" for u in stops[:8]) + (", ..." if len(stops) > 8 else "")
        parts.append(f"for plans that stop at u = {shown} ({len(stops)} besides corners)")
    if np.isfinite(limits.chord_error):
        parts.append("for plans within the feed of the chord error by the osculating circle at every point")
    if any(b.geometric == 1 for b in curve.breaks):
        parts.append("for plans whose acceleration steps at curvature jumps only")
    return "; ".join(parts)

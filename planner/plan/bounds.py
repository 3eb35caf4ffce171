"""How far from optimal a plan can be: lower bounds on the time of every plan, whatever its grid.

Both bounds come from multipliers of the continuous problem (``dual/value.py`` has the statement), evaluated between the
points too: the tight one of :func:`certify` from as many knots as a plan has, with a certificate that anyone can verify;
the one that every plan carries from fewer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from planner.certificate import Certificate, CertificateSection
from planner.errors import CurveError, InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve
from planner.inputs import require_instance
from planner.machine.feed_limits import osculating_limits
from planner.machine.limits import Limits, require_limits
from planner.plan.dual.problem import ROUNDS, Pace, best_splines
from planner.plan.dual.terms import Multiplied, Track
from planner.plan.dual.value import Splines
from planner.plan.ends import FREE, Feed, end_with, feed_at
from planner.plan.guess import guess_feed
from planner.plan.jumps import STEP_SEEN
from planner.plan.knots import place_knots, with_blends
from planner.plan.section import Section, sections_between
from planner.profile import BOUND_TOLERANCE, FeedrateProfile
from planner.sets import union
from planner.verify import check

INTERVALS = 1000
_PER_NODE, _FEW = 1.2, 4  # default intervals a node of the plan, and for how many limits so many are cheap
_MIN_INTERVALS = 40
MAX_INTERVALS = 20_000_000  # bounds the memory
_QUICK, _COARSER = 250, 8  # the bound that every plan carries: least intervals, or an eighth of the plan's
_SEAM_TOLERANCE = 1e-6  # of feed and acceleration at the ends of a periodic plan
_SHOWN = 8  # stops in a statement


class Bound(float):
    """A lower bound on the time, s: a float that carries its proof.

    Attributes
    ----------
    certificate : Certificate
        From which the bound can be verified without any solver (``check.certificate``).
    statement : str
        What is proved, and for which plans.
    """

    certificate: Certificate
    statement: str

    def __new__(cls, certificate: Certificate, statement: str) -> Bound:
        """Take the value from the certificate."""
        bound = super().__new__(cls, certificate.bound)
        bound.certificate, bound.statement = certificate, statement
        return bound

    def __repr__(self) -> str:
        count = len(self.certificate.sections)
        return f"Bound({float(self)!r} s, proved by the multipliers of {count} section{'s' * (count != 1)})"

    def __getnewargs__(self) -> tuple[Certificate, str]:  # type: ignore[override]
        return self.certificate, self.statement


def certify(curve: Curve, limits: Limits, profile: FeedrateProfile, *, intervals: int | None = None) -> Bound:
    """Bound the time of every plan from below, tightly.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        Those of the plan.
    profile : FeedrateProfile
        Says where plans stop and with which feeds they begin and end; the same plan read back from a table says the same.
    intervals : int, optional
        Of the multipliers' knots, shared out among the sections between stops; if left out 6/5 of those of the plan, fewer
        where more than two axes make them dear, and 1000 at least.

    Returns
    -------
    Bound
        No plan on any grid is faster, s.  It may be below the bound that the plan carries where that came from more knots.

    Raises
    ------
    InputError
        If the number of intervals is too small, or the limits do not match.
    SolverError
        If the coordinate of the bound does not grow between two of its knots; or the bound contradicts a plan that
        passes its check, an error of this program.
    """
    limits = require_limits(curve, limits)
    require_instance(profile, FeedrateProfile, "profile")
    if intervals is None:
        intervals = _default_intervals(Multiplied.of(limits, curve), profile)
    if not _MIN_INTERVALS <= intervals <= MAX_INTERVALS:
        raise InputError(f"intervals = {intervals!r} must lie within [{_MIN_INTERVALS}, {MAX_INTERVALS}]")
    given, limits = limits, osculating_limits(curve, limits)
    periodic = _is_periodic(curve, profile)
    stops = _stops(profile)
    _require_rest(profile)
    start, end = (FREE, FREE) if periodic else (end_with(float(feed)) for feed in profile.feed[[0, -1]])
    sections = sections_between(curve, limits, stops, start, end)
    lengths = np.diff([0.0, *np.interp([s.u_end for s in sections], profile.u, profile.t)])
    shares = np.maximum(_MIN_INTERVALS, np.rint(intervals * lengths / profile.duration)).astype(int)
    found = [
        _certified(section, limits, int(n), Pace(profile.u, profile.t).within(section), periodic=periodic)
        for section, n in zip(sections, shares, strict=True)
    ]
    total = float(sum(bound for bound, _ in found))
    of = Multiplied.of(limits, curve)
    certificate = Certificate(
        tuple(_as_data(splines) for _, splines in found),
        of.jerk_names,
        of.acceleration_names,
        total,
        curve.fingerprint,
        periodic,
    )
    bound = Bound(certificate, statement(curve, limits, certificate))
    if total > profile.duration * (1.0 + BOUND_TOLERANCE) and check(curve, given, profile).ok:
        raise SolverError(
            f"the lower bound of {curve.name} came out as {total:.9g} s, above a plan of {profile.duration:.9g} s that "
            "passes its check: an error of this program; please report it with the curve and the limits"
        )
    return bound


def _default_intervals(of: Multiplied, profile: FeedrateProfile) -> int:
    """As many as cost about two plans: the time for each grows with the number of limits that have a multiplier."""
    share = _FEW / max(_FEW, of.jerk.size + of.acceleration.size)
    return max(INTERVALS, int(_PER_NODE * share * profile.t.size))


@dataclass(frozen=True, eq=False)
class SectionBound:
    """What :func:`section_bound` takes, kept until somebody asks for the bound of a plan."""

    section: Section
    limits: Limits
    intervals: int
    pace: Pace
    periodic: bool = False

    def __call__(self) -> float:
        """Compute the bound, s."""
        return section_bound(self.section, self.limits, self.intervals, self.pace, periodic=self.periodic)


@dataclass(frozen=True, eq=False)
class PlanBound:
    """The lower bound that a plan carries: the sum of those of its sections, nan where the method of one gives none.

    It takes about as long as the plan itself, and whoever certifies a plan or replays it never looks at it.
    """

    parts: tuple[Callable[[], float] | None, ...]

    def __call__(self) -> float:
        """Compute the bound, s."""
        if None in self.parts:
            return np.nan
        return float(sum(part() for part in self.parts if part is not None))


def section_bound(section: Section, limits: Limits, intervals: int, pace: Pace, *, periodic: bool = False) -> float:
    """Bound the time of a section from below by few knots: as rigorous as :func:`certify`, 1e-4 to a few % less tight.

    ``intervals`` and ``pace`` are those of the plan.  nan where the path's numbers are too far apart for the method.
    """
    with np.errstate(all="ignore"):
        try:
            bound = _certified(section, limits, max(_QUICK, intervals // _COARSER), pace, periodic=periodic, rounds=1)[
                0
            ]
        except (CurveError, InfeasibleError, SolverError):
            return np.nan
    return bound if np.isfinite(bound) and bound > 0.0 else np.nan


def _certified(
    section: Section, limits: Limits, intervals: int, pace: Pace, *, periodic: bool, rounds: int = ROUNDS
) -> tuple[float, Splines]:
    """Bound of a section, and the multipliers that prove it."""
    # Knots that follow |C'|: within a cell it must not change so much that the sums over the cell do not see it.
    guess = guess_feed(section, limits, intervals, follow=True)
    section = with_blends(section, guess) if limits.has_jerk else replace(section, blend_start=0.0, blend_end=0.0)
    track = Track.on(section, limits, place_knots(section, guess, intervals, follow=True))
    falling = track.falling
    if falling.size:
        raise SolverError(
            f"no lower bound of {section.curve.name}: between its knots u = {track.u[0, falling[0]]:.9g} and "
            f"{track.u[0, falling[0] + 1]:.9g} the coordinate of the bound does not grow; ask for more intervals"
        )
    return best_splines(track, pace, periodic=periodic, rounds=rounds)


def _stops(profile: FeedrateProfile) -> dict[float, float]:
    """Parameters inside the path at which the plan stops, and the corners, where every plan has to."""
    resting = profile.u[profile.u_rate == 0.0]
    corners = np.array([b.u for b in profile.curve.breaks if b.is_corner], dtype=float)
    u0, u1 = profile.curve.domain
    return {float(u): 0.0 for u in union(resting, corners) if u0 < u < u1}


def _require_rest(profile: FeedrateProfile) -> None:
    """Refuse a plan that turns back at a speed of 0: sections begin and end without an acceleration."""
    inner = (profile.t > 0.0) & (profile.t < profile.duration)
    turning = np.flatnonzero(inner & (profile.u_rate == 0.0) & (profile.u_acceleration != 0.0))
    if turning.size and profile.limits is not None and profile.limits.has_jerk:
        raise SolverError(
            f"no lower bound of {profile.curve.name}: the plan turns back at u = {profile.u[turning[0]]:.9g} without coming "
            "to rest, and a bound is the sum of those from rest to rest"
        )


def _is_periodic(curve: Curve, profile: FeedrateProfile) -> bool:
    """The plan passes its end into its start: the curve closes, and feed and acceleration are the same at both."""
    if not profile.feed[0] > 0.0 or profile.origin.periodic is False:
        return False
    ends = [curve.derivatives(np.array([u]), 0)[0, 0] for u in curve.domain]
    size = float(np.ptp(curve.derivatives(np.linspace(*curve.domain, 64), 0)[0], axis=0).max())
    if float(np.abs(ends[1] - ends[0]).max()) > 1e-9 * size:
        return False
    largest = float(np.abs(profile.acceleration).max())
    return bool(
        abs(profile.feed[-1] - profile.feed[0]) <= _SEAM_TOLERANCE * profile.feed[0]
        and abs(profile.acceleration[-1] - profile.acceleration[0]) <= _SEAM_TOLERANCE * max(largest, 1e-300)
    )


def _as_data(splines: Splines) -> CertificateSection:
    track, section = splines.track, splines.track.section
    acceleration = section.start.acceleration if isinstance(section.start, Feed) else None
    return CertificateSection(
        track.sigma,
        track.u,
        splines.jerk,
        splines.acceleration,
        feed_at(section.start),
        feed_at(section.end),
        np.nan if acceleration is None else acceleration,
    )


def statement(curve: Curve, limits: Limits, certificate: Certificate) -> str:
    """Say what a bound is about: which plans, and how the chord error counts."""
    first, last = certificate.sections[0], certificate.sections[-1]
    if certificate.periodic:
        ends = "that pass its end into its start"
    else:
        start, end = (f"{feed:.6g} mm/s" if feed > 0.0 else "rest" for feed in (first.start_feed, last.end_feed))
        ends = f"from {start} to {end}"
    parts = [f"no plan of {curve.name} {ends} within these limits takes less than {certificate.bound:.9g} s"]
    corners = {b.u for b in curve.breaks if b.is_corner}
    stops = [float(s.u[0, -1]) for s in certificate.sections[:-1] if float(s.u[0, -1]) not in corners]
    if stops:
        shown = ", ".join(f"{u:.6g}" for u in stops[:_SHOWN]) + (", ..." if len(stops) > _SHOWN else "")
        parts.append(f"for plans that stop at u = {shown}")
    if curve.timing is not None:
        parts.append(
            "on this path, which was found with its feed; others within its tolerance are no part of the bound"
        )
    if np.isfinite(limits.chord_error):
        parts.append("the chord error counts as the feed limit of the osculating circle")
    if any(b.is_curvature_jump for b in curve.breaks):
        parts.append(
            f"at curvature jumps the acceleration steps by at most {limits.period:g} s / {STEP_SEEN:g} of the jerk limit, "
            "which is what a check with that period grants"
        )
    return "; ".join(parts)

"""Certificates of lower bounds: multipliers along a path, from which anyone can compute that no plan is faster.

Only the data: what finds the multipliers and what verifies them share this module and nothing else.  The statement and
its proof are in ``docs/certificate.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class CertificateSection:
    """Multipliers of one section, from stop to stop, in a coordinate sigma of its own.

    Attributes
    ----------
    sigma : (n,) array
        Knots, non-decreasing; equal neighbours are a double knot, no three are equal, the ends are simple.
    u : (3, n) array
        The curve parameter and its first two derivatives with respect to sigma at the knots, one-sided at double knots,
        u itself equal on both sides of them and exact on breaks of the curve.  In between u(sigma) is the quintic
        Hermite interpolant: this defines the coordinate.  At a rest u' = u'' = 0, u grows as sigma^3.
    jerk : (J, n + 1) array
        Coefficients of quadratic B-splines on the knots (clamped: the end knots threefold; a double knot counts twice,
        so l is continuous with a kink there), one row for each limit of ``jerk_names``: the dimensionless l.
    acceleration : (A, n) array
        Coefficients of linear B-splines: the value at every knot, left and right at a double one; one row for each
        limit of ``acceleration_names``: the m of which the integral over sigma is in s.
    start_feed, end_feed : float
        Tip feed prescribed at the end, mm/s; 0.0 a rest, nan free (a periodic path).
    start_acceleration : float
        Tangential acceleration of the tip prescribed at the start, mm/s^2; nan where it is free.
    """

    sigma: FloatArray
    u: FloatArray
    jerk: FloatArray
    acceleration: FloatArray
    start_feed: float
    end_feed: float
    start_acceleration: float


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """A claimed lower bound on the time of every plan, and the multipliers that prove it.

    Attributes
    ----------
    sections : tuple of CertificateSection
        In the order of the path; together they cover it.
    jerk_names, acceleration_names : tuple of str
        The limits that have multipliers: ``"jerk X"``, ``"tangential jerk"``; ``"acceleration X"``,
        ``"tangential acceleration"``.
    bound : float
        The claim, s.
    fingerprint : str
        Of the curve.
    periodic : bool
        The end passes into the start.
    """

    sections: tuple[CertificateSection, ...]
    jerk_names: tuple[str, ...]
    acceleration_names: tuple[str, ...]
    bound: float
    fingerprint: str
    periodic: bool

    def __repr__(self) -> str:
        count = len(self.sections)
        return f"Certificate({self.bound!r} s claimed, multipliers of {count} section{'s' * (count != 1)})"

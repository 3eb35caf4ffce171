"""The places of a curve that a certificate must know: its knots, its corners, and where its curvature jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.certificate import CertificateSection
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.types import BoolArray, FloatArray
from planner.verify.sizes import ON_KNOT


@dataclass(frozen=True, eq=False)
class Places:
    """Curve parameters, increasing, and the distance within which two of them are one.

    Attributes
    ----------
    knots : (n,) array
        Between these the curve is smooth.
    corners : (m,) array
        Those at which every plan stops.
    jumps : (k,) array
        Those with one tangent but two curvatures.
    tolerance : float
    """

    knots: FloatArray
    corners: FloatArray
    jumps: FloatArray
    tolerance: float

    @classmethod
    def of(cls, curve: Curve) -> Places:
        """Ask the curve."""
        corners = np.array([b.u for b in curve.breaks if b.is_corner])
        jumps = np.array([b.u for b in curve.breaks if b.is_curvature_jump])
        return cls(curve._candidate_breaks(), corners, jumps, ON_KNOT * (curve.domain[1] - curve.domain[0]))

    def on(self, some: FloatArray, u: FloatArray) -> BoolArray:
        """Which parameters u lie on one of some places (increasing)."""
        if some.size == 0:
            return np.zeros(u.shape, dtype=bool)
        after = np.minimum(np.searchsorted(some, u), some.size - 1)
        distance = np.minimum(np.abs(u - some[after]), np.abs(u - some[np.maximum(after - 1, 0)]))
        return np.asarray(distance <= self.tolerance)

    def inside(self, section: CertificateSection, where: str) -> tuple[FloatArray, FloatArray]:
        """Knots and curvature jumps inside a section.

        Raises InputError where the section passes a corner, or a knot of the curve without one of its own.
        """
        ends = section.u[0, [0, -1]] + np.array([1.0, -1.0]) * self.tolerance

        def between(some: FloatArray) -> FloatArray:
            return some[np.searchsorted(some, ends[0], side="right") : np.searchsorted(some, ends[1], side="left")]

        knots, corners = between(self.knots), between(self.corners)
        missing = knots[~self.on(np.unique(section.u[0]), knots)]
        if missing.size:
            raise InputError(f"{where} has no knot at u = {missing[0]:.9g}, where the curve has one")
        if corners.size:
            raise InputError(
                f"{where} passes the corner at u = {corners[0]:.9g}; every plan stops there, so a section must end there"
            )
        return knots, between(self.jumps)

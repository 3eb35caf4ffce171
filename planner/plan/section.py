"""Cut a path at its exact stops and give each section a coordinate that needs no law.

A *section* runs from stop to stop (or from an end of the path that has a feed).  A plan with jerk limits is made in the time
of another law (``time_map.py``).  Its guess, a bound and a plan without a jerk limit have none: their sigma is composed of

    u  <-  y        the curve parameter itself where the curve is C2 in it, else the arc length of the machine axes
    y  <-  sigma    the rest map

**Arc length of the machine axes** is weighted, dy^2 = sum_j (w_j dq_j)^2 with w_j = A_ref / A_j, so that millimetres
and radians count as the drives feel them; on a machine with equal axes it is plain arc length.  It never rests while
an axis moves, also where the tool tip does.

**The rest map** (``rest_map.py``) keeps sigma_dot finite and positive down to a stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.geometry.arclength import ArcLength
from planner.geometry.continuity import Break
from planner.geometry.curve import Curve
from planner.geometry.differential import chain_rule, inverse_derivatives, speed_derivatives
from planner.machine.limits import Limits
from planner.plan.ends import REST, End, Feed, Free, Rest
from planner.plan.rest_map import BLEND_LENGTH, covered, share_of_blend, slopes
from planner.plan.stops import exact_stops
from planner.types import FloatArray

_RESOLUTION = 1e4 * float(np.finfo(np.float64).eps)
_SEAM_TOLERANCE = 1e-7  # relative jump of the first and second derivative between end and start that counts as none


@dataclass(frozen=True, eq=False)
class Section:
    """A stretch of the path without an exact stop inside.

    Attributes
    ----------
    curve : Curve
    u_start, u_end : float
        Curve parameters of the ends.
    start, end : Rest, Feed or Free
        What is asked for there.
    arc : ArcLength or None
        Weighted arc length where that is the coordinate y; None where y is the curve parameter.
    blend_start, blend_end : float
        Widths of the rest map in y; 0 at an end that has a feed.
    jumps : tuple of Break
        Curvature jumps inside, to be passed at a feed that keeps the samples' jerk within its limit.
    bend : float
        Radius, mm, of the bend at whose tip it begins (weighted as the arc length is); 0 if it begins elsewhere.
    reserve : tuple of (float, float)
        Parameters, increasing, and the share of the limits that is left unused from each on; none before the first.
    """

    curve: Curve
    u_start: float
    u_end: float
    start: End
    end: End
    arc: ArcLength | None
    blend_start: float = 0.0
    blend_end: float = 0.0
    jumps: tuple[Break, ...] = ()
    bend: float = 0.0
    reserve: tuple[tuple[float, float], ...] = ()

    @property
    def has_prescribed_feed(self) -> bool:
        """A feed is prescribed at one of the ends."""
        return isinstance(self.start, Feed) or isinstance(self.end, Feed)

    @property
    def continues(self) -> bool:
        """It begins with a feed and an acceleration, as another plan left them, and ends at rest."""
        return isinstance(self.start, Feed) and self.start.acceleration is not None and isinstance(self.end, Rest)

    @property
    def y_start(self) -> float:
        """Coordinate y at the start."""
        return self.u_start if self.arc is None else float(self.arc.s(self.u_start))

    @property
    def y_end(self) -> float:
        """Coordinate y at the end."""
        return self.u_end if self.arc is None else float(self.arc.s(self.u_end))

    @property
    def resolution(self) -> float:
        """Distance in y below which two places are one: ten thousand digits of y."""
        return _RESOLUTION * max(abs(self.y_start), abs(self.y_end))

    @property
    def span(self) -> float:
        """Range [0, span] of sigma."""
        saved = (1.0 - BLEND_LENGTH) * (self.blend_start + self.blend_end)
        return self.y_end - self.y_start + saved

    def usable(self, u: FloatArray) -> FloatArray:
        """Share of the limits that a plan may use at parameters: what the reserve leaves."""
        if not self.reserve:
            return np.ones_like(u)
        begins, unused = (np.array(column) for column in zip(*self.reserve, strict=True))
        return np.append(1.0, 1.0 - unused)[np.searchsorted(begins, u, side="right")]

    def position(self, sigma: FloatArray) -> FloatArray:
        """Evaluate y(sigma)."""
        w0, w1, span = self.blend_start, self.blend_end, self.span
        y = self.y_start - (1.0 - BLEND_LENGTH) * w0 + sigma
        for width, distance, end, sign in ((w0, sigma, self.y_start, 1.0), (w1, span - sigma, self.y_end, -1.0)):
            if width > 0.0:
                inside = np.flatnonzero(distance < width)
                y[inside] = end + sign * width * covered(np.maximum(distance[inside], 0.0) / width)
        return y

    def rest_map(self, sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Evaluate y(sigma) and its first three derivatives."""
        w0, w1, span = self.blend_start, self.blend_end, self.span
        y = self.position(sigma)
        first, second, third = np.ones_like(y), np.zeros_like(y), np.zeros_like(y)
        for width, distance, sign in ((w0, sigma, 1.0), (w1, span - sigma, -1.0)):
            if width <= 0.0:
                continue
            inside = np.flatnonzero(distance < width)
            r = np.maximum(distance[inside], 0.0) / width
            slope, bend, twist = slopes(r)
            first[inside], second[inside], third[inside] = slope, sign * bend / width, twist / width**2
        return y, first, second, third

    def sigma(self, y: FloatArray) -> FloatArray:
        """Invert the rest map (Newton in the blends, bracketed)."""
        w0, w1 = self.blend_start, self.blend_end
        sigma = y - self.y_start + (1.0 - BLEND_LENGTH) * w0
        for width, away, side in ((w0, y - self.y_start, 0), (w1, self.y_end - y, 1)):
            if width <= 0.0:
                continue
            inside = np.flatnonzero(away < BLEND_LENGTH * width)
            if inside.size:
                distance = width * share_of_blend(np.maximum(away[inside], 0.0) / width)
                sigma[inside] = distance if side == 0 else self.span - distance
        return np.clip(sigma, 0.0, self.span)

    def parameter(self, y: FloatArray) -> FloatArray:
        """Curve parameter at coordinates y."""
        if self.arc is None:
            return np.clip(y, self.u_start, self.u_end)
        return np.clip(self.arc.u(np.clip(y, 0.0, self.arc.total)), self.u_start, self.u_end)

    def coordinate(self, u: FloatArray) -> FloatArray:
        """Coordinate y at curve parameters u."""
        return u.copy() if self.arc is None else self.arc.s(u)

    def parameter_derivatives(
        self, q: FloatArray, weights: FloatArray, rest: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """First three derivatives of u with respect to sigma, from q' and q'' (with respect to u) and the rest map."""
        _, y1, y2, y3 = rest
        if self.arc is None:
            return y1, y2, y3
        weighted = q * weights
        # u as a function of y, then y as one of sigma
        return chain_rule(*inverse_derivatives(speed_derivatives(weighted)), y1, y2, y3)


def axis_weights(limits: Limits) -> FloatArray:
    """Weights that make the axes comparable: by acceleration, else by jerk, else by velocity; 1 where nothing limits."""
    for row in (limits.acceleration, limits.jerk, limits.velocity):
        finite = np.isfinite(row)
        if finite.all():
            return np.asarray(row.max() / row)
    return np.ones(limits.dim)


def cut(
    curve: Curve,
    limits: Limits,
    start: End = REST,
    end: End = REST,
    *,
    exact_stop: bool,
    fillets: bool = True,
) -> list[Section]:
    """Cut a path at its corners and at bends as tight as corners to this machine (``exact_stop``: at curvature jumps too).

    Without ``fillets`` a tight bend that is a span of its own is a corner as well: for grids that do not resolve it.

    Returns
    -------
    list of Section
        In the order of the path, not yet with rest blends (see :func:`with_blends`).
    """
    closed = isinstance(start, Free)
    stops = exact_stops(curve, limits, axis_weights(limits), at_jumps=exact_stop, bends=not closed, hidden=fillets)
    return sections_between(curve, limits, stops, start, end)


def sections_between(
    curve: Curve,
    limits: Limits,
    stops: Mapping[float, float],
    start: End,
    end: End,
) -> list[Section]:
    """Cut a path at the given parameters, each with the radius of a bend whose tip it is, or 0."""
    weights = axis_weights(limits)
    breaks = np.array([b.u for b in curve.breaks])
    arc: ArcLength | None = None
    sections = []
    for i, (u0, u1) in enumerate(pairwise([curve.domain[0], *sorted(stops), curve.domain[1]])):
        inside = curve.breaks[np.searchsorted(breaks, u0, side="right") : np.searchsorted(breaks, u1)]
        smooth = all(b.parametric >= 2 for b in inside) and not (isinstance(start, Free) and _seam_jumps(curve))
        if not smooth and arc is None:
            arc = weighted_arclength(curve, weights)
        section = Section(
            curve,
            u0,
            u1,
            start if i == 0 else REST,
            end if i == len(stops) else REST,
            None if smooth else arc,
            jumps=tuple(b for b in inside if b.is_curvature_jump),
            bend=stops.get(u0, 0.0),
        )
        sections.append(replace(section, jumps=_apart_from_ends(section)))
    return sections


def _apart_from_ends(section: Section) -> tuple[Break, ...]:
    """Curvature jumps that are not at an end of their section but for rounding."""
    y = section.coordinate(np.array([b.u for b in section.jumps]))
    apart = np.minimum(y - section.y_start, section.y_end - y) > section.resolution
    return tuple(b for b, inside in zip(section.jumps, apart, strict=True) if inside)


def _seam_jumps(curve: Curve) -> bool:
    """The parametrisation of a closed curve is not C2 where its end meets its start."""
    start, end = (curve.derivatives(u, 2) for u in curve.domain)
    jump, size = np.abs(end - start).max(axis=-1), np.abs([start, end]).max(axis=(0, -1))
    return bool((jump[1:] > _SEAM_TOLERANCE * size[1:]).any())


def weighted_arclength(curve: Curve, weights: FloatArray) -> ArcLength:
    """Arc length of the machine axes under the weights of :func:`axis_weights`."""

    def speed(u: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.sum((curve.derivatives(u, 1)[1] * weights) ** 2, axis=-1)))

    return ArcLength.of_speed(speed, curve.pieces.breaks, curve.name)


def evaluate(curve: Curve, u: FloatArray, left: NDArray[np.bool_]) -> FloatArray:
    """Derivatives 0..3 of a curve at u (n,), from the left where ``left`` is true, by its compiled pieces.

    They are exact for B-splines.  Pieces fitted to other curves are 1e-13 of the extent off, their third derivatives some
    1e-7 of the largest; what is planned on them is checked on the curve itself.
    """
    return curve.pieces.evaluate(u, 3, left)

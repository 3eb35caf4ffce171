"""Fit a tube to one stretch of the programmed path: solve, weigh by the speed, check, refine.

A pass solves the tube with the weights w = v^5 / J^2 at hand, measures the deviation between the samples, and takes the
speed that the new curve allows for the next weights.  Where the deviation exceeds the tolerance by a little, the sample is
made a row of the tube and the tube narrowed there by as much; where by more, the spacing of the knots shrinks by at least
0.95 sqrt(tol / dev).  Accepted is a curve that was measured within the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.geometry.chain import span_derivatives
from planner.machine.limits import Limits
from planner.plan.guess import GROWTH_ACCELERATION, GROWTH_JERK
from planner.programs.path import tube_knots as knotting
from planner.programs.path.deviation import Programmed, refined_peaks, samples_between
from planner.programs.path.tube import SLIP, Spline, Tube, greville, samples_of, smoothest
from planner.types import BoolArray, FloatArray

WINDOW, OVERLAP = 2000, 80  # knots
_MAX_PASSES = 12
_LOCAL_PASSES = 6  # after these the whole tube is narrowed
_REWEIGHTINGS = 1  # with the curve at hand, after the first solve
_NARROWED = 0.999  # of the tolerance: the rows' half-width at first
# Of the tolerance, measured at samples and at the peaks between them: what is aimed at, and what is enough.  A place that is
# held by rows beside it comes ever closer to what is aimed at, and would take all passes.
_WITHIN, _SETTLED = 0.9998, 0.9999
_A_LITTLE = 1.1
_MAX_NARROWING = 0.5  # in one pass
_SHRINK = 0.95
_ENTRY = 4.0  # tolerances after the start of a window: twice the tangential slip
_DENSITY = 12  # samples between neighbouring knots
_MIN_SPEED = 0.1  # of the largest, in the weights


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch from start to end, mm of programmed abscissa.

    Attributes
    ----------
    start, end : float
    stops : pair of bool
        The path rests at the start, at the end.
    at, spacing : (n,) arrays
        Junctions (and places on arcs) inside and the knot spacing wanted there, mm.
    chords : (n,) bool array
        Which of them are junctions of chords of a curve.
    vertices : (k,) array
        Junctions inside.
    sharp : (j,) array
        Those of them that must be knots.
    tolerance : float
        The largest of its blocks, mm.
    edges : (m + 1,) array
        Abscissae at which its blocks begin and end.
    share : (m,) array
        What each of them may use of the tolerance.  Distances are measured against it: a distance beyond a block that has
        half the tolerance counts twice.
    entry : (4, dim) array or None
        Position and three derivatives with which the curve begins, where another one ends there.
    """

    start: float
    end: float
    stops: tuple[bool, bool]
    at: FloatArray
    spacing: FloatArray
    chords: BoolArray
    vertices: FloatArray
    sharp: FloatArray
    tolerance: float
    edges: FloatArray
    share: FloatArray
    entry: FloatArray | None = None

    def part(self, start: float, end: float, entry: FloatArray | None) -> Stretch:
        """A window of the stretch; where it ends before the stretch does, its end is free but for the position."""

        def inside(s: FloatArray) -> NDArray[np.bool_]:
            return np.asarray((s >= start) & (s <= end))

        at = inside(self.at)
        stops = (self.stops[0] and entry is None, self.stops[1] or end < self.end)
        vertices, sharp = self.vertices[inside(self.vertices)], self.sharp[inside(self.sharp)]
        return replace(
            self, start=start, end=end, stops=stops, at=self.at[at], spacing=self.spacing[at], chords=self.chords[at],
            vertices=vertices, sharp=sharp, entry=entry,
        )  # fmt: skip

    def share_at(self, s: FloatArray) -> FloatArray:
        """Share of the tolerance at abscissae (n,): the least of the blocks within the tangential slip of the curve."""
        last, slip = self.share.size - 1, SLIP * self.tolerance
        first = np.clip(np.searchsorted(self.edges, s - slip, side="right") - 1, 0, last)
        beyond = np.clip(np.searchsorted(self.edges, s + slip, side="left") - 1, 0, last) + 1
        ends = np.column_stack([first, np.maximum(beyond, first + 1)]).reshape(-1)
        return np.asarray(np.minimum.reduceat(np.append(self.share, np.inf), ends)[::2])


@dataclass(frozen=True, eq=False)
class Fitted:
    """The curve of a stretch, what was measured, and how it came about.

    Attributes
    ----------
    knots : (n + 1,) array
        mm of programmed abscissa.
    powers : (n, dim, 5) array
        Of the local parameter of every interval, in all axes.
    tolerance, deviation, abscissa : float
        What was allowed, the largest distance measured, and where, mm.
    passes, iterations : int
        Tubes solved, and iterations of the interior point.
    """

    knots: FloatArray
    powers: FloatArray
    tolerance: float
    deviation: float
    abscissa: float
    passes: int
    iterations: int

    def up_to(self, knot: int) -> Fitted:
        """The intervals before a knot."""
        return replace(self, knots=self.knots[: knot + 1], powers=self.powers[:knot])

    def end_derivatives(self) -> FloatArray:
        """Position and three derivatives (4, dim) at the end."""
        width = np.diff(self.knots[-2:])[None]
        return span_derivatives(self.powers[-1:], np.ones((1, 1)), width)[:, 0]


@dataclass
class _TubeProgress:
    """What changes from pass to pass."""

    narrowing_at: FloatArray = field(default_factory=lambda: np.empty(0))
    narrowing: FloatArray = field(default_factory=lambda: np.empty(0))
    extra: FloatArray = field(default_factory=lambda: np.empty(0))
    speed_at: FloatArray = field(default_factory=lambda: np.empty(0))
    speed: FloatArray = field(default_factory=lambda: np.empty(0))

    def narrowed(self, rows: FloatArray) -> FloatArray:
        """The share of the tolerance that rows at the given abscissae have: that of the nearest row so far."""
        if not self.narrowing.size:
            return np.ones(rows.size)
        nearest = np.searchsorted(0.5 * (self.narrowing_at[1:] + self.narrowing_at[:-1]), rows)
        return self.narrowing[nearest]


def knots_of(stretch: Stretch, programmed: Programmed) -> FloatArray:
    """Where its knots go at first."""
    wanted = stretch.at, stretch.spacing, stretch.sharp, stretch.chords
    return knotting.place(stretch.start, stretch.end, *wanted, lambda s: np.asarray(programmed.at(s)[0]))


def fit(stretch: Stretch, programmed: Programmed, limits: Limits, feed: FloatArray) -> Fitted:
    """Fit the smoothest curve within tolerance; the best one found, which the caller accepts or not.

    Parameters
    ----------
    stretch : Stretch
    programmed : Programmed
    limits : Limits
        Of the axes of the path.
    feed : (m,) array
        Feed cap of every block, mm/s.
    """
    plan = knots_of(stretch, programmed)
    plan = knotting.onto(plan, programmed.edges[1:-1][feed[1:] != feed[:-1]])
    if plan.size <= WINDOW + 2 * OVERLAP:
        return _fit_window(stretch, plan, programmed, limits, feed)
    parts: list[Fitted] = []
    start, entry = stretch.start, stretch.entry
    while start < stretch.end:
        first = int(np.searchsorted(plan, start, side="right")) - 1
        is_last = first + WINDOW + 2 * OVERLAP >= plan.size
        knots = plan[first:] if is_last else plan[first : first + WINDOW + OVERLAP + 1]
        part = stretch.part(start, float(knots[-1]), entry)
        found = _fit_window(part, knots, programmed, limits, feed)
        if not is_last:
            found = found.up_to(int(np.searchsorted(found.knots, plan[first + WINDOW])))
        parts.append(found)
        if found.deviation > stretch.tolerance:
            break
        start, entry = float(found.knots[-1]), found.end_derivatives()
        if is_last:
            break
    return _joined(parts)


def _joined(parts: list[Fitted]) -> Fitted:
    """One curve of consecutive windows."""
    worst = max(parts, key=lambda part: part.deviation)
    return Fitted(
        np.concatenate([parts[0].knots[:1], *(part.knots[1:] for part in parts)]),
        np.concatenate([part.powers for part in parts]),
        worst.tolerance,
        worst.deviation,
        worst.abscissa,
        max(part.passes for part in parts),
        sum(part.iterations for part in parts),
    )


def _fit_window(
    stretch: Stretch, knots: FloatArray, programmed: Programmed, limits: Limits, feed: FloatArray
) -> Fitted:
    """Fit one tube, from the knots given."""
    progress = _TubeProgress()
    best: Fitted | None = None
    iterations = 0
    for count in range(1, _MAX_PASSES + 1):
        tube, moving, rest = _tube(stretch, programmed, knots, progress)
        if count == 1:
            _take_speed(progress, _spline_of(tube), moving, stretch, programmed, limits, feed)
        tube = _weighted(tube, progress)
        spline = smoothest(tube)
        iterations += spline.iterations
        s, away = _measure(spline, moving, rest, programmed, stretch)
        worst = int(np.argmax(away))
        powers = spline.in_axes(moving, rest).powers
        measured = float(away[worst]), float(s[worst])
        found = Fitted(spline.knots, powers, stretch.tolerance, *measured, count, iterations)
        settled = count > _REWEIGHTINGS and away[worst] <= _SETTLED * stretch.tolerance
        if best is None or count <= 1 + _REWEIGHTINGS or found.deviation < best.deviation:
            best = found
        if settled:
            break
        if count <= _REWEIGHTINGS:
            _take_speed(progress, spline, moving, stretch, programmed, limits, feed)
        knots = _refine(progress, knots, tube.abscissa, s, away, stretch.tolerance, count)
    assert best is not None
    return best


def _tube(
    stretch: Stretch, programmed: Programmed, knots: FloatArray, progress: _TubeProgress
) -> tuple[Tube, NDArray[np.bool_], FloatArray]:
    """The tube on the knots in the axes that move, which axes these are, and the coordinates of the others."""
    s = np.union1d(samples_of(knots, stretch.vertices), progress.extra)
    right, left = programmed.at(s), programmed.at(s, left=True)
    tangent = right[1] / np.sqrt(np.sum(right[1] ** 2, axis=1))[:, None]
    tangent += left[1] / np.sqrt(np.sum(left[1] ** 2, axis=1))[:, None]
    tangent /= np.sqrt(np.sum(tangent**2, axis=1))[:, None]
    initial = programmed.at(np.clip(greville(knots), stretch.start, stretch.end))[0]
    points = right[0]
    spread = np.ptp(np.concatenate([points, initial]), axis=0)
    moving = spread > 0.0
    if stretch.entry is not None:
        moving |= (stretch.entry[1:] != 0.0).any(axis=0)
    if moving.sum() < 2:
        moving[np.argsort(-spread)[:2]] = True
    half_width = _NARROWED * stretch.tolerance * stretch.share_at(s) * progress.narrowed(s)
    ends = []
    for place, rests, from_left in ((stretch.start, stretch.stops[0], False), (stretch.end, stretch.stops[1], True)):
        d = programmed.at(np.array([place]), left=from_left)[: 1 if rests else 3, 0]
        ends.append(np.asarray(d[:, moving]))
    if stretch.entry is not None:
        ends[0] = stretch.entry[:, moving]
    weight = np.ones(knots.size - 1)
    tube = Tube(
        knots=knots,
        abscissa=s,
        point=points[:, moving],
        tangent=tangent[:, moving],
        half_width=half_width,
        start=ends[0],
        end=ends[1],
        initial=initial[:, moving].copy(),
        weight=weight,
    )
    return tube, moving, points[0]


def _spline_of(tube: Tube) -> Spline:
    """The spline of the initial control points."""
    from planner.programs.path.tube import DEGREE, basis_powers

    basis = basis_powers(tube.knots)
    index = np.arange(basis.shape[0])[:, None] + np.arange(DEGREE + 1)
    return Spline(tube.knots, np.einsum("nip,nid->ndp", basis, tube.initial[index]), tube.initial, 0)


def _weighted(tube: Tube, progress: _TubeProgress) -> Tube:
    middle = 0.5 * (tube.knots[1:] + tube.knots[:-1])
    speed = np.interp(middle, progress.speed_at, progress.speed)
    weight = (np.maximum(speed, _MIN_SPEED * speed.max()) / speed.max()) ** 5
    return replace(tube, weight=weight)


def _take_speed(
    progress: _TubeProgress,
    spline: Spline,
    moving: NDArray[np.bool_],
    stretch: Stretch,
    programmed: Programmed,
    limits: Limits,
    feed: FloatArray,
) -> None:
    """The speed that a curve allows by feed, velocity and acceleration at every point, then made reachable both ways.

    The jerk that the curve itself needs is left out: it would lower the weight where the jerk is high already, and so
    gather it there.
    """
    edges = spline.knots
    s = np.union1d(edges, 0.5 * (edges[1:] + edges[:-1]))
    d = spline.derivatives(s)
    size = np.sqrt(np.sum(d[1] ** 2, axis=1))[:, None]
    rows = (row * programmed.scale for row in (limits.velocity, limits.acceleration, limits.jerk))
    velocity, acceleration, jerk = (row[moving] for row in rows)
    block = np.clip(np.searchsorted(programmed.edges, s, side="right") - 1, 0, feed.size - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ceiling = np.minimum(
            (feed * programmed.per_feed)[block], np.fmin.reduce(velocity / np.abs(d[1] / size), axis=1)
        )
        ceiling = np.fmin(ceiling, np.sqrt(np.fmin.reduce(acceleration / np.abs(d[2]), axis=1)))
        along = [np.fmin.reduce(row / np.abs(d[1] / size), axis=1) for row in (acceleration, jerk)]
    ceiling = np.where(np.isfinite(ceiling), ceiling, 1e4)
    rests = np.array([stretch.stops[0], *np.zeros(s.size - 2, dtype=bool), stretch.stops[1]])
    ceiling[rests] = 0.0
    progress.speed_at, progress.speed = s, reachable(s, ceiling, along[0], along[1])


def reachable(s: FloatArray, ceiling: FloatArray, acceleration: FloatArray, jerk: FloatArray) -> FloatArray:
    """Largest speed below the ceiling that grows and falls no faster than acceleration and jerk allow, (n,), mm/s.

    Under an acceleration A alone v^2 grows by 2A a mm; under a jerk J alone v^1.5 by 2.12 sqrt(J).
    """
    speed = ceiling
    for power, rate in ((2.0, 2.0 * GROWTH_ACCELERATION * acceleration), (1.5, GROWTH_JERK * np.sqrt(jerk))):
        if not np.isfinite(rate).all():
            continue
        growth = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))])
        raised = np.minimum.accumulate(speed**power - growth) + growth
        back = growth[-1] - growth
        raised = np.minimum.accumulate((raised - back)[::-1])[::-1] + back
        speed = np.maximum(raised, 0.0) ** (1.0 / power)
    return speed


def _measure(
    spline: Spline, moving: NDArray[np.bool_], rest: FloatArray, programmed: Programmed, stretch: Stretch
) -> tuple[FloatArray, FloatArray]:
    """Deviation in both directions at dense samples: abscissae, and distances against the share of the tolerance."""
    edges = np.union1d(spline.knots, stretch.vertices)
    s = samples_between(edges, max(2, _DENSITY * spline.knots.size // edges.size))
    reach = 8.0 * stretch.tolerance + 2.0 * float(np.diff(spline.knots).max())

    whole = spline.in_axes(moving, rest)
    after_entry = stretch.start + (0.0 if stretch.entry is None else _ENTRY * stretch.tolerance)

    def from_path(at: FloatArray) -> FloatArray:
        return programmed.distance(whole.places(at), at, np.full(at.size, reach)) / stretch.share_at(at)

    def from_program(at: FloatArray) -> FloatArray:
        lo, hi = np.maximum(at - reach, stretch.start), np.minimum(at + reach, stretch.end)
        away = whole.distances(programmed.at(at)[0], at, lo, hi) / stretch.share_at(at)
        # The nearest point may lie in the window before; the whole path is measured again when it is complete.
        return np.where(at >= after_entry, away, 0.0)

    values = [s, *(measure(s) for measure in (from_path, from_program))]
    peaks = [
        refined_peaks(measure, s, value) for measure, value in zip((from_path, from_program), values[1:], strict=True)
    ]
    every = np.concatenate([s, *(place for place, _ in peaks)])
    away = np.concatenate([np.maximum(values[1], values[2]), *(height for _, height in peaks)])
    order = np.argsort(every, kind="stable")
    return every[order], away[order]


def _refine(
    progress: _TubeProgress,
    knots: FloatArray,
    rows: FloatArray,
    s: FloatArray,
    away: FloatArray,
    tolerance: float,
    count: int,
) -> FloatArray:
    """Narrow the tube where the deviation is a little too large; returns knots, closer where it is far too large.

    Knots are added and none is moved, so that what a window inherits from the one before stays representable.
    """
    interval = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, knots.size - 2)
    largest = np.zeros(knots.size - 1)
    np.maximum.at(largest, interval, away)
    ratio = largest / tolerance
    far = ratio > _A_LITTLE
    little = np.flatnonzero((away > _WITHIN * tolerance) & ~far[interval])
    peak = (away[little] >= away[np.maximum(little - 1, 0)]) & (
        away[little] >= away[np.minimum(little + 1, s.size - 1)]
    )
    little = little[peak]
    widened = np.union1d(rows, s[little])
    share = progress.narrowed(widened)
    factor = np.maximum(_MAX_NARROWING, _NARROWED * _WITHIN * tolerance / away[little])
    np.minimum.at(share, np.searchsorted(widened, s[little]), progress.narrowed(s[little]) * factor)
    progress.narrowing_at, progress.narrowing = widened, share
    progress.extra = np.union1d(progress.extra, s[little])
    if count >= _LOCAL_PASSES and not far.any():
        progress.narrowing = progress.narrowing * min(1.0, _WITHIN * tolerance / float(away.max()))
    parts = np.where(far, np.ceil(np.sqrt(np.maximum(ratio, 1.0)) / _SHRINK), 1.0).astype(np.intp)
    index = np.repeat(np.arange(parts.size), parts)
    within = (np.arange(index.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[index]
    return np.append(knots[index] + np.diff(knots)[index] * within, knots[-1])

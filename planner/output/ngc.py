"""Programs for LinuxCNC: a planned curve as short lines within a tolerance, each with the feed the plan has there.

The frame is ``G61``, the rapid to the start, ``G64 P.. Q0``, the cut, ``M2``: the rapid ends at rest, the cut is blended
within P, and without ``Q0`` the controller would merge blocks on its own.  No word is repeated that does not change; none
but the moves themselves stands in the cut, since S, M and G4 make a controller empty its queue.

The tolerance is shared.  The lines leave the curve by half of it, digits included, and P is the other half, so that the
path the controller may make of them stays within the whole.  Where the plan stops (a corner, an exact stop) the block
ends under ``G61``, since a blend would cut the corner the plan does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planner.errors import BrokenLimitError, InputError
from planner.files.whole_file import whole_file
from planner.geometry.curve import AXES, DEGREES, Curve
from planner.geometry.tolerance import PathTolerance
from planner.inputs import positive_number, require_instance
from planner.law import TimeLaw
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray
from planner.verify import Report, check

FeedMode = Literal["feed", "inverse_time"]

_PROBES = 16  # inside a block, at Chebyshev points: they miss the peak of a parabola by at most 1 %
_PROBE_SHARE = 0.98
_MIN_TOLERANCE_MM = 1e-6  # coordinates are written with up to 9 decimals
_MAX_HALVINGS = 30
_MAX_BLOCKS = 5_000_000
_F_DIGITS = 8  # of the feed: the block times then sum to the duration within 1e-8


@dataclass(frozen=True)
class WrittenProgram:
    """What was written: number of blocks that cut, their times' sum in s, and the largest distance to the curve, mm."""

    blocks: int
    duration: float
    deviation: float


@dataclass(frozen=True, eq=False)
class _WrittenLines:
    """Points (n, dim) in mm and degrees as written, times and parameters (n,) and whether the block before each stops."""

    points: FloatArray
    t: FloatArray
    u: FloatArray
    stops: NDArray[np.bool_]
    deviation: float


def write_ngc(
    path: str | Path,
    curve: Curve,
    plan: FeedrateProfile | Samples,
    *,
    tolerance: float,
    mode: FeedMode = "feed",
    block_time: float = 0.01,
    inserted: Sequence[tuple[float, str]] = (),
    report: Report | None = None,
) -> WrittenProgram:
    """Write a LinuxCNC program of a planned curve, if the plan breaks no limit.

    Parameters
    ----------
    path : str or Path
        The file; written whole or not at all.
    curve : Curve
        Its axis names become the words; linear axes in mm, rotary ones in degrees.
    plan : FeedrateProfile or Samples
        A profile is cut into blocks of at most ``block_time``, shorter where the tolerance or a corner asks for it.
        Samples become a block each, as they are: their distance to the curve is measured, not bounded.
    tolerance : float
        Largest distance between the curve and what the controller may make of the program, mm; a degree of a rotary axis
        counts as a mm.
    mode : {"feed", "inverse_time"}
        F as feed in mm/min (G94) or as blocks a minute (G93).  Under G94 the feed is that of X Y Z together, of U V W where
        none of these moves, and where none of those moves either of A B C, in degrees a minute.
    block_time : float
        Longest time of a block, s: the steps in which the feed is given.
    inserted : sequence of (float, str)
        Lines to put in where the path passes a curve parameter, in their order, such as the spindle's words; those at
        the start of the curve come before the rapid to it.
    report : Report, optional
        What :func:`~planner.verify.check` says of the plan; if left out, a profile is checked here against the limits it
        was planned for.  Samples do not know theirs and need one.

    Returns
    -------
    WrittenProgram

    Raises
    ------
    InputError
        If an option is not allowed, the tolerance is below the digits of the coordinates, or the file cannot be written.
    BrokenLimitError
        If the plan breaks a limit: a machine would run what is written.  Then no file is written.
    """
    require_instance(curve, Curve, "curve")
    require_instance(plan, (FeedrateProfile, Samples), "plan")
    if mode not in ("feed", "inverse_time"):
        raise InputError(f'mode = {mode!r} must be "feed" or "inverse_time"')
    tolerance = positive_number(tolerance, "tolerance")
    if not _MIN_TOLERANCE_MM <= tolerance < np.inf:
        raise InputError(f"tolerance = {tolerance!r} mm must be finite and at least {_MIN_TOLERANCE_MM} mm")
    require_both_sides(curve)
    _require_sound(path, curve, plan, report)
    decimals = int(np.clip(np.ceil(-np.log10(tolerance)) + 2.0, 4.0, 9.0))
    if isinstance(plan, Samples):
        blocks = _blocks_of_samples(curve, plan, decimals)
    else:
        block_time = positive_number(block_time, "block_time")
        places = np.array([u for u, _ in inserted if curve.domain[0] < u < curve.domain[1]])
        blocks = _blocks_of_profile(curve, plan, tolerance, min(block_time, plan.duration), decimals, places)
    lengths = _lengths(curve, blocks.points)
    times = np.diff(blocks.t)
    rate = 60.0 / times if mode == "inverse_time" else 60.0 * lengths / times
    words = [_number(value) for value in rate]
    taken = np.array([float(word) for word in words])
    taken = 60.0 / taken if mode == "inverse_time" else 60.0 * lengths / taken
    with whole_file(path) as file:
        for line in _lines(curve, blocks, words, mode, 0.5 * tolerance, decimals, inserted):
            file.write(f"{line}\n".encode("ascii"))
    return WrittenProgram(len(words), float(taken.sum()), blocks.deviation)


def require_both_sides(curve: Curve) -> None:
    """Refuse a curve that may leave its program to one side alone: blocks are chords, which pass it to the other."""
    within = curve.made_within
    if within is not None and within.side != PathTolerance.side:
        raise InputError(
            f"{curve.name}: side = {within.side!r}: the blocks of a written program are chords of the path, which pass the "
            "programmed one to the other side; write samples, or leave the side out"
        )


def _require_sound(path: str | Path, curve: Curve, plan: FeedrateProfile | Samples, report: Report | None) -> None:
    """Refuse a plan that breaks a limit, or that cannot be checked."""
    if report is None:
        limits = plan.limits if isinstance(plan, FeedrateProfile) else None
        if limits is None:
            raise InputError(
                f"{path}: not written: the plan does not say its limits; give report = check(curve, limits, plan)"
            )
        report = check(curve, limits, plan)
    if not report.ok:
        raise BrokenLimitError(f"{path}: not written: the plan {report.summary()}; plan again within the limits")


def _blocks_of_profile(
    curve: Curve, profile: FeedrateProfile, tolerance: float, block_time: float, decimals: int, places: FloatArray
) -> _WrittenLines:
    """Cut a profile at equal times, at corners, stops and places, and in halves until every line is within tolerance."""
    law = profile.law
    corners = np.union1d([b.u for b in curve.breaks if b.is_corner], places)
    count = int(np.ceil(profile.duration / block_time))
    if count > _MAX_BLOCKS:
        raise InputError(f"block_time = {block_time!r} s makes {count} blocks; at most {_MAX_BLOCKS} are written")
    fixed = np.unique(np.concatenate([[0.0, profile.duration], _times_at(law, corners), _stops(profile)]))
    t = _merge_times(fixed, np.linspace(0.0, profile.duration, count + 1), 0.25 * block_time)
    u = law.at(t)[0]
    # At a corner the parameter itself: found from the time, it would be off by a rounding.
    at = np.searchsorted(corners, u)
    for k in (np.clip(at - 1, 0, None), at):
        if corners.size:
            near = corners[np.minimum(k, corners.size - 1)]
            u = np.where(np.abs(u - near) <= 1e-9 * np.ptp(curve.domain), near, u)
    u[0], u[-1] = curve.domain
    rounding = 0.5 * 10.0**-decimals * np.sqrt(curve.dim)
    allowed = _PROBE_SHARE * (0.5 * tolerance - rounding)
    for _ in range(_MAX_HALVINGS):
        wide = np.flatnonzero(_deviations(curve, u, _positions(curve, u)) > allowed)
        if wide.size == 0:
            break
        middle = 0.5 * (t[wide] + t[wide + 1])
        t, u = np.insert(t, wide + 1, middle), np.insert(u, wide + 1, law.at(middle)[0])
        if t.size > _MAX_BLOCKS:
            raise InputError(f"tolerance = {tolerance!r} mm makes more than {_MAX_BLOCKS} blocks; give a larger one")
    else:
        raise InputError(
            f"tolerance = {tolerance!r} mm is below what the digits of the curve's parameter allow; give a larger one"
        )
    return _rounded(curve, u, t, _positions(curve, u), np.isin(t, _stops(profile)[1:-1]), decimals)


def _blocks_of_samples(curve: Curve, samples: Samples, decimals: int) -> _WrittenLines:
    return _rounded(curve, samples.u, samples.t, samples.position, np.zeros(samples.t.size, dtype=bool), decimals)


def _rounded(
    curve: Curve, u: FloatArray, t: FloatArray, position: FloatArray, stops: NDArray[np.bool_], decimals: int
) -> _WrittenLines:
    """Points as they are written; those that rounding makes equal become one, and the time stays with the next."""
    scale = np.array([1.0 if unit == "mm" else DEGREES for unit in curve.axis_units])
    points = np.round(position * scale, decimals)
    keep = np.append(True, np.any(np.diff(points, axis=0) != 0.0, axis=1))
    last = int(np.flatnonzero(keep)[-1])
    if last == 0:
        raise InputError(f"{curve.name}: all points are equal when written with {decimals} decimals")
    t, u = t.copy(), u.copy()
    t[last], u[last] = t[-1], u[-1]  # a rest at the end belongs to the last block
    # Which points are dropped before a kept one does not matter: they are that one, or the one before it.
    deviation = float(_deviations(curve, u[keep], points[keep] / scale).max())
    stopped = np.maximum.reduceat(stops, np.flatnonzero(keep))
    return _WrittenLines(points[keep], t[keep], u[keep], stopped, deviation)


def _positions(curve: Curve, u: FloatArray) -> FloatArray:
    return curve.derivatives(u, 0)[0]


def _deviations(curve: Curve, u: FloatArray, points: FloatArray) -> FloatArray:
    """Largest distance, in each block, from probes of the curve to the line between the points, (n - 1,), mm."""
    lever = np.array([1.0 if unit == "mm" else DEGREES for unit in curve.axis_units])
    fraction = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_PROBES) + 0.5) / _PROBES)
    largest = np.empty(u.size - 1)
    for lo in range(0, u.size - 1, 100_000):
        rows = slice(lo, min(lo + 100_000, u.size - 1))
        a, chord = points[rows] * lever, np.diff(points[lo : rows.stop + 1], axis=0) * lever
        ends = u[lo : rows.stop + 1]
        at = ends[:-1, None] + np.diff(ends)[:, None] * np.append(fraction, [0.0, 1.0])
        probes = curve.derivatives(np.clip(at, *curve.domain), 0)[0] * lever - a[:, None]
        along = np.einsum("npd,nd->np", probes, chord) / np.maximum(np.sum(chord**2, axis=1), 1e-300)[:, None]
        away = probes - np.clip(along, 0.0, 1.0)[..., None] * chord[:, None]
        largest[rows] = np.sqrt(np.sum(away**2, axis=2)).max(axis=1)
    return largest


def _stops(profile: FeedrateProfile) -> FloatArray:
    """Times at which the plan rests, both ends included."""
    resting = profile.u_rate <= 1e-9 * profile.u_rate.max()
    return np.unique(np.concatenate([[0.0], profile.t[resting], [profile.duration]]))


def _times_at(law: TimeLaw, u: FloatArray) -> FloatArray:
    """Times at which the plan passes the parameters u, by bisection."""
    lo, hi = np.zeros(u.size), np.full(u.size, law.t[-1])
    for _ in range(60):
        middle = 0.5 * (lo + hi)
        before = law.at(middle)[0] < u
        lo, hi = np.where(before, middle, lo), np.where(before, hi, middle)
    # A node of the plan stands on every corner: its time, where it is that close, joins the stop there.
    k = np.clip(np.searchsorted(law.t, hi), 1, law.t.size - 1)
    near = np.where(hi - law.t[k - 1] < law.t[k] - hi, law.t[k - 1], law.t[k])
    return np.where(np.abs(near - hi) <= 1e-9 * law.t[-1], near, hi)


def _merge_times(fixed: FloatArray, others: FloatArray, distance: float) -> FloatArray:
    """All fixed times, and those others that are farther than a distance from them."""
    k = np.searchsorted(fixed, others)
    below, above = fixed[np.maximum(k - 1, 0)], fixed[np.minimum(k, fixed.size - 1)]
    free = np.minimum(np.abs(others - below), np.abs(others - above)) > distance
    return np.sort(np.concatenate([fixed, others[free]]))


def _lengths(curve: Curve, points: FloatArray) -> FloatArray:
    """Way of each block that F counts: along X Y Z where any of these moves, else along U V W, else along A B C, degrees."""
    step = np.diff(points, axis=0)
    way = np.zeros(step.shape[0])
    for group in (AXES[:3], AXES[6:], AXES[3:6]):
        chosen = np.array([axis in group for axis in curve.axes])
        way = np.where(way > 0.0, way, np.sqrt(np.sum(step[:, chosen] ** 2, axis=1)))
    return way


def _lines(
    curve: Curve,
    blocks: _WrittenLines,
    feeds: list[str],
    mode: FeedMode,
    blend: float,
    decimals: int,
    inserted: Sequence[tuple[float, str]],
) -> Iterator[str]:
    axes = curve.axes
    # after the first point that is not before the place; a place itself is a point, but for rounding
    slack = 1e-9 * np.ptp(curve.domain)
    after: dict[int, list[str]] = {}
    for place, line in inserted:
        after.setdefault(min(int(np.searchsorted(blocks.u, place - slack)), blocks.u.size - 1), []).append(line)
    text = [[_plain(value, decimals) for value in row] for row in blocks.points.tolist()]
    name = "".join(c if c.isascii() and c.isprintable() and c not in "();" else "_" for c in curve.name)[:80]
    yield f"({name}: {len(feeds)} blocks)"
    yield "G21 G17 G90 G94"
    yield "G61"
    yield from after.get(0, ())
    yield "G0 " + " ".join(axis + word for axis, word in zip(axes, text[0], strict=True))
    if mode == "inverse_time":
        yield "G93"
    blending = f"G64 P{_number(blend)} Q0"
    stops = blocks.stops.tolist()
    state, feed = "", ""
    for k in range(1, len(text)):
        wanted = "G61" if stops[k] else blending
        if wanted != state:
            yield wanted
            state = wanted
        words = [axis + word for axis, word, before in zip(axes, text[k], text[k - 1], strict=True) if word != before]
        if mode == "inverse_time" or feeds[k - 1] != feed:
            feed = feeds[k - 1]
            words.append("F" + feed)
        yield "G1 " + " ".join(words)
        yield from after.get(k, ())
    yield "M2"


def _plain(value: float, decimals: int) -> str:
    """A coordinate without the zeros at its end, and never -0."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _number(value: float) -> str:
    """A number > 0 in plain digits, of which eight count."""
    digits = max(_F_DIGITS - 1 - int(np.floor(np.log10(value))), 0)
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text

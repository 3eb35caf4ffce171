"""Plan files, ``.fpr``: what the interpolator of a controller reads; byte by byte in ``docs/format-plan.md``.

    write_plan_file(profile, "part.fpr")
    plan = read_plan_file("part.fpr")

The C side is ``interp/step.c``: what it refuses is refused here too, since this module opens files by it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from interp.rate_limits import RateLimits, rate_limits
from interp.step import PlanStep
from interp.taylor import InterpolatorTable
from planner.errors import InputError
from planner.files.whole_file import whole_file
from planner.inputs import require_instance
from planner.machine.limits import Limits, reserve_shares
from planner.profile import FeedrateProfile
from planner.types import FloatArray

SUFFIX = ".fpr"
MAGIC = b"FEEDPLAN"
VERSION = 1
ORDER = 0x01020304
FRAME = struct.Struct("<8sIIQII")
COUNTS = struct.Struct("<8I")
NUMBERS = struct.Struct("<19d")
_TEXTS = struct.Struct("<32s64s8x")
HEADER_SIZE = 320
AXIS = struct.Struct("<8s8s")
_MAX_LINE = 2**33


def plan_bytes(
    profile: FeedrateProfile,
    limits: Limits | None = None,
    *,
    lines: Sequence[tuple[float, int]] | FloatArray = (),
    governor: RateLimits | None = None,
) -> bytes:
    """Make the bytes of a plan file.

    Parameters
    ----------
    profile : FeedrateProfile
    limits : Limits, optional
        Of the machine; left out, those that the plan was made for, with its reserve added again.
    lines : sequence of (float, int)
        Start time, s, and number of the lines of the part program, in the order in which they run.
    governor : RateLimits, optional
        How override and hold may change the rate of the plan; left out, it is computed for a plan with a reserve.

    Raises
    ------
    InputError
        If the plan has no limits and none are given, or there is a line that is none.
    """
    require_instance(profile, FeedrateProfile, "profile")
    own = _machine_limits(profile, limits)
    reserve = profile.origin.override_reserve
    if governor is None and reserve > 0.0:
        governor = rate_limits(profile, own)
    table = InterpolatorTable.from_profile(profile)
    curve = profile.curve
    starts = _line_starts(lines)
    parts = [
        COUNTS.pack(
            table.dim,
            *table.pieces.shape[1:],
            table.pieces.shape[0] - 1,
            table.segments.shape[0] - 1,
            starts.shape[0] - 1,
            governor is not None,
            0,
        ),
        NUMBERS.pack(
            *(profile.duration, *table.u_range, own.period),
            *(own.feed, own.rapid, own.chord_error, own.tangential_acceleration, own.tangential_jerk),
            *(reserve, *reserve_shares(reserve)),
            *(
                (0.0,) * 5
                if governor is None
                else (governor.high, governor.low, governor.low_until, governor.longest_period, governor.stop_time)
            ),
            *_end_feeds(profile),
        ),
        _TEXTS.pack(curve.fingerprint.encode(), _text(curve.name, 63)),
        *(AXIS.pack(axis.encode(), unit.encode()) for axis, unit in zip(curve.axes, curve.axis_units, strict=True)),
        *(np.ascontiguousarray(row, dtype="<f8").tobytes() for row in (own.velocity, own.acceleration, own.jerk)),
        *(np.ascontiguousarray(a, dtype="<f8").tobytes() for a in (table.ends, table.pieces, table.segments, starts)),
    ]
    body = b"".join(parts)
    frame = FRAME.pack(MAGIC, VERSION, ORDER, FRAME.size + len(body), zlib.crc32(body), 0)
    return frame + body


def write_plan_file(
    profile: FeedrateProfile,
    path: str | Path,
    limits: Limits | None = None,
    *,
    lines: Sequence[tuple[float, int]] | FloatArray = (),
    governor: RateLimits | None = None,
) -> None:
    """Write a plan file, whole or not at all; arguments as for :func:`plan_bytes`.

    Raises
    ------
    InputError
        As :func:`plan_bytes`, or if the file's name does not end in ``.fpr``, or it cannot be written.
    """
    file = Path(path)
    if file.suffix.lower() != SUFFIX:
        raise InputError(f"{file}: a plan file's name must end in {SUFFIX}")
    content = plan_bytes(profile, limits, lines=lines, governor=governor)
    PlanStep(content)  # what the interpolator would refuse is not written
    with whole_file(file) as temporary:
        temporary.write(content)


@dataclass(frozen=True, eq=False)
class PlanFile:
    """What stands in a plan file.

    Attributes
    ----------
    content : bytes
        All of it.
    table : InterpolatorTable
        Time law and curve.
    limits : Limits
        Of the machine.
    lines : (n, 2) array
        Start time, s, and number of the lines of the part program.
    governor : RateLimits, optional
        How override and hold may change the rate; None where the plan has no reserve.
    reserve : float
        The plan was made with 1 - reserve of the jerk and 1 - reserve / 3 of the acceleration.
    feeds : pair of float
        At the start and at the end, mm/s.
    name, fingerprint : str
        Of the curve.
    """

    content: bytes
    table: InterpolatorTable
    limits: Limits
    lines: FloatArray
    governor: RateLimits | None
    reserve: float
    feeds: tuple[float, float]
    name: str
    fingerprint: str


def read_plan_file(source: str | Path | bytes) -> PlanFile:
    """Read a plan file, or its bytes.

    Raises
    ------
    InputError
        If there is no such file, or the interpolator refuses it.
    """
    content = PlanStep(source).content  # checks every number of it
    dim, rows, powers, pieces, segments, lines, governed, _ = COUNTS.unpack_from(content, FRAME.size)
    numbers = NUMBERS.unpack_from(content, FRAME.size + COUNTS.size)
    duration, *u_range, period, feed, rapid, chord, tangential_a, tangential_j, reserve = numbers[:10]
    fingerprint, name = _TEXTS.unpack_from(content, FRAME.size + COUNTS.size + NUMBERS.size)
    axes = [AXIS.unpack_from(content, HEADER_SIZE + AXIS.size * j)[0].rstrip(b"\0").decode() for j in range(dim)]
    sizes = ((3, dim), (2, dim), (pieces + 1, rows, powers), (segments + 1, 8), (lines + 1, 2))
    arrays, at = [], HEADER_SIZE + AXIS.size * dim
    for shape in sizes:
        count = int(np.prod(shape))
        arrays.append(np.frombuffer(content, dtype="<f8", count=count, offset=at).astype(float).reshape(shape))
        at += 8 * count
    axis_limits, ends, curve, law, starts = arrays
    limits = Limits(
        feed, axis_limits[0], axis_limits[1], axis_limits[2], chord, period, tangential_a, tangential_j, axes, rapid
    )
    table = InterpolatorTable(law, curve, duration, (u_range[0], u_range[1]), ends)
    governor = RateLimits(*numbers[12:16]) if governed else None
    text = (name.rstrip(b"\0").decode(), fingerprint.rstrip(b"\0").decode())
    return PlanFile(content, table, limits, starts[:-1], governor, reserve, (numbers[17], numbers[18]), *text)


def _machine_limits(profile: FeedrateProfile, limits: Limits | None) -> Limits:
    if limits is not None:
        return limits.on(profile.curve)
    if profile.limits is None:
        raise InputError("limits: this plan knows none; give those of the machine")
    return profile.limits.without_reserve(profile.origin.override_reserve).on(profile.curve)


def _line_starts(lines: Sequence[tuple[float, int]] | FloatArray) -> FloatArray:
    """Rows of start time and number, closed by one that starts at inf."""
    rows = np.asarray(lines, dtype=np.float64).reshape(-1, 2)
    number = rows[:, 1]
    wrong = ~(np.isfinite(rows).all(axis=1) & (number >= 0.0) & (number < _MAX_LINE) & (number == np.floor(number)))
    wrong[1:] |= np.diff(rows[:, 0]) < 0.0
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(
            f"lines[{i}] = {tuple(rows[i].tolist())} must be a start time not before that of the line before, and a "
            "whole number from 0 to 2^33"
        )
    return np.concatenate([rows, [[np.inf, 0.0]]])


def _end_feeds(profile: FeedrateProfile) -> tuple[float, float]:
    feeds = profile.feed[[0, -1]]
    return float(feeds[0]), float(feeds[1])


def _text(name: str, size: int) -> bytes:
    """A name in UTF-8, cut to a size at the end of a character."""
    return name.encode()[:size].decode(errors="ignore").encode()

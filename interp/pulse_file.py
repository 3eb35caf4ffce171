"""Files of step and direction pulses: compact in binary, ``.steps``, or as text, ``.csv``.

The binary file is little-endian throughout: eight bytes ``FPSTEPS1``; the length of the header, uint32; the header, JSON in
UTF-8, filled up with spaces to a multiple of eight bytes; one uint64 a pulse, ``tick << 8 | axis << 1 | up``; and the end: a
uint64 of ones, the number of pulses, uint64, and the CRC-32 of every byte before the ones, uint64.

The text has the header as lines ``# key = value``, the columns ``tick,axis,direction``, and a last line
``# end = N pulses, crc32 XXXXXXXX`` of every byte before it.  Both are written block by block and read whole.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from interp.pulses import (
    MAX_EXCESS,
    PulseBlock,
    PulseSummary,
    StepDriver,
    first_counts,
    highest_frequency,
    step_pulses,
)
from planner.errors import InputError
from planner.files.whole_file import whole_file
from planner.inputs import require_instance, require_path, shorten
from planner.profile import FeedrateProfile

PULSE_FORMATS = (".steps", ".csv")
FORMAT = "feedplan-steps 1"
_MAGIC = b"FPSTEPS1"
_END = b"\xff" * 8
_TRAILER = len(_END) + 16
_COLUMNS = b"tick,axis,direction\n"
_END_LINE = b"# end = "
_MAX_HEADER = 100_000  # bytes


@dataclass(frozen=True, eq=False)
class PulseTrain:
    """What a file of pulses holds.

    Attributes
    ----------
    header : mapping
        As documented in ``docs/format-export.md``.
    pulses : PulseBlock
    """

    header: Mapping[str, Any]
    pulses: PulseBlock


def pulse_format(path: str | Path) -> str:
    """Return ``.steps`` or ``.csv``; raise InputError for another suffix."""
    suffix = require_path(path).suffix.lower() or PULSE_FORMATS[0]
    if suffix not in PULSE_FORMATS:
        raise InputError(f'{path}: the suffix "{suffix}" must be {" or ".join(PULSE_FORMATS)}')
    return suffix


def write_pulses(path: str | Path, profile: FeedrateProfile, driver: StepDriver) -> PulseSummary:
    """Write the step and direction pulses of a plan, whole or not at all, in bounded memory.

    Parameters
    ----------
    path : str or Path
        ``.steps`` (also without a suffix) or ``.csv``.
    profile : FeedrateProfile
        That it keeps its limits is for the caller to check.
    driver : StepDriver
        Steps per mm or rad of every axis, the clock, and the least times of the drives.

    Returns
    -------
    PulseSummary

    Raises
    ------
    InputError
        If steps of an axis are missing, something else is not allowed, or the file cannot be written.
    BrokenLimitError
        If pulses follow each other closer than the driver takes.  Then no file is left behind.
    """
    require_instance(profile, FeedrateProfile, "profile")
    require_instance(driver, StepDriver, "driver")
    suffix, summary = pulse_format(path), PulseSummary()
    header, blocks = _header(profile, driver), step_pulses(profile, driver, summary)
    with whole_file(path) as file:
        (_write_text if suffix == ".csv" else _write_binary)(file, header, blocks)
    return summary


def read_pulses(path: str | Path) -> PulseTrain:
    """Read a file of :func:`write_pulses`.

    Raises InputError if it cannot be read, is none, is cut off or is damaged.
    """
    suffix = pulse_format(path)
    try:
        data = require_path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        return _read_text(data) if suffix == ".csv" else _read_binary(data)
    except (ValueError, KeyError, IndexError, struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no whole file of pulses ({shorten(str(error))}); write it again") from None


def _header(profile: FeedrateProfile, driver: StepDriver) -> dict[str, Any]:
    axes = profile.curve.axes
    bounds = highest_frequency(profile, driver)
    named = zip(axes, profile.curve.axis_units, driver.steps_of(axes).tolist(), strict=True)
    return {
        "format": FORMAT,
        "curve": " ".join(profile.curve.name.split()),
        "curve_hash": profile.curve.fingerprint,
        "axes": " ".join(axes),
        "duration_s": profile.duration,
        "clock_hz": float(driver.clock_hz),
        **{f"steps_{axis}_per_{unit}": value for axis, unit, value in named},
        **{f"first_count_{axis}": int(c) for axis, c in zip(axes, first_counts(profile, driver), strict=True)},
        **{f"highest_hz_{axis}": float(b) for axis, b in zip(axes, bounds, strict=True) if np.isfinite(b)},
        "allowed_hz": round(driver.max_hz, 6),
        **{f"{name}_s": float(getattr(driver, name)) for name in ("pulse", "space", "setup", "hold")},
        "error": f"half a step and half a tick; where an axis turns, up to {MAX_EXCESS:g} of a step more",
    }


class _Counted:
    """A file of which the CRC-32 and the pulses are counted."""

    def __init__(self, file: BinaryIO) -> None:
        self.file, self.crc, self.pulses = file, 0, 0

    def write(self, data: bytes, pulses: int = 0) -> None:
        self.crc, self.pulses = zlib.crc32(data, self.crc), self.pulses + pulses
        self.file.write(data)


def _write_binary(file: BinaryIO, header: Mapping[str, Any], blocks: Iterable[PulseBlock]) -> None:
    text = json.dumps(header, allow_nan=False).encode()
    text += b" " * (-(len(_MAGIC) + 4 + len(text)) % 8)
    out = _Counted(file)
    out.write(_MAGIC + struct.pack("<I", len(text)) + text)
    for block in blocks:
        words = block.tick.astype("<u8") << np.uint64(8)
        words |= (block.axis.astype("<u8") << np.uint64(1)) | block.up.astype("<u8")
        out.write(words.astype("<u8").tobytes(), len(block))
    file.write(_END + struct.pack("<QQ", out.pulses, out.crc))


def _write_text(file: BinaryIO, header: Mapping[str, Any], blocks: Iterable[PulseBlock]) -> None:
    out = _Counted(file)
    out.write("".join(f"# {key} = {value}\n" for key, value in header.items()).encode())
    out.write(_COLUMNS)
    ends = [f",{axis},{way}\n" for axis in str(header["axes"]).split() for way in ("-1", "1")]
    for block in blocks:
        which = (2 * block.axis.astype(np.intp) + block.up).tolist()
        rows = map("{}{}".format, block.tick.tolist(), map(ends.__getitem__, which))
        out.write("".join(rows).encode(), len(block))
    file.write(_END_LINE + f"{out.pulses} pulses, crc32 {out.crc:08x}\n".encode())


def _read_binary(data: bytes) -> PulseTrain:
    if not data.startswith(_MAGIC):
        raise ValueError(f"it does not begin with {_MAGIC.decode()}")
    (length,) = struct.unpack_from("<I", data, len(_MAGIC))
    first = len(_MAGIC) + 4 + length
    last = len(data) - _TRAILER
    if length > _MAX_HEADER or first > last or (last - first) % 8 or data[last : last + 8] != _END:
        raise ValueError("it is cut off")
    count, crc = struct.unpack_from("<QQ", data, last + 8)
    _require_whole(data[:last], crc, count, (last - first) // 8)
    header = json.loads(data[len(_MAGIC) + 4 : first])
    words = np.frombuffer(data, dtype="<u8", count=count, offset=first)
    axis = ((words >> np.uint64(1)) & np.uint64(127)).astype(np.uint8)
    return PulseTrain(header, PulseBlock((words >> np.uint64(8)).astype(np.int64), axis, (words & np.uint64(1)) == 1))


def _read_text(data: bytes) -> PulseTrain:
    last = data.rfind(_END_LINE)
    if last < 0 or not data.endswith(b"\n"):
        raise ValueError("it is cut off")
    said = data[last + len(_END_LINE) :].decode("ascii").split()
    columns = data.index(_COLUMNS)
    lines = data[:columns].decode("utf-8").splitlines()
    header = dict(_entry(line) for line in lines)
    rows = data[columns + len(_COLUMNS) : last].decode("ascii").splitlines()
    _require_whole(data[:last], int(said[3], 16), int(said[0]), len(rows))
    names = {axis: j for j, axis in enumerate(str(header["axes"]).split())}
    cells = [row.split(",") for row in rows]
    return PulseTrain(
        header,
        PulseBlock(
            np.array([int(tick) for tick, _, _ in cells], dtype=np.int64),
            np.array([names[axis] for _, axis, _ in cells], dtype=np.uint8),
            np.array([way == "1" for _, _, way in cells], dtype=bool),
        ),
    )


def _entry(line: str) -> tuple[str, Any]:
    key, _, value = line[2:].partition(" = ")
    kinds: Iterator[Callable[[str], Any]] = iter((int, float))
    for kind in kinds:
        try:
            return key, value if key in {"curve", "curve_hash"} else kind(value)
        except ValueError:
            continue
    return key, value


def _require_whole(data: bytes, crc: int, count: int, found: int) -> None:
    if count != found:
        raise ValueError(f"it has {found} pulses of {count}")
    if zlib.crc32(data) != crc:
        raise ValueError("its CRC-32 differs")

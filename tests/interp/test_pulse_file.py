"""Files of pulses: what is written comes back, and nothing else comes back at all."""

from __future__ import annotations

import json
import struct
import zlib

import numpy as np
import pytest

from interp import pulses
from interp.pulse_file import FORMAT, PULSE_FORMATS, read_pulses, write_pulses
from interp.pulses import PulseSummary, StepDriver, step_pulses
from planner import BrokenLimitError, InputError, load_curve, load_limits, plan_feedrate

DRIVER = StepDriver({"X": 40.0, "Y": 60.0})
SUFFIXES = pytest.mark.parametrize("suffix", PULSE_FORMATS)


@pytest.fixture(scope="module")
def profile():
    curve = load_curve("circle")
    return plan_feedrate(curve, load_limits("mill").for_curve(curve), intervals=100)


@SUFFIXES
def test_every_pulse_comes_back(profile, tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(pulses, "_PULSES_AT_ONCE", 100)
    summary = write_pulses(tmp_path / f"part{suffix}", profile, DRIVER)
    found = read_pulses(tmp_path / f"part{suffix}")
    expected = PulseSummary()
    blocks = list(step_pulses(profile, DRIVER, expected))
    assert len(blocks) > 10
    for name in ("tick", "axis", "up"):
        assert np.array_equal(getattr(found.pulses, name), np.concatenate([getattr(block, name) for block in blocks]))
    assert summary == expected
    assert len(found.pulses) == sum(summary.pulses)


@SUFFIXES
def test_the_header_says_what_it_takes_to_run_them(profile, tmp_path, suffix):
    file = tmp_path / f"part{suffix}"
    write_pulses(file, profile, DRIVER)
    header = read_pulses(file).header
    assert header["format"] == FORMAT
    assert (header["curve"], header["curve_hash"], header["axes"]) == ("circle", profile.curve.fingerprint, "X Y")
    assert (header["steps_X_per_mm"], header["steps_Y_per_mm"]) == (40.0, 60.0)
    assert header["duration_s"] == profile.duration
    assert (header["highest_hz_X"], header["highest_hz_Y"]) == (4000.0, 6000.0)
    assert (header["allowed_hz"], header["clock_hz"]) == (200_000.0, 1e9)
    start = profile.curve.derivatives(0.0, 0)[0] * [40.0, 60.0]
    assert abs(header["first_count_X"] - start[0]) <= 0.5
    assert abs(header["first_count_Y"] - start[1]) <= 0.5


def test_the_bytes_are_those_of_the_page(profile, tmp_path):
    """Read by nothing but the description."""
    file = tmp_path / "part.steps"
    summary = write_pulses(file, profile, DRIVER)
    data = file.read_bytes()
    assert data[:8] == b"FPSTEPS1"
    (length,) = struct.unpack("<I", data[8:12])
    assert (12 + length) % 8 == 0
    assert json.loads(data[12 : 12 + length])["format"] == FORMAT
    count = sum(summary.pulses)
    words = struct.unpack(f"<{count}Q", data[12 + length : 12 + length + 8 * count])
    ones, said, crc = struct.unpack("<QQQ", data[12 + length + 8 * count :])
    assert (ones, said, crc) == (2**64 - 1, count, zlib.crc32(data[: 12 + length + 8 * count]))
    assert [sum((w >> 1 & 127) == j for w in words) for j in (0, 1)] == summary.pulses
    assert list(words) == sorted(words, key=lambda w: w >> 8)


@SUFFIXES
def test_damage_is_told(profile, tmp_path, suffix):
    file = tmp_path / f"part{suffix}"
    write_pulses(file, profile, DRIVER)
    data = file.read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for k in rng.integers(0, len(data), 60):
        other = bytearray(data)
        other[k] ^= 1 << int(rng.integers(0, 7))
        file.write_bytes(bytes(other))
        with pytest.raises(InputError, match="is no whole file of pulses"):
            read_pulses(file)
        file.write_bytes(data[:k])
        with pytest.raises(InputError, match="is no whole file of pulses"):
            read_pulses(file)
        refused += 1
    assert refused == 60


@SUFFIXES
def test_nothing_is_left_of_pulses_that_are_refused(profile, tmp_path, suffix):
    file = tmp_path / f"part{suffix}"
    with pytest.raises(BrokenLimitError, match="the driver takes 5000 Hz there"):
        write_pulses(file, profile, StepDriver({"X": 100.0, "Y": 100.0}, pulse=1e-4, space=1e-4))
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_none(profile, tmp_path):
    with pytest.raises(InputError, match=r'the suffix "\.npz" must be \.steps or \.csv'):
        write_pulses(tmp_path / "part.npz", profile, DRIVER)
    with pytest.raises(InputError, match="cannot be read"):
        read_pulses(tmp_path / "none.steps")
    (tmp_path / "other.steps").write_bytes(b"G1 X1\n" * 100)
    with pytest.raises(InputError, match="it does not begin with FPSTEPS1"):
        read_pulses(tmp_path / "other.steps")

"""Plan files: what is written is read, what is damaged is refused, and no byte leads the interpolator out of bounds."""

import re
import shutil
import struct
import subprocess
import zlib

import numpy as np
import pytest
from cases import PROJECT

from interp import InterpolatorTable
from interp.plan_file import COUNTS, FRAME, HEADER_SIZE, NUMBERS, plan_bytes, read_plan_file, write_plan_file
from interp.step import PlanStep
from planner import Limits, load_curve, plan_feedrate
from planner.errors import InputError

LIMITS = Limits(100.0, 300.0, 1000.0, 20000.0)
LINES = [(0.0, 1), (0.25, 4), (0.25, 5), (0.5, 2)]
DRIVER = PROJECT / "tests" / "interp" / "plan_file_driver.c"


@pytest.fixture(scope="module")
def plan():
    curve = load_curve("teardrop")
    return plan_feedrate(curve, LIMITS.on(curve), override_reserve=0.1, intervals=150)


@pytest.fixture(scope="module")
def content(plan):
    return plan_bytes(plan, LIMITS.on(plan.curve), lines=LINES)


def sealed(content):
    """The bytes with the checksum that they have now."""
    return content[:24] + struct.pack("<I", zlib.crc32(content[32:])) + content[28:]


# ---- what stands in it -----------------------------------------------------------------------------------------------


def test_what_is_written_is_read(plan, content, tmp_path):
    write_plan_file(plan, tmp_path / "part.fpr", LIMITS, lines=LINES)
    assert (tmp_path / "part.fpr").read_bytes() == content
    found, table = read_plan_file(tmp_path / "part.fpr"), InterpolatorTable.from_profile(plan)
    for name in ("segments", "pieces", "ends"):
        assert (getattr(found.table, name) == getattr(table, name)).all()
    assert (found.table.duration, found.table.u_range) == (table.duration, table.u_range)
    assert found.limits == LIMITS.on(plan.curve)
    assert found.lines.tolist() == [list(map(float, line)) for line in LINES]
    assert found.reserve == 0.1
    assert found.governor is not None
    assert found.feeds == (0.0, 0.0)
    assert (found.name, found.fingerprint) == (plan.curve.name, plan.curve.fingerprint)


def test_without_limits_those_of_the_machine_come_from_the_plan(plan, content):
    found = read_plan_file(plan_bytes(plan))
    for key in ("velocity", "acceleration", "jerk"):
        assert getattr(found.limits, key) == pytest.approx(getattr(LIMITS.on(plan.curve), key), rel=1e-15)


def test_every_byte_is_documented(content):
    """The tables of the page, read as a reader would: they must tell where each number of a file stands."""
    page = (PROJECT / "docs" / "format-plan.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)`", page, re.MULTILINE)
    sizes = {"bytes": 1, "u32": 4, "u64": 8, "f64": 8}
    at, named = 0, {}
    for offset, kind, count, name in rows:
        assert int(offset) == at, name
        at += sizes[kind] * int(count or 1)
        named[name] = int(offset), kind
    assert at == HEADER_SIZE

    def value(name):
        offset, kind = named[name]
        return struct.unpack_from({"u32": "<I", "u64": "<Q", "f64": "<d"}[kind], content, offset)[0]

    assert value("size") == len(content)
    assert (value("dim"), value("lines"), value("governed")) == (2, 4, 1)
    assert value("checksum") == zlib.crc32(content[32:])
    found = read_plan_file(content)
    assert value("duration") == found.table.duration
    assert value("rate_jerk_high") == found.governor.high
    assert value("low_until") == found.governor.low_until
    assert value("stop_time") == pytest.approx(found.governor.stop_time, rel=1e-6)
    assert value("chord_error") == np.inf
    assert value("override_reserve") == 0.1


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([(0.2, 1), (0.1, 2)], r"lines\[1\] = \(0.1, 2.0\) must be a start time not before"),
        ([(0.0, -1)], r"lines\[0\]"),
        ([(0.0, 1.5)], r"lines\[0\]"),
        ([(np.nan, 1)], r"lines\[0\]"),
    ],
)
def test_lines_that_are_none_are_refused(plan, lines, message):
    with pytest.raises(InputError, match=message):
        plan_bytes(plan, lines=lines)


def test_a_file_of_another_name_is_refused(plan, tmp_path):
    with pytest.raises(InputError, match=r"must end in \.fpr"):
        write_plan_file(plan, tmp_path / "part.bin")
    with pytest.raises(InputError, match="cannot be read"):
        read_plan_file(tmp_path / "none.fpr")


# ---- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("offset", "value", "message"),
    [
        (0, b"X", "no plan file"),
        (8, b"\2", "another version"),
        (16, b"\0", "cut off"),
        (24, b"\0\0\0\0", "checksum"),
        (12, b"\1\2\3\4", "no plan file"),
        (28, b"\1", "cut off"),
    ],
)
def test_a_damaged_frame_says_what_is_wrong(content, offset, value, message):
    with pytest.raises(InputError, match=message):
        PlanStep(content[:offset] + value + content[offset + len(value) :])


def _arrays(content):
    """Offsets of the first curve piece, segment and line."""
    dim, rows, powers, pieces, segments, _, _, _ = COUNTS.unpack_from(content, FRAME.size)
    curve = HEADER_SIZE + 16 * dim + 40 * dim
    law = curve + 8 * (pieces + 1) * rows * powers
    return curve, law, law + 64 * (segments + 1)


@pytest.mark.parametrize(
    ("array", "row", "value", "message"),
    [
        (0, 1, 0.0, "out of order"),  # width of a piece
        (0, 0, np.nan, "not finite"),
        (1, 0, 1.0, "out of order"),  # the first segment begins at 0
        (1, 8, -1.0, "out of order"),
        (1, 7, 1e9, "numbers a curve piece"),
        (1, 7, 0.5, "numbers a curve piece"),
        (1, 7, -1.0, "numbers a curve piece"),
        (1, 2, np.inf, "not finite"),
        (2, 0, np.inf, "not finite"),
        (2, 1, 0.5, "numbers a curve piece or a line"),
        (2, 2, -0.5, "out of order"),
    ],
)
def test_a_wrong_number_is_refused_though_the_checksum_fits(content, array, row, value, message):
    at = _arrays(content)[array] + 8 * row
    with pytest.raises(InputError, match=message):
        PlanStep(sealed(content[:at] + struct.pack("<d", value) + content[at + 8 :]))


@pytest.mark.parametrize("field", range(7))
@pytest.mark.parametrize("value", [0, 2, 0x7FFFFFFF, 0xFFFFFFFF])
def test_sizes_that_contradict_one_another_are_refused(content, field, value):
    at = FRAME.size + 4 * field
    changed = content[:at] + struct.pack("<I", value) + content[at + 4 :]
    if changed != content and not (field == 6 and value == 0):
        with pytest.raises(InputError, match="cut off"):
            PlanStep(sealed(changed))


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (0, -1.0),
        (0, np.nan),
        (3, 0.0),
        (9, np.nan),
        (9, 0.6),
        (10, 0.0),
        (11, 1.5),
        (12, -1.0),
        (13, 0.0),
        (14, 0.0),
        (15, np.nan),
        (16, np.inf),
    ],
)
def test_header_numbers_out_of_range_are_refused(content, place, value):
    at = FRAME.size + COUNTS.size + 8 * place
    assert place < NUMBERS.size // 8
    with pytest.raises(InputError, match=r"not in its range|out of order"):
        PlanStep(sealed(content[:at] + struct.pack("<d", value) + content[at + 8 :]))


# ---- mutants, under sanitizers -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    """The interpolator as a controller compiles it, with the sanitizers, around the mutations."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    program = tmp_path_factory.mktemp("driver") / "driver"
    flags = ["-std=c11", "-O1", "-g", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", f"-I{PROJECT}"]
    flags += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    made = subprocess.run(
        [compiler, *flags, str(DRIVER), str(PROJECT / "interp" / "step.c"), "-o", str(program), "-lm"],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode and "sanitize" in made.stderr:
        pytest.skip("needs the address sanitizer")
    assert made.returncode == 0, made.stderr
    return program


def mutations(rng, size, count, *, mended):
    """A stream of mutants for the driver: flips, cuts, words of zeros and ones, copies of numbers that are special."""
    parts = [struct.pack("<q", count)]
    special = [struct.pack("<d", x) for x in (np.inf, -np.inf, np.nan, -0.0, 1e300, -1e300, 5e-324, 2.0**31, -1.0)]
    for _ in range(count):
        kind = rng.integers(4)
        cut = int(rng.integers(size)) if kind == 0 else -1
        changes = []
        if kind == 1:
            changes = [(int(rng.integers(size)), int(rng.integers(256))) for _ in range(rng.integers(1, 8))]
        elif kind == 2:  # the header, where the sizes are
            changes = [(int(rng.integers(HEADER_SIZE)), int(rng.integers(256))) for _ in range(rng.integers(1, 4))]
        elif kind == 3:
            at, value = 8 * int(rng.integers(size // 8)), special[rng.integers(len(special))]
            changes = [(at + i, byte) for i, byte in enumerate(value)]
        parts.append(
            struct.pack(f"<{2 + 2 * len(changes)}q", cut, len(changes), *(x for pair in changes for x in pair))
        )
        parts.append(struct.pack("<q", mended))
    return b"".join(parts)


def run_driver(driver, content, stream, *before):
    given = struct.pack("<q", len(content)) + content + stream
    done = subprocess.run([*before, str(driver)], input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return tuple(map(int, done.stdout.split()))


def test_mutants_are_refused_or_the_same(driver, content):
    refused, other = run_driver(driver, content, mutations(np.random.default_rng(1), len(content), 1500, mended=False))
    assert other == 0
    assert refused > 1400


def test_mutants_whose_checksum_fits_never_lead_out_of_bounds(driver, content):
    """What is accepted has other numbers, and that is all: the sanitizers see every access."""
    refused, other = run_driver(driver, content, mutations(np.random.default_rng(2), len(content), 500, mended=True))
    assert refused > 100
    assert other > 50


@pytest.mark.slow
@pytest.mark.parametrize("mended", [False, True])
def test_a_hundred_thousand_mutants(driver, content, mended):
    total = 0
    for seed in range(10):
        stream = mutations(
            np.random.default_rng(100 + seed), len(content), 10_000 if not mended else 2000, mended=mended
        )
        refused, other = run_driver(driver, content, stream)
        total += refused
        assert mended or other == 0
    assert total > 10_000


@pytest.mark.slow
def test_valgrind_finds_nothing(content, tmp_path):
    if shutil.which("valgrind") is None or shutil.which("cc") is None:
        pytest.skip("needs valgrind and a C compiler")
    program = tmp_path / "driver"
    flags = ["-std=c11", "-O1", "-g", "-ffp-contract=off", f"-I{PROJECT}"]
    files = [str(DRIVER), str(PROJECT / "interp" / "step.c")]
    subprocess.run(["cc", *flags, *files, "-o", str(program), "-lm"], check=True)
    for mended in (False, True):
        stream = mutations(np.random.default_rng(3), len(content), 40, mended=mended)
        run_driver(program, content, stream, "valgrind", "--error-exitcode=9", "--leak-check=full", "-q")

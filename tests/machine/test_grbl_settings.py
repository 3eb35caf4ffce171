"""Limits from what a GRBL controller answers to $$."""

import math
from contextlib import suppress

import numpy as np
import pytest

from planner.errors import InputError
from planner.machine.machine_file import load_limits, read_machine

ROUTER = """\
Grbl 1.1h ['$' for help]
>>> $$
$0=10
$11=0.015
$12=0.002
$13=0
$32=0
$100=40.000
$110=6000.000
$111=4800.000
$112=900.000
$120=350.000
$121=300.000
$122=120.000
$130=300.000
$131=180.000
$132=45.000
ok
"""
SIX = """\
[MSG:'$H'|'$X' to unlock]
$11=0.010 (junction deviation, mm)
$110=3000.0   X-axis maximum rate, mm/min
$111=3000.0
$112=1200.0
$113=7200.0   ; A-axis maximum rate, deg/min
$114=3600.0 // B
$115=1800.0
$120=200.0
$121=200.0
$122=100.0
$123=900.0
$124=450.0
$125=180.0
$300=grblHAL
$800=4000.0
$801=4000.0
$802=2000.0
$803=9000.0
<Idle|MPos:0.000,0.000,0.000|FS:0,0>
ok
"""


@pytest.fixture
def load(tmp_path):
    def load(text, **options):
        path = tmp_path / "settings.txt"
        path.write_text(text)
        return load_limits(path, **options)

    return load


@pytest.fixture
def refusal(load):
    def refusal(text):
        with pytest.raises(InputError) as caught:
            load(text)
        return str(caught.value).partition("settings.txt:")[2]

    return refusal


def test_three_axes(load):
    limits = load(ROUTER)
    assert limits.axes == ("X", "Y", "Z")
    assert limits.velocity.tolist() == pytest.approx([100, 80, 15], rel=1e-15)
    assert limits.acceleration.tolist() == [350, 300, 120]
    assert limits.jerk.tolist() == [math.inf] * 3
    assert (limits.feed, limits.rapid, limits.chord_error) == (math.inf, math.inf, math.inf)


def test_six_axes_with_remarks_and_jerk(load):
    limits = load(SIX)
    degree = np.pi / 180
    assert limits.axes == ("X", "Y", "Z", "A", "B", "C")
    assert limits.velocity.tolist() == pytest.approx([50, 50, 20, 120 * degree, 60 * degree, 30 * degree], rel=1e-15)
    assert limits.acceleration[3:].tolist() == pytest.approx([900 * degree, 450 * degree, 180 * degree], rel=1e-15)
    assert limits.jerk.tolist() == pytest.approx([4000, 4000, 2000, 9000 * degree, math.inf, math.inf], rel=1e-15)


def test_a_missing_jerk_is_given_beside_it(load, tmp_path):
    assert load(ROUTER, complete={"jerk_mm_s3": 5000.0}).jerk.tolist() == [5000] * 3
    both = load(SIX, complete={"jerk_rad_s3": 70.0})
    assert both.jerk.tolist() == pytest.approx([4000, 4000, 2000, 9000 * np.pi / 180, 70, 70], rel=1e-15)
    notes = read_machine(tmp_path / "settings.txt").notes
    assert notes == (
        "its junction deviation of 0.01 mm is no limit: the tolerance of the path stands for it",
        "no jerk limit on B C",
    )


@pytest.mark.parametrize("end", ["\r\n", "\n"])
def test_line_ends_and_any_suffix(tmp_path, end):
    path = tmp_path / "dump.nc"
    path.write_bytes(ROUTER.replace("\n", end).encode())
    assert load_limits(path).velocity[0] == pytest.approx(100.0)


def test_a_dump_cut_anywhere_is_refused_or_whole(tmp_path):
    """At every byte: refused in the lines that count, and else what the whole dump says."""
    whole = ROUTER.encode()
    path = tmp_path / "cut.txt"
    path.write_bytes(whole)
    expected = load_limits(path)
    last = whole.index(b"$122=120.000") + len(b"$122=120.000\n")
    for size in range(last):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.txt:"):
            load_limits(path)
    whole_again = 0
    for size in range(last, len(whole)):
        path.write_bytes(whole[:size])
        with suppress(InputError):  # in the middle of another line
            assert load_limits(path) == expected
            whole_again += 1
    assert whole_again > 20


def test_a_garbled_byte_is_refused_or_changes_no_limit(tmp_path):
    """In a line that counts every byte, in others what makes it no line of a controller."""
    lines = ROUTER.splitlines(keepends=True)
    path = tmp_path / "noise.txt"
    path.write_text(ROUTER)
    expected = load_limits(path)
    trials = 0
    for k, line in enumerate(lines):
        counts = line.startswith(("$11", "$12")) and "$12=" not in line
        for at in range(len(line) - 1):
            path.write_text("".join([*lines[:k], line[:at] + "~" + line[at + 1 :], *lines[k + 1 :]]))
            with pytest.raises(InputError, match=r"noise\.txt:") if counts else suppress(InputError):
                assert load_limits(path) == expected
            trials += counts
    assert trials > 70


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("$111=4800.000", "$111=-3", "10: velocity of Y, $111 = -3 must be a number > 0"),
        ("$111=4800.000", "$111=0", "10: velocity of Y, $111 = 0 must be a number > 0"),
        ("$121=300.000", "$121=", "13: acceleration of Y, $121 = nothing must be a number > 0"),
        ("$122=120.000", "$122=fast", "14: acceleration of Z, $122 = fast must be a number > 0"),
        ("$11=0.015", "$11=x", "4: junction deviation, $11 = x must be a number >= 0"),
        (
            "$121=300.000\n",
            "",
            " $121 is missing, acceleration of axis Y; write it there, or give acceleration_mm_s2 (--acceleration-mm-s2)",
        ),
        ("$112=900.000", "$112=900.000\n$112=90", "12: $112: is given twice, first in line 11; leave one"),
        (
            "$112=900.000",
            f"${'1' * 5000}=900.000",
            f'11: ${"1" * 56}...: is neither a setting such as "$110=5000" nor what a controller says beside them; the dump '
            "is cut or garbled: send $$ to the controller again",
        ),
        (
            "$112=900.000",
            "#112=900.000\nG1 X3",
            '12: G1 X3: is neither a setting such as "$110=5000" nor what a controller says beside them; the dump is cut or '
            "garbled: send $$ to the controller again",
        ),
        (
            "$111=4800.000\n",
            "$111=4800.000",
            "10: $111=4800.000$112=900.000: has more than one setting; each needs a line of its own: send $$ to the "
            "controller again",
        ),
    ],
)
def test_refusals_name_file_line_and_setting(refusal, old, new, message):
    assert old in ROUTER
    assert refusal(ROUTER.replace(old, new, 1)) == message


def test_a_dump_without_axes(refusal):
    assert refusal("$10=1\nok\n") == " $110 is missing, the velocity of X in mm/min; send $$ to the controller again"

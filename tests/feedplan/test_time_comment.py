"""The time written back: in the right places, in place of an earlier one, and not a byte of the program changed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest
from cases import PROJECT
from hypothesis import given
from hypothesis import strategies as st

from feedplan.program_time import time_program
from feedplan.time_comment import program_with_time
from planner import read_program
from planner.machine.program_setup import RestTimes
from planner.programs.program_text import ProgramText

PART = (
    "%\nO1001 (bracket)\n\n(Roughing)\nT1 M6\nG21 G90\nG0 X5 Y0\nG1 X60 F3000\nG4 P0.5\n(Finish)\n"
    "G0 X0\nG1 X40\nM30\n%\n"
)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    file = tmp_path_factory.mktemp("post") / "part.ngc"
    file.write_text(PART.replace("O1001 (bracket)\n", ""))
    return time_program(file, "mill", tool_change_s=8.0)


def posted(found, raw):
    """The program with another text; it must have its operations in the same lines."""
    return program_with_time(replace(found, text=ProgramText(raw)))


def own(raw):
    """The lines that are not ours."""
    return b"".join(line for line in raw.splitlines(keepends=True) if b"feedplan: time " not in line)


def test_by_hand(found):
    out = program_with_time(found).decode().splitlines()
    total, motion = found.total_s, found.motion_s
    first, second = found.operations
    assert out[:4] == [
        "%",
        f"(feedplan: time 0:00:{total:02.0f}, {total:.2f} s)",
        f"(feedplan: time of motion {motion:.2f} s, dwells 0.50 s, 1 tool change 8.00 s)",
        "",
    ]
    for name, part in zip(("(Roughing)", "(Finish)"), (first, second), strict=True):
        said = f"(feedplan: time 0:00:{part.total_s:02.0f}, {part.total_s:.2f} s, of this operation)"
        assert out[out.index(name) + 1] == said
    assert sum("feedplan" in line for line in out) == 4
    assert first.total_s + second.total_s == pytest.approx(total)


def test_a_change_that_nobody_times_is_said(found):
    bare = replace(found, rests=RestTimes())
    assert b"1 tool change not counted)" in program_with_time(bare)


def test_again_is_the_same(found, tmp_path):
    """The file with the time in it is timed alike, and its comments are replaced."""
    file = tmp_path / "part.ngc"
    file.write_bytes(program_with_time(found))
    again = time_program(file, "mill", tool_change_s=8.0)
    assert again.total_s == found.total_s
    assert [part.name for part in again.operations] == [part.name for part in found.operations]
    assert program_with_time(again) == file.read_bytes()
    other = time_program(file, "mill", tool_change_s=20.0)
    assert program_with_time(other) != file.read_bytes()
    assert own(program_with_time(other)) == own(program_with_time(found))
    assert program_with_time(other).count(b"feedplan") == 4


def test_the_moves_stay(found, tmp_path):
    file = tmp_path / "out.ngc"
    file.write_bytes(program_with_time(found))
    before = tmp_path / "before.ngc"
    before.write_bytes(found.text.raw)
    one, other = read_program(before), read_program(file)
    assert one.end.tolist() == other.end.tolist()
    assert one.feed.tolist() == other.feed.tolist()


class TestBytes:
    @pytest.mark.parametrize(
        ("head", "behind"),
        [
            (b"%\n", 1),
            (b"%\nO1001\n", 2),
            (b"%\nO1001 (bracket)\n", 2),
            (b"\n%\n:77\n", 3),
            (b"O7\n", 1),
            (b"", 0),
            (b"(bracket)\n", 0),
            (b"\n\nG21\n", 0),
            (b"o100 sub\n", 0),
        ],
    )
    def test_the_head(self, found, head, behind):
        bare = replace(found, operations=())
        lines = posted(bare, head + b"G21 G90\n").splitlines()
        assert [b"feedplan" in line for line in lines].index(True) == behind
        assert own(posted(bare, head + b"G21 G90\n")) == head + b"G21 G90\n"

    def test_a_byte_order_mark_stays_first(self, found):
        out = posted(replace(found, operations=()), b"\xef\xbb\xbf%\nG21\n")
        assert out.startswith(b"\xef\xbb\xbf%\n(feedplan: time ")

    def test_line_ends_encoding_and_a_last_line_without_end(self, found):
        raw = PART.replace("Roughing", "Gr\xf6be").replace("\n", "\r\n").encode("cp1252").rstrip(b"\r\n")
        out = posted(replace(found, operations=()), raw)
        assert own(out) == raw
        assert out.count(b"\n") == out.count(b"\r\n") == raw.count(b"\n") + 2

    def test_semicolons_where_the_program_has_no_parentheses(self, found):
        bare = replace(found, operations=())
        out = posted(bare, b"; a part\nG21 ; mm\nG0 X1\n")
        assert out.startswith(b"; feedplan: time 0:")
        assert b"(" not in out
        assert posted(bare, out) == out
        assert posted(bare, b"; a part\n(head)\n").startswith(b"(feedplan: time ")

    def test_earlier_comments_go_also_from_other_places_and_behind_n_words(self, found):
        bare = replace(found, operations=())
        old = b"G21\nN5 (feedplan: time 1:00:00, 3600.00 s)\nG90\n(feedplan: time 0:00:01, 1.00 s, of this operation)"
        assert own(posted(bare, old)) == b"G21\nG90\n"
        assert posted(bare, old).count(b"feedplan") == 2

    @given(st.binary(max_size=200))
    def test_nothing_else_changes(self, found, raw):
        bare = replace(found, operations=())
        out = posted(bare, raw)
        assert posted(bare, out) == out
        mark = b"\xef\xbb\xbf" if raw.startswith(b"\xef\xbb\xbf") else b""
        kept = [line for line in out.removeprefix(mark).split(b"\n") if b"feedplan: time " not in line]
        assert mark + b"\n".join(kept) == raw


class TestCommand:
    @pytest.fixture
    def part(self, tmp_path):
        (tmp_path / "part.ngc").write_text(PART)
        return tmp_path / "part.ngc"

    def test_a_copy(self, run, part, tmp_path):
        out = tmp_path / "out.nc"
        code, text, err = run("time", part, "--post", out, "--tool-change-s", "8")
        assert (code, err) == (0, "")
        assert text.splitlines()[-1].split() == ["written", str(out)]
        assert part.read_text() == PART
        assert own(out.read_bytes()).decode() == PART

    def test_in_place_and_again(self, run, part):
        assert run("time", part, "--in-place")[0] == 0
        once = part.read_bytes()
        assert own(once).decode() == PART
        assert run("time", part, "--in-place")[0] == 0
        assert part.read_bytes() == once

    def test_standard_input_and_output(self):
        """What it has to say goes to standard error."""

        def typed(*words):
            line = [sys.executable, "-m", "feedplan", "time", "-", "--machine", "mill", *words]
            return subprocess.run(line, input=PART.encode(), capture_output=True, check=False, cwd=PROJECT)

        done = typed("--post", "-")
        assert done.returncode == 0
        assert own(done.stdout).decode() == PART
        assert b"written       standard output" in done.stderr
        refused = typed("--in-place")
        assert (refused.returncode, refused.stdout) == (2, b"")
        assert b"the program is standard input; give --post" in refused.stderr

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            (("--post", "part.ngc"), "part.ngc: is an input of this command"),
            (("--post", "nowhere/out.ngc"), "nowhere/out.ngc: cannot be written (there is no directory"),
            (("--post", "."), ".: cannot be written (it is a directory)"),
            (("--post", "x.csv", "-o", "x.csv"), "x.csv: is given for two outputs"),
            (("--post", "out.ngc", "--in-place"), "--in-place writes into the program, --post into another file"),
            (("--tool-change-s", "-1"), "tool_change_s = -1.0 must be a finite number of at least 0, in s"),
            (("--tool-change-s", "nan"), "tool_change_s = nan must be a finite number of at least 0, in s"),
        ],
    )
    def test_what_is_refused(self, run, part, tmp_path, monkeypatch, words, said):
        monkeypatch.chdir(tmp_path)
        code, out, err = run("time", "part.ngc", *words)
        assert (code, out) == (2, "")
        assert said in err
        assert sorted(file.name for file in tmp_path.iterdir()) == ["part.ngc"]
        assert part.read_text() == PART

    def test_a_program_that_breaks_a_limit_is_not_written(self, run, part, tmp_path, monkeypatch):
        import feedplan.cli.time
        import feedplan.program_time

        kept = feedplan.program_time.time_program
        monkeypatch.setattr(
            feedplan.program_time,
            "time_program",
            lambda *given, **options: replace(
                kept(*given, **options), ok=False, worst="jerk X: 2 times what is allowed"
            ),
        )
        code, out, err = run("time", part, "--post", tmp_path / "out.ngc")
        assert code == 1
        assert "LIMIT BROKEN  jerk X: 2 times" in out
        assert "written" not in out
        assert "out.ngc: not written, for the plan breaks a limit" in err
        assert not (tmp_path / "out.ngc").exists()

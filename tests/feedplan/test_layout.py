"""Lines for a terminal: what wraps, what stands under what, and that colours change nothing else."""

from __future__ import annotations

import click
import pytest

from feedplan.layout import BOLD, RED, Cell, indented, named, styled, table, wrapped


@pytest.fixture
def columns(monkeypatch):
    """Set the columns of the terminal."""
    return lambda number: monkeypatch.setenv("COLUMNS", str(number))


class TestNamed:
    def test_a_short_text_stands_beside_its_name(self, columns):
        columns(80)
        assert named("curve", "circle") == ["curve         circle"]
        assert named("held back by", "feed") == ["held back by  feed"]
        assert named("note", "") == ["note          "]

    @pytest.mark.parametrize("width", [20, 40, 80, 200])
    def test_a_long_text_wraps_under_itself_and_loses_no_word(self, columns, width):
        columns(width)
        text = " ".join(f"word-{k}" for k in range(60))
        lines = named("note", text)
        assert max(map(len, lines)) <= width - 2
        assert [line[:14] for line in lines] == ["note".ljust(14), *[" " * 14] * (len(lines) - 1)]
        said = " ".join(line[14:] for line in lines)
        assert said == text if width > 20 else said.replace(" ", "") == text.replace(" ", "")

    def test_a_word_longer_than_a_line_is_broken(self, columns):
        columns(40)
        lines = named("written", "/" + "x" * 99)
        assert "".join(line[14:] for line in lines) == "/" + "x" * 99

    def test_every_line_has_the_style(self, columns):
        columns(30)
        lines = named("note", "one two three four five six", BOLD)
        assert len(lines) > 1
        assert all("\033[1m" in line and line.endswith("\033[0m") for line in lines)
        assert [click.unstyle(line) for line in lines] == named("note", "one two three four five six")

    def test_a_terminal_of_no_width_still_gets_the_text(self, columns):
        columns(1)
        assert "".join(line[14:] for line in named("a", "text")) == "text"


def test_lines_of_a_text_stay_lines():
    assert wrapped("one\n\ntwo words", 6) == ["one", "", "two", "words"]
    assert wrapped("two  spaces stay", 40) == ["two  spaces stay"]


def test_indented(columns):
    columns(12)
    assert indented("some longer words") == ["  some", "  longer", "  words"]


def test_no_style_is_no_escape_sequence():
    assert styled("text", "") == "text"
    assert styled("", RED) == ""


class TestTable:
    HEADS = ("limit", "long\nhead", "t")
    ROWS = (("jerk X", "1.5", Cell("12 s", RED)), ("feed", "100.25", "3 s"))

    def test_columns_stand_under_their_heads(self):
        lines = [click.unstyle(line) for line in table(self.HEADS, self.ROWS, left=("limit",))]
        assert lines == [
            "          long",
            "limit     head     t",
            "jerk X     1.5  12 s",
            "feed    100.25   3 s",
        ]

    def test_only_heads_and_marked_cells_have_a_style(self):
        *heads, first, second = table(self.HEADS, self.ROWS, left=("limit",))
        assert all("\033[4m" in head for head in heads)
        assert first.endswith("\033[1;31m12 s\033[0m")
        assert "\033" not in second

    def test_no_blanks_at_the_end_of_a_column_that_begins_at_the_left(self):
        *_, last = table(("a", "kind"), [("1", "arc"), ("2", "a")], left=("kind",))
        assert last == "2  a"

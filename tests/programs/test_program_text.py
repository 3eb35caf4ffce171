"""The text of a program: lines, N words and comments as they stand."""

from __future__ import annotations

import pytest

from planner import InputError
from planner.programs.program_text import Comment, ProgramText, decoded

RAW = (
    b"%\r\nN10 G21 (units)\r\n(Tasche 1 \xfc)\r\n  n 20.5 G1 X1\t; to the corner\r\n"
    b"N30 (in a block)\r\n; alone \r\n(a) (b)\r\n()\r\n%"
)


def test_lines_and_n_words():
    text = ProgramText(RAW)
    assert text.count == 9
    assert [text.line(k) for k in (1, 2, 4, 9, 0, 10)] == [
        "%",
        "N10 G21 (units)",
        "n 20.5 G1 X1\t; to the corner",
        "%",
        "",
        "",
    ]
    assert [text.number_word(k) for k in (1, 2, 4, 5)] == ["", "N10", "N20.5", "N30"]
    assert text.shown(4) == "n 20.5 G1 X1 ; to the corner"
    assert [text.comment_in(k) for k in (1, 2, 4)] == ["", "units", "to the corner"]


def test_comments_that_stand_alone():
    assert ProgramText(RAW).comments == (
        Comment(3, "Tasche 1 ü"),
        Comment(5, "in a block"),
        Comment(6, "alone"),
        Comment(8, ""),
    )


@pytest.mark.parametrize(("raw", "count"), [(b"", 1), (b"G0", 1), (b"G0\n", 1), (b"G0\n\n", 2), (b"\nG0", 2)])
def test_ends_of_files(raw, count):
    text = ProgramText(raw)
    assert text.count == count
    assert [text.line(k) for k in range(1, count + 1)] == raw.decode().split("\n")[:count]


def test_umlauts_of_either_encoding():
    assert decoded("Größe".encode()) == decoded("Größe".encode("cp1252")) == "Größe"


def test_a_long_line_is_cut_where_it_is_shown():
    assert len(ProgramText(b"G1 " + 500 * b"X1 ").shown(1)) < 100


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none\.ngc: cannot be read"):
        ProgramText.read(tmp_path / "none.ngc")

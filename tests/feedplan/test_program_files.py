"""Names on a command line: which programs they stand for, what they are called, and what is said of the rest."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from feedplan.program_files import called_files, distinct_labels, find_programs
from planner.errors import InputError

MOVE = "G0 X0\nG1 X10 F600\nM2\n"


@pytest.fixture
def parts(tmp_path):
    for name in ("b.ngc", "a.NC", "c.tap", "notes.txt", "drawing.dxf", "z.md", ".hidden"):
        (tmp_path / name).write_text(MOVE)
    (tmp_path / "more").mkdir()
    return tmp_path


def test_a_folder_stands_for_its_programs_sorted_and_says_what_else_is_there(parts):
    files, notes = find_programs([str(parts)])
    assert [file.label for file in files] == ["a.NC", "b.ngc", "c.tap"]
    assert [file.path for file in files] == [parts / name for name in ("a.NC", "b.ngc", "c.tap")]
    assert notes == (f"{parts}: not timed: .hidden, drawing.dxf, more{os.sep} and 2 more",)


def test_files_stand_in_the_order_they_are_named_in(parts):
    files, notes = find_programs([str(parts / name) for name in ("c.tap", "a.NC", "notes.txt", "missing.ngc")])
    assert [file.label for file in files] == ["c.tap", "a.NC", "notes.txt", "missing.ngc"]
    assert notes == ()


def test_what_is_named_twice_is_there_once(parts, monkeypatch):
    monkeypatch.chdir(parts)
    files, notes = find_programs(["b.ngc", "./b.ngc", str(parts), "more/../b.ngc"])
    assert [file.label for file in files] == ["b.ngc", "a.NC", "c.tap"]
    assert [note for note in notes if note.endswith("twice, timed once")] == [
        "b.ngc: named twice, timed once",
        f"{parts}/b.ngc: named twice, timed once",
        "more/../b.ngc: named twice, timed once",
    ]


def test_a_folder_without_a_program_is_refused(parts):
    with pytest.raises(InputError, match=r"more: has no part program, \.ngc, .*; what is there: nothing"):
        find_programs([str(parts / "more")])
    (parts / "more" / "readme.md").touch()
    with pytest.raises(InputError, match=r"what is there: readme\.md"):
        find_programs([str(parts / "more")])


def test_a_folder_with_the_name_of_a_program_is_one_where_it_is_said_so(parts):
    (parts / "d.ngc").mkdir()
    (parts / "d.ngc" / "e.ngc").write_text(MOVE)
    assert [file.label for file in find_programs([f"{parts}/d.ngc/"])[0]] == ["e.ngc"]
    assert [file.label for file in find_programs([f"{parts}/d.ngc"])[0]] == ["e.ngc"]
    _, file = find_programs([f"{parts}/a.ngc", f"{parts}/d.ngc"])[0]
    with pytest.raises(InputError, match=r"d\.ngc: a directory; name it alone"):
        file.read()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda path: path.write_text(" \n\t\n"), r"x\.ngc: is empty"),
        (lambda path: path.symlink_to("nowhere.ngc"), r"x\.ngc: a link to nowhere\.ngc, which is not there"),
        (lambda path: path.mkdir(), r"x\.ngc: a directory"),
        (os.mkfifo, r"x\.ngc: is not an ordinary file"),
        (lambda path: None, r"x\.ngc: cannot be read \(No such file"),
        (lambda path: path.symlink_to(path.name), r"x\.ngc: a link to x\.ngc, which is not there"),
    ],
    ids=["empty", "broken link", "directory", "pipe", "missing", "circle"],
)
def test_what_cannot_be_read_says_why(tmp_path, make, text):
    make(tmp_path / "x.ngc")
    (tmp_path / "part.ngc").write_text(MOVE)
    _, file = find_programs([str(tmp_path / name) for name in ("part.ngc", "x.ngc")])[0]
    with pytest.raises(InputError, match=text):
        file.read()


def test_what_may_not_be_read_says_so(tmp_path, monkeypatch):
    """As root every file may be read: the refusal is the system's."""
    (tmp_path / "x.ngc").write_text(MOVE)
    (file,) = find_programs([str(tmp_path / "x.ngc")])[0]

    def refused(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refused)
    with pytest.raises(InputError, match=r"x\.ngc: cannot be read \(Permission denied\)"):
        file.read()


def test_what_is_no_program_by_its_name_says_so(parts):
    (file,) = find_programs([str(parts / "drawing.dxf")])[0]
    with pytest.raises(InputError, match=r"drawing\.dxf: no part program by its name"):
        file.read()


class TestCalledFiles:
    """What travels with a program: what it may call, and no more."""

    @pytest.fixture
    def beside(self, tmp_path):
        (tmp_path / "main.ngc").write_text(MOVE)
        (tmp_path / "a.ngc").write_text("o<a> sub\no<b> call\no<a> endsub")
        (tmp_path / "b.ngc").write_text("o<b> sub\nG1 X1\no<b> endsub")
        (tmp_path / "100.ngc").write_text("o100 sub\nG1 X1\no100 endsub")
        (tmp_path / "c.ngc").symlink_to("nowhere")
        return find_programs([str(tmp_path / "main.ngc")])[0][0]

    @pytest.mark.parametrize(
        ("text", "names"),
        [
            (b"G1 X10 (a b c 100)", []),
            (b"o<A> CALL", ["a.ngc", "b.ngc"]),
            (b"O<b> call [1]", ["b.ngc"]),
            (b"o100 call", ["100.ngc"]),
            (b"M98 P100 L2", ["100.ngc"]),
            (b"o[#1] call", ["100.ngc", "a.ngc", "b.ngc"]),
            (b"m98 p#1", ["100.ngc", "a.ngc", "b.ngc"]),
            (b"o<c> call", []),
        ],
    )
    def test_are_those_that_may_be_called(self, beside, text, names):
        assert sorted(called_files(beside, text)) == names


class TestLabels:
    def test_are_the_shortest_ends_that_tell_files_apart(self):
        paths = ["/s/a/part.ngc", "/s/b/part.ngc", "/s/b/other.ngc", "/t/b/part.ngc"]
        assert distinct_labels(paths) == ["a/part.ngc", "s/b/part.ngc", "other.ngc", "t/b/part.ngc"]

    def test_of_a_file_whose_path_is_the_end_of_another(self):
        assert distinct_labels(["/part.ngc", "/a/part.ngc"]) == ["/part.ngc", "a/part.ngc"]

    @given(st.lists(st.lists(st.sampled_from("abc"), min_size=1, max_size=4), min_size=1, max_size=8, unique_by=tuple))
    def test_are_distinct_and_none_could_be_shorter(self, parts):
        paths = ["/" + "/".join(part) for part in parts]
        labels = distinct_labels(paths)
        assert len(set(labels)) == len(labels)
        for path, label in zip(paths, labels, strict=True):
            assert path.endswith(label)
            if "/" in label.strip("/"):
                shorter = label.strip("/").partition("/")[2]
                assert sum(other == "/" + shorter or other.endswith("/" + shorter) for other in paths) > 1

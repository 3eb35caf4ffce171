"""Files that include others."""

import re

import pytest

from planner.errors import InputError
from planner.machine.included_lines import IncludedLines

DIRECTIVE = re.compile(r"#use(.*)")


@pytest.fixture
def lines(tmp_path):
    """The lines of the file "main" among some files, as (text, name of the file, line)."""

    def lines(files, **options):
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(text)
        found = IncludedLines(DIRECTIVE, **options).of(files["main"], tmp_path / "main")
        return [(line.text, *line.place.removeprefix(f"{tmp_path}/").rsplit(":", 1)) for line in found]

    return lines


def test_lines_stand_where_they_are_included(lines):
    files = {"main": "a\n#use sub/one\nb", "sub/one": "c\n#use two\n", "sub/two": "d"}
    assert lines(files) == [("a", "main", "1"), ("c", "sub/one", "1"), ("d", "sub/two", "1"), ("b", "main", "3")]


def test_a_file_may_be_included_twice_but_not_by_itself(lines):
    assert [text for text, *_ in lines({"main": "#use one\n#use one", "one": "a"})] == ["a", "a"]
    with pytest.raises(InputError, match=r"two:3: .*one includes itself; delete this line"):
        lines({"main": "#use one", "one": "#use two", "two": "\n\n#use one"})
    with pytest.raises(InputError, match=r"main:1: .*main includes itself"):
        lines({"main": "#use main"})


def test_what_cannot_be_included_is_refused_at_its_line(lines):
    with pytest.raises(InputError, match=r"main:2: #use none: .*none: cannot be read \(No such file"):
        lines({"main": "a\n#use none"})
    with pytest.raises(InputError, match="main:1: no file is named to include"):
        lines({"main": "#use "})
    with pytest.raises(InputError, match=r"main:1: #use sub: .*sub: is not a file"):
        lines({"main": "#use sub", "sub/one": ""})


def test_files_that_include_ever_more_end(lines):
    files = {f"f{k}": f"#use f{k + 1}\n#use f{k + 1}\n" for k in range(20)} | {"f20": "a"}
    with pytest.raises(InputError, match="more than 500 files are included"):
        lines(files | {"main": "#use f0"})


def test_patterns_stand_for_several_files_or_none(lines):
    files = {"main": "#use *.part\n#use *.none", "b.part": "b", "a.part": "a"}
    assert [text for text, *_ in lines(files, patterns=True)] == ["a", "b"]
    with pytest.raises(InputError, match="cannot be read"):
        lines(files)


def test_the_folder_of_the_user(lines, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert [text for text, *_ in lines({"main": "#use ~/one", "one": "a"})] == ["a"]

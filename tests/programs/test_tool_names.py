"""What the tools are called, by the tool table and by the comments of posts."""

from __future__ import annotations

import pytest

from planner.programs.program_text import ProgramText
from planner.programs.reading.reader import read_program
from planner.programs.reading.setup import read_tool_table
from planner.programs.tool_names import tool_names


def named(folder, text, table=None):
    file = folder / "part.ngc"
    file.write_text(text)
    return tool_names(read_program(file), ProgramText.read(file), table)


@pytest.mark.parametrize(
    ("head", "change", "name"),
    [
        ("(T1 D=6. CR=0. - ZMIN=-5. - flat end mill)", "T1 M6", "D=6. CR=0. - ZMIN=-5. - flat end mill"),
        ("(T1: 6mm Endmill)", "M6 T1", "6mm Endmill"),
        ("( T1 : 3.0 )", "T1 M6", "3.0"),
        ("(1=End Mill {6 mm})", "T1M06", "End Mill {6 mm}"),
        ("(TOOL 1 - BALL)", "T1 M6", "BALL"),
        ("(a part)", "T1 M6 (6 mm, two flutes)", "6 mm, two flutes"),
        ("(a part)", "T1 M6 ; 6 mm", "6 mm"),
        ("(a part)", "T1 M6\n(Tool: End Mill)", "End Mill"),
        ("(a part)", "(Tool Name: End Mill)\nT1 M6", "End Mill"),
    ],
)
def test_comments(tmp_path, head, change, name):
    assert named(tmp_path, f"{head}\nG21 G90\n{change}\nG0 X5\nG1 X9 F900\nM2\n") == {1: name}


def test_nobody_names_it(tmp_path):
    assert named(tmp_path, "(a part)\nG21 G90\nT1 M6\nG0 X5\nG1 X9 F900\nM2\n") == {}


def test_the_tool_table_comes_first(tmp_path):
    table = tmp_path / "tool.tbl"
    table.write_text("T1 P1 Z40.2 D6 ;6 mm end mill\nT2 P2 Z30\nT3 P3 ; drill \n")
    tools = read_tool_table(table)
    assert [tools[k].name for k in (1, 2, 3)] == ["6 mm end mill", "", "drill"]
    text = "(T1: what the post says)\n(T2: chamfer)\nG21 G90\nT1 M6\nG0 X5\nG1 X9 F900\nM2\n"
    assert named(tmp_path, text, tools) == {1: "6 mm end mill", 2: "chamfer", 3: "drill"}

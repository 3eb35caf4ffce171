"""Operations and tools of a part program: the comments of every post are found, and nothing is lost between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.machine.program_setup import RestTimes
from planner.programs.operations import operation_sections, tool_number, tool_sections
from planner.programs.program_text import ProgramText
from planner.programs.reading.program import RAPID
from planner.programs.reading.reader import read_program
from planner.programs.schedule import Schedule
from planner.programs.tool_names import tool_names

RESTS = RestTimes(tool_change=10.0, spindle_start=3.0)

# In the styles of the posts, each with a rapid approach, two cuts an operation, and what stands around them.
FUSION = """\
%
(1001)
(Machine)
(  vendor: Somebody)
(T1 D=6. CR=0. - ZMIN=-5. - flat end mill)
(T2 D=3. CR=0. - ZMIN=-8. - drill)
N10 G90 G94 G17 G91.1
N15 G21
N20 G53 G0 Z0.

(2D Adaptive1)
N25 T1 M6
(a comment on the tool)
N30 S15000 M3
N35 G54
N40 M8
N45 G0 X30. Y12.
N60 G1 Z-1. F300.
N65 X40. F1000.
N70 G0 Z15.

(Bore1)
N75 M9
N80 G53 G0 Z0.
N85 T2 M6
N90 S5000 M3
N95 G0 X5. Y5.
N97 G1 Z-8. F100.
N98 G0 Z15.
N110 M9
N130 M30
%
"""
FUSION_FREE = """\
(1002)
G90 G94 G17
G21
(Facing)
T1 M6
S15000 M3
G54
G1 X30. Y12. F1000.
G1 X40.
G1 Z15.
(Contour)
S9000 M3
G1 X0. Y0. F1000.
X-20.
M30
"""
FREECAD = """\
(Exported by FreeCAD)
(Post Processor: linuxcnc_post)
(begin preamble)
G17 G54 G40 G49 G80 G90
G21
(begin operation: Fixture)
(machine units: mm/min)
G54
(finish operation: Fixture)
(begin operation: T3: 6mm Endmill)
(T3: 6mm Endmill)
M5
M6 T3
M3 S12000
(finish operation: T3: 6mm Endmill)
(begin operation: Profile)
(machine units: mm/min)
(Compensated Tool Path: 3.0)
G0 Z15
G0 X-3 Y0
G1 Z-2 F300
G1 Y40 F1200
G0 Z15
(finish operation: Profile)
(begin operation: Drilling)
G0 X10 Y10
G81 Z-8 R2 F120
G80
(finish operation: Drilling)
(begin postamble)
G0 Z30
M5
M2
"""
ESTLCAM = """\
(Project plate)
(Machining time about 00:00:07 hours)

(Required tools:)
(End mill 3mm)
G21
G90
G94
M03 S24000
G00 Z5.0000


(No. 1: Engraving 1)
G00 X0 Y25
G01 Z-1 F600
G01 Y0 F1200
G00 Z5
(Nr. 2 Ausschnitt: Deckel)
G00 X10 Y0
G01 Z-2 F600
G01 X20 F1200
G00 Z5

M05
M30
"""
VCARVE = """\
( Slots )
( File created: Monday)
( X= 100, Y= 100, Z= 18)
()
(Toolpaths used in this file:)
(Pocket 1)
(V-Carve 1)
(Tools used in this file: )
(1=End Mill {6 mm})
(2=V-Bit {90 deg 10 mm})
N100G00G21G17G90G40G49G80
N110G91.1
N120T1M06
N130 (End Mill {6 mm})
N150S12000M03
N160(Toolpath:- Pocket 1)
N170()
N180G94
N190G00X0Y0Z20
N200G1Z-2F300
N210G1X30F900
N220G00Z20
N230T2M06
N240S12000M03
N250(Toolpath:- V-Carve 1)
N260()
N270G00X0Y9Z20
N280G1Z-1F300
N290G1X30F900
N300G00Z20
N310M30
"""
CAMBAM = """\
( Made using a CAM program )
( STAR 10/28/2011 1:45:33 PM )
( T1 : 3.0 )
G21 G90 G64 G40
G0 Z3
( T1 : 3.0 )
T1 M6
( Profile1 )
G17
M3 S1000
G0 X5 Y5
G1 F300 Z-1
G1 F800 X20
G0 Z3
( Pocket2 )
G0 X0 Y0
G1 F300 Z-2
G1 F800 X-20
G0 Z3
M5
M30
"""
PLASMA = "G21 G90\n(----- Toolpath Outside -----)\nG0 X5\nG1 X9 F900\n(----- Toolpath Inside -----)\nG0 X1\nG1 X2\nM2\n"
SHEETCAM = "G21 G90\n(Operation: Outside Offset, 0, T1: 3 mm)\nG0 X5\nG1 X9 F900\n(OP 20 - Inside)\nG0 X1\nG1 X2\nM2\n"
SEMICOLONS = "G21 G90\n; roughing\nG0 X5\nG1 X9 F900\n;finishing\nG0 X1\nG1 X2\nM2\n"
FOUND = {
    "fusion": (FUSION, ["", "2D Adaptive1", "Bore1"], [None, 1, 2]),
    "fusion without rapids": (FUSION_FREE, ["Facing", "Contour"], [1, 1]),
    "freecad": (FREECAD, ["Profile", "Drilling"], [3, 3]),
    "estlcam": (ESTLCAM, ["", "No. 1: Engraving 1", "Nr. 2 Ausschnitt: Deckel"], [None] * 3),
    "vcarve": (VCARVE, ["Pocket 1", "V-Carve 1"], [1, 2]),
    "cambam": (CAMBAM, ["Profile1", "Pocket2"], [1, 1]),
    "plasma": (PLASMA, ["Outside", "Inside"], [None, None]),
    "sheetcam": (SHEETCAM, ["Outside Offset, 0, T1: 3 mm", "Inside"], [None, None]),
    "semicolons": (SEMICOLONS, ["roughing", "finishing"], [None, None]),
}


def divided(folder, text, seconds=None, table=None):
    """Program, run, tools and operations; every move takes as many seconds as it is mm long where none are given."""
    file = folder / "part.ngc"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    program = read_program(file)
    moving = program.lengths[program.lengths > 0.0]
    run = Schedule.of(program, moving if seconds is None else seconds, RESTS)
    written = ProgramText.read(file)
    tools = tool_sections(program, run, tool_names(program, written, table))
    return program, run, tools, operation_sections(program, run, written, tools)


def times(program, run, sections, held=None):
    return sections.times(program, run, held or {})


@pytest.mark.parametrize("post", FOUND)
def test_the_operations_of_every_post(tmp_path, post):
    text, names, tools = FOUND[post]
    program, run, _, found = divided(tmp_path, text)
    parts = [part for part in times(program, run, found) if part.name or part.total_s]
    assert [part.name for part in parts if part.name] == [name for name in names if name]
    assert [part.tool for part in parts if part.name] == [t for name, t in zip(names, tools, strict=True) if name]
    assert math.fsum(part.total_s for part in parts) == pytest.approx(run.total, rel=1e-12)
    lines = text.splitlines()
    for part in parts:
        assert not part.name or part.name in lines[part.line - 1]


@pytest.mark.parametrize("ends", ["\r\n", "\n"])
@pytest.mark.parametrize("post", FOUND)
def test_line_ends_do_not_matter(tmp_path, post, ends):
    text, names, _ = FOUND[post]
    found = divided(tmp_path, text.replace("\n", ends))[3]
    assert [name for name in found.names if name] == [name for name in names if name]


def test_by_hand(tmp_path):
    """FreeCAD: the change of the tool and the start of the spindle count to the operation that follows."""
    program, run, tools, found = divided(tmp_path, FREECAD)
    profile, drilling = times(program, run, found)
    line = program.line[run.row]
    first = (line >= 16) & (line <= 25)
    assert profile.motion_s == pytest.approx(run.seconds[first].sum())
    assert drilling.motion_s == pytest.approx(run.seconds[~first].sum())
    assert (profile.change_s, profile.spindle_s, profile.tool_changes) == (10.0, 3.0, 1)
    assert (drilling.change_s, drilling.spindle_s, drilling.tool_changes) == (0.0, 0.0, 0)
    assert profile.rapid_s == pytest.approx(run.seconds[first & (program.kind[run.row] == RAPID)].sum())
    assert drilling.start_s == pytest.approx(profile.total_s)
    assert drilling.length_mm == pytest.approx(program.lengths[run.row][~first].sum())
    assert times(program, run, tools)[-1].name == "6mm Endmill"


def test_a_program_without_such_comments_is_one_operation_a_tool(tmp_path):
    text = "(a bracket)\nG21 G90\nT1 M6\nG0 X5\nG1 X9 F900\nT7 M6\nG1 X0\nT1 M6 (mill)\nG1 X4\nM2\n"
    program, run, tools, found = divided(tmp_path, text)
    assert found is None
    assert [(part.tool, part.name, part.tool_changes) for part in times(program, run, tools)] == [
        (1, "mill", 2),
        (7, "", 1),
    ]


def test_what_no_cut_follows_is_no_operation(tmp_path):
    text = "(first)\nG0 X5\nG1 X9 F900\n(second)\nG0 X0\nG1 X3\n(go home)\nG0 X0\nM2\n"
    assert divided(tmp_path, text)[3].names == ("first", "second")


def test_remarks_between_cuts_are_none(tmp_path):
    text = "(rough)\nG0 X5\nG1 X9 F900\n(second pass)\nG1 X5\n(fine)\nG0 X0\nG1 X3\nM2\n"
    assert divided(tmp_path, text)[3].names == ("rough", "fine")


@pytest.mark.parametrize(
    "said", ["(MSG, change the stock)", "()", "(----------)", "(T4: drill)", "(3 = Bit)", "(12:30)"]
)
def test_messages_lists_and_lines_of_dashes_are_none(tmp_path, said):
    text = f"(rough)\nG0 X5\nG1 X9 F900\n{said}\nG0 X0\nG1 X3\n(fine)\nG0 X0\nG1 X3\nM2\n"
    assert divided(tmp_path, text)[3].names == ("rough", "fine")


class TestSubprograms:
    TEXT = (
        "o100 sub\n(inside)\nG0 X0 Y0\nG1 X10 F600\no100 endsub\nG21 G90\n"
        "(first)\nG0 Y5\nG1 X3 F600\no100 call\n(second)\nG0 Y9\nG1 X0\no100 call\nG1 X5\nM2\n"
    )

    def test_they_count_to_their_call(self, tmp_path):
        program, run, _, found = divided(tmp_path, self.TEXT)
        assert found.names == ("first", "second")
        line = program.line[run.row].tolist()
        middle = line.index(12)
        assert found.of_move.tolist() == [0] * middle + [1] * (len(line) - middle)
        assert line[:middle].count(4) == line[middle:].count(4) == 1

    def test_those_of_m98(self, tmp_path):
        main = "G21 G90\n(first)\nG0 Y5\nG1 X3 F600\nM98 P100\n(second)\nG0 Y9\nG1 X0\nM98 P100\nM30\n"
        text = f"{main}O100\n(inside)\nG1 X7\nM99\n"
        program, run, _, found = divided(tmp_path, text)
        assert found.names == ("first", "second")
        of_inner = found.of_move[program.line[run.row] == 13]
        assert of_inner.tolist() == [0, 1]


def test_a_loop_in_the_program_itself_counts_where_it_stands(tmp_path):
    text = (
        "G21 G90\n(a)\nG0 Y5\n#1=3\no1 while [#1 GT 0]\nG1 X[#1] F600\n#1=[#1-1]\no1 endwhile\n(b)\nG0 Y9\nG1 X0\nM2\n"
    )
    program, run, _, found = divided(tmp_path, text)
    assert found.names == ("a", "b")
    assert found.of_move.tolist() == [0 if line < 9 else 1 for line in program.line[run.row]]


def test_dwells_count_where_they_stand(tmp_path):
    text = "(a)\nG0 X5\nG1 X9 F900\nG4 P2\n(b)\nG4 P0.5\nG0 X0\nG1 X3\nG4 P4\nM2\n"
    program, run, _, found = divided(tmp_path, text)
    assert [part.dwell_s for part in times(program, run, found)] == [2.0, 4.5]


def test_shares_are_those_of_the_motion(tmp_path):
    program, run, _, found = divided(tmp_path, SEMICOLONS)
    motion = np.bincount(found.of_move, run.seconds)
    parts = times(program, run, found, {"feed": 0.25 * motion, "jerk X": 0.75 * motion, "none": 0.0 * motion})
    assert all(part.shares == pytest.approx({"jerk X": 0.75, "feed": 0.25}) for part in parts)
    assert all(list(part.shares) == ["jerk X", "feed"] for part in parts)


@given(
    st.lists(
        st.sampled_from(["(op {})", "T{} M6", "M3 S9000", "G4 P0.5", "M5", "G0 X{}", "G1 X{} F900", "X{}"]), max_size=25
    )
)
def test_nothing_is_lost_and_nothing_counts_twice(tmp_path_factory, words):
    lines = [word.format(k + 1) for k, word in enumerate(words)]
    text = "G21 G90 G1 F900\nX500\n" + "\n".join(lines) + "\nM2\n"
    program, run, tools, found = divided(tmp_path_factory.getbasetemp(), text)
    for sections in (tools, found):
        if sections is None:
            continue
        parts = times(program, run, sections)
        assert math.fsum(part.total_s for part in parts) == pytest.approx(run.total, rel=1e-12)
        assert sum(part.tool_changes for part in parts) == sum("M6" in line for line in lines)
        assert math.fsum(part.length_mm for part in parts) == pytest.approx(program.lengths.sum())
        assert len(set(sections.lines)) == len(sections.lines)


def test_number_of_a_tool():
    assert [tool_number(text) for text in ("M6 T12", "M6", "M6 T03", "m6 t 4")] == [12, None, 3, 4]

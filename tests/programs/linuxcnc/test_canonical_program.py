"""Programs as an installed LinuxCNC reads them; what it does not tell is taken from the lines that it ran."""

import shutil
import subprocess

import numpy as np
import pytest

from planner import InputError, load_curve, read_program
from planner.programs.linuxcnc import interpreter
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.linuxcnc.interpreter import canonical_calls, is_installed
from planner.programs.linuxcnc.line_events import _blend
from planner.programs.linuxcnc.marks import bare, write_marked
from planner.programs.reading.setup import Tool
from planner.programs.source import program_of

needs_linuxcnc = pytest.mark.skipif(
    not is_installed(), reason="LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)"
)


def written(folder, text, name="part.ngc"):
    path = folder / name
    path.write_text(text)
    return path


class TestMarks:
    """The copy that tells which line is run."""

    def test_every_line_has_its_mark_and_its_number(self, tmp_path):
        (tmp_path / "copy").mkdir()
        path = written(tmp_path, "\n%\nG21 (mm)\n\nG1 X1 F100 ; there\nM2\n%\n")
        marked = write_marked(path, tmp_path / "copy")
        lines = (tmp_path / "copy" / "feedplan_part.ngc").read_text().split("\n")
        said = [f"(feedplan-mark 0 {k} {named})" for k, named in ((3, "."), (5, "X"), (6, "."), (7, "."))]
        assert lines == [
            "",
            "%",
            said[0],
            "G21 (mm)",
            "",
            said[1],
            "G1 X1 F100 ; there",
            said[2],
            "M2",
            said[3],
            "%",
            "",
        ]
        assert [marked.numbers[k] for k in range(1, len(lines) + 1)] == [1, 2, 3, 3, 4, 5, 5, 6, 6, 7, 7, 8]
        assert marked.lines[0][2] == "G21"
        assert marked.line_count == 7

    def test_files_that_are_called_are_copied_and_no_others(self, tmp_path):
        (tmp_path / "copy").mkdir()
        text = "O<inner> sub\nO<inner> endsub\nO<inner> call\nO<Outer> call [1]\nM98 P7\n#1=2 O<x> (call)\nM2\n"
        path = written(tmp_path, text)
        written(tmp_path, "O<outer> sub\nO<third> call\nO<outer> endsub\nM2\n", "outer.ngc")
        written(tmp_path, "O<third> sub\nT12 M6\nO<third> endsub\nM2\n", "third.ngc")
        written(tmp_path, "O7\nG43 H5\nM99\n", "7.ngc")
        written(tmp_path, "M2\n", "inner.ngc")
        marked = write_marked(path, tmp_path / "copy")
        assert marked.names == ("part.ngc", "7.ngc", "outer.ngc", "third.ngc")
        assert marked.tools == (5, 12)
        assert "(feedplan-mark 3 2 .)\nT12 M6" in (tmp_path / "copy" / "third.ngc").read_text()

    def test_a_bare_line(self):
        assert bare("n10 g1 (to X5) x 1.5 ; y2") == "N10G1X1.5"


def test_where_linuxcnc_is_missing_the_message_says_what_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(interpreter, "python_of_linuxcnc", lambda: None)
    path = written(tmp_path, "G1 X1 F100\nM2\n")
    message = (
        "part.ngc: LinuxCNC is not installed: its module gcode is neither in /usr/bin/python3 nor in the python3 of PATH; "
        "on Debian and Ubuntu: apt-get install --no-install-recommends linuxcnc-uspace"
    )
    with pytest.raises(InputError) as problem:
        program_of(path, "rs274")
    assert str(problem.value) == message


def test_who_reads_must_be_known_and_fit_the_source(tmp_path):
    path = written(tmp_path, "G1 X1 F100\nM2\n")
    with pytest.raises(InputError, match=r"reader = 'grbl' must be one of feedplan, rs274"):
        program_of(path, "grbl")
    with pytest.raises(InputError, match=r"reader = 'rs274' is for part programs; teardrop is none"):
        load_curve("teardrop", reader="rs274")
    with pytest.raises(InputError, match=r"ignore = \['M123'\]: LinuxCNC passes over no words"):
        program_of(path, "rs274", ignore=["M123"])


class TestWordsOfLines:
    """P and Q of G64 are not in the calls."""

    def test_of_a_number_that_is_computed_nothing_is_known(self, tmp_path):
        (tmp_path / "copy").mkdir()
        marked = write_marked(written(tmp_path, "M2\n"), tmp_path / "copy")
        calls = interpreter.CanonicalCalls(np.empty((0, 16)), marked)
        with pytest.raises(
            InputError, match=r"part.ngc:3: G64: LinuxCNC does not tell its tolerance P; write a number"
        ):
            _blend(calls, 3, [("G", "64"), ("P", "[1/100]")], 1.0)
        assert _blend(calls, 3, [("G", "64"), ("P", "0.001"), ("Q", "0")], 25.4) == [0.0254, 0.0]


@needs_linuxcnc
class TestMoves:
    """Moves in mm and mm/s, on the machine, with their lines."""

    def test_lines_arcs_and_offsets(self, tmp_path):
        text = "G20\nG10 L2 P2 X1\nG55\nG0 X0 Y0\nG1 X1 F60\nG3 X2 Y1 I0 J1\nG18 G2 X3 Z0 I0.5 K0\nG92 X0\nG1 X1\nM2\n"
        program = read_with_linuxcnc(written(tmp_path, text))
        assert program.line.tolist() == [5, 6, 7, 9]
        assert program.start[0].tolist() == pytest.approx([25.4, *[0.0] * 8])
        assert program.end[:, 0] == pytest.approx([50.8, 76.2, 101.6, 127.0])
        assert program.sweep == pytest.approx([0.0, np.pi / 2, -np.pi, 0.0])
        assert program.centre[1] == pytest.approx([50.8, 25.4, 0.0])
        assert program.normal[1:3].tolist() == [2, 1]
        assert program.feed == pytest.approx(np.full(4, 25.4))
        assert program.axis_lines.tolist() == [4, 6, *[0] * 7]

    @pytest.mark.parametrize(
        ("text", "feed"),
        [
            ("G94 F120\nG1 X10\n", 2.0),
            ("G93\nG1 X10 F6\n", 1.0),
            ("M3 S300\nG95 F0.2\nG1 X10\n", 1.0),
            ("G20 G95\nM3 S120\nG1 X1 F0.01\n", 0.508),
            ("M3 S60\nG33 X10 K1.5\n", 1.5),
            ("F360\nG1 A90\n", 6.0),
            ("G20\nF60\nG1 A90\n", 1.0),
            ("G93\nG1 A90 F2\n", 3.0),
            ("G93\nG1 X3 A90 F2\n", 0.1),
            ("G20\nF60\nG1 U1 A90\n", 25.4),
        ],
    )
    def test_feeds(self, tmp_path, text, feed):
        program = read_with_linuxcnc(written(tmp_path, text + "M2\n"))
        assert program.feed.tolist() == pytest.approx([feed])

    def test_turns_and_helices(self, tmp_path):
        program = read_with_linuxcnc(written(tmp_path, "F600\nG2 X0 Y0 Z-3 I5 P3\nG3 X10 I5\nM2\n"))
        assert program.sweep == pytest.approx([-6.0 * np.pi, np.pi])
        assert program.end[0, :3].tolist() == pytest.approx([0.0, 0.0, -3.0])

    def test_the_modal_feed_of_rapids(self, tmp_path):
        path = written(
            tmp_path, "G91\nG0 X1\nF600 X1\nG1 X1 F300\nG0 X1\nG20 X1\nG21\nF120 X1\nG93 G1 X1 F2\nG0 X1\nM2\n"
        )
        theirs, ours = read_with_linuxcnc(path, from_zero=True), read_program(path, start=(0, 0, 0))
        assert theirs.modal_feed == pytest.approx([np.nan, 10, 5, 5, 5, 2, 1 / 30, np.nan], nan_ok=True)
        assert ours.modal_feed == pytest.approx(theirs.modal_feed, nan_ok=True)

    def test_path_modes_and_tolerances(self, tmp_path):
        text = "F600\nG1 X1\nG64 P0.02\nX2\nG61\nX3\nG64 P0\nX4\nG20\nG64 P0.001 Q0.0001\nX5\nM2\n"
        program = read_with_linuxcnc(written(tmp_path, text))
        assert program.tolerance == pytest.approx([np.nan, 0.02, 0.0, np.nan, 0.0254], nan_ok=True)
        assert program.naive_tolerance == pytest.approx([np.nan] * 4 + [0.00254], nan_ok=True)
        assert program.stop_after.tolist() == [False, False, False, False, True]

    def test_what_happens_between_the_moves_is_that_of_our_reader(self, tmp_path):
        text = "M6 T3\nM3 S500 M8\nG1 X1 F100\nG4 P0.5\nM0\nG82 X2 Z-1 R1 P0.25\nG80\nT4\nM5\nG0 X3 M1\nM2\n"
        path = written(tmp_path, text)
        theirs, ours = read_with_linuxcnc(path, from_zero=True), read_program(path, start=(0, 0, 0))
        kinds = [(event.line, event.kind, event.seconds, event.after_move) for event in theirs.events]
        assert kinds == [(event.line, event.kind, event.seconds, event.after_move) for event in ours.events]
        assert len(kinds) == 10

    def test_a_called_file_counts_for_the_line_of_its_call(self, tmp_path):
        written(tmp_path, "O<hole> sub\nG1 Z-#1\nM3 S100\nG0 Z1\nO<hole> endsub\nM2\n", "hole.ngc")
        text = "F100\nG0 X0\nO<inner> sub\nG1 X[#1]\nO<inner> endsub\nO<inner> call [5]\nO<hole> call [2]\nG0 X9\nM2\n"
        program = read_with_linuxcnc(written(tmp_path, text))
        assert program.line.tolist() == [4, 7, 7, 8]
        assert [event.line for event in program.events] == [7, 9]

    def test_tools(self, tmp_path):
        path = written(tmp_path, "T3 M6\nG43\nG1 Z0 F100\nT12 M6\nG43 H12\nG1 X0 Z0\nM2\n")
        program = read_with_linuxcnc(path, tools={3: Tool((0.0, 0.0, 40.0), 6.0), 12: Tool((1.0, 0.0, 7.5))})
        assert program.end[:, :3] == pytest.approx(np.array([[0.0, 0.0, 40.0], [1.0, 0.0, 7.5]]))
        without = read_with_linuxcnc(path)
        assert len(without) == 0
        assert "the length of tool 12" in without.notes[0]

    def test_where_the_first_rapid_leads_the_machine_stood_before(self, tmp_path):
        path = written(tmp_path, "G0 X10 Y5\nZ3\nG1 X20 F100\nG91 G0 Y1\nM2\n")
        assert read_with_linuxcnc(path).start[0, :3].tolist() == [10.0, 5.0, 3.0]
        theirs = read_with_linuxcnc(path, from_zero=True)
        assert not theirs.start[0].any()
        assert len(theirs) == 4

    def test_splines_are_chords(self, tmp_path):
        path = written(tmp_path, "F100\nG5 X10 Y10 I3 J0 P-3 Q0\nM2\n")
        program = read_with_linuxcnc(path)
        assert len(program) == 60
        assert program.end[-1, :3].tolist() == pytest.approx([10.0, 10.0, 0.0])
        assert program.notes[-1] == "read by LinuxCNC's interpreter: splines are its chords"
        assert load_curve(path, reader="rs274").length == pytest.approx(program.lengths.sum(), rel=1e-3)


@needs_linuxcnc
class TestRefusals:
    """With LinuxCNC's message and the line."""

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (
                "G1 X1 F100\nG0 X2\n\nG2 X5\nM2\n",
                "part.ngc:4: G2X5: LinuxCNC refuses it: R i j k words all missing for arc",
            ),
            ("F100\nG1 Y1\nG1 X[1/0]\nM2\n", "part.ngc:3: G1X[1/0]: LinuxCNC refuses it: Attempt to divide by zero"),
            (
                "O<no> call\nM2\n",
                "part.ngc:1: O<NO>CALL: LinuxCNC refuses it: EOF in file:part.ngc seeking o-word: o<no> from line: 1",
            ),
            (
                "G1 X1 F100\n",
                "part.ngc:1: G1X1F100: LinuxCNC refuses it: File ended with no percent sign or program end",
            ),
            ("", "part.ngc:1: end of file: LinuxCNC refuses it: File ended with no percent sign or program end"),
            (
                "G1 X1 F0.1.1\nM2\n",
                "part.ngc:1: G1X1F0.1.1: LinuxCNC refuses it: bad number format (trailing characters) parsing '0.1.1'",
            ),
        ],
    )
    def test_the_line_is_that_of_the_file(self, tmp_path, text, message):
        with pytest.raises(InputError) as problem:
            read_with_linuxcnc(written(tmp_path, text))
        assert str(problem.value).startswith(message)

    def test_an_error_in_a_called_file_names_that(self, tmp_path):
        written(tmp_path, "O<bad> sub\nG1 X1\nG2 X4\nO<bad> endsub\nM2\n", "bad.ngc")
        with pytest.raises(InputError, match=r"^bad.ngc:3: G2X4: LinuxCNC refuses it"):
            read_with_linuxcnc(written(tmp_path, "F100\nO<bad> call\nM2\n"))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("F60\nG10 L1 P1 Z5\nG1 X2\nT1 M6\nM2\n", "part.ngc:2: G10L1P1Z5: a tool is changed afterwards"),
            ("F60\nG43.1 Z3\nG1 X1\nG20\nF2\nG49\nM2\n", "part.ngc:6: G49: the tool length was taken in other units"),
            ("F60\nG2 X2 I1\nT1 M6\nG28\nM2\n", "part.ngc:4: G28: the tool change before comes after an arc"),
        ],
    )
    def test_what_the_interpreter_would_have_to_ask_a_machine(self, tmp_path, text, message):
        with pytest.raises(InputError) as problem:
            read_with_linuxcnc(written(tmp_path, text))
        assert str(problem.value).startswith(message)

    @pytest.mark.parametrize(
        ("text", "end"),
        [
            ("G2 X2 I1\nT1 M6\nG1 Z1\n", (2.0, 0.0, 1.0)),
            ("G2 X2 I1\nT1 M6\nG1 X0\n", (0.0, 0.0, 0.0)),
            ("G2 X2 I1\nT1 M6\nG91 G1 X3\nG90 G1 Y1\n", (5.0, 1.0, 0.0)),
            ("G2 X2 I1\nT1 M6\nG91\nG2 X4 I2\nG1 X1 Z1\n", (7.0, 0.0, 1.0)),
            ("G2 X2 I1\nG92 Z5\nT1 M6\nG1 X3 Y3\n", (3.0, 3.0, 0.0)),
            ("G43.1 Z3\nT1 M6\nG1 X3\nZ[1+1]\n", (3.0, 0.0, 5.0)),
            ("G43.1 Z3\nG1 Z0\nG49 T1 M6\nG1 X3\n", (3.0, 0.0, 3.0)),
        ],
    )
    def test_where_the_machine_is_at_a_tool_change_is_kept(self, tmp_path, text, end):
        """LinuxCNC's interpreter asks the machine for it; here there is none, and it forgets arcs and changed offsets."""
        program = read_with_linuxcnc(written(tmp_path, f"F60\n{text}M2\n"), from_zero=True)
        assert program.end[-1, :3].tolist() == pytest.approx(end)
        assert read_program(tmp_path / "part.ngc", start=(0, 0, 0)).end[-1, :3].tolist() == pytest.approx(end)

    def test_a_loop_that_never_ends_is_ended(self, tmp_path):
        path = written(tmp_path, "O1 while [1]\n#1=2\nO1 endwhile\nM2\n")
        with pytest.raises(
            InputError, match=r"part.ngc:1: end of steps: LinuxCNC's interpreter does not end within 3 s"
        ):
            canonical_calls(path, timeout=3.0)

    def test_the_tool_table_of_the_machine_is_left_alone(self, tmp_path, monkeypatch):
        """LinuxCNC keeps the table of the machine that runs in a file in HOME."""
        monkeypatch.setenv("HOME", str(tmp_path))
        live = tmp_path / ".tool.mmap"
        live.write_bytes(b"in use")
        read_with_linuxcnc(written(tmp_path, "T1 M6\nG1 X1 F100\nM2\n"))
        assert live.read_bytes() == b"in use"


@needs_linuxcnc
@pytest.mark.skipif(shutil.which("rs274") is None, reason="LinuxCNC's interpreter rs274 is not installed")
def test_the_moves_are_those_that_rs274_prints(tmp_path):
    """Another way into the same interpreter: its stand-alone form, four decimals."""
    text = "F100\nG1 X1.5 Y2\nG91 G0 Z4\nG90 G81 X3 Y3 Z-2 R1\nX5\nG80\nM2\n"
    path = written(tmp_path, text)
    for name in ("tool.tbl", "numbers.var"):
        (tmp_path / name).touch()
    command = ["rs274", "-g", "-n", "2", "-t", "tool.tbl", "-v", "numbers.var", "part.ngc"]
    run = subprocess.run(
        command, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=True,
        env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    printed = [
        [float(value) for value in line.split("(")[1].rstrip(")\n").split(",")[:3]]
        for line in run.stdout.splitlines()
        if "STRAIGHT_" in line
    ]
    moved = [end for before, end in zip([[0.0] * 3, *printed], printed, strict=False) if end != before]
    assert read_with_linuxcnc(path, from_zero=True).end[:, :3] == pytest.approx(np.array(moved))
    assert len(moved) == 9

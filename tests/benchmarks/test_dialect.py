"""The reader of part programs against LinuxCNC's own interpreter, where it is installed."""

import dataclasses

import numpy as np
import pytest
from cases import PROJECT

from benchmarks.dialect import AIM, SAMPLES, TOOLS, Agreement, compare, compare_random, difference, programs_in, summary
from benchmarks.random_programs import random_program
from planner import read_program
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.linuxcnc.interpreter import is_installed

needs_linuxcnc = pytest.mark.skipif(
    not is_installed(), reason="LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)"
)
CHUNK = 100


@needs_linuxcnc
@pytest.mark.slow
class TestSamples:
    """The programs that the package installs: nobody wrote them for this reader."""

    @pytest.fixture(scope="class")
    def found(self):
        return [compare(path, TOOLS) for path in programs_in([SAMPLES])]

    def test_nearly_all_that_it_reads_are_read(self, found):
        facts = summary(found)
        assert facts["read_by_linuxcnc"] > 100
        assert facts["share_read"] >= AIM

    def test_what_is_read_has_the_same_moves(self, found):
        assert [(one.program, one.difference) for one in found if one.difference] == []
        assert summary(found)["moves_compared"] > 10_000


def disagreements(seeds, folder):
    found = compare_random(seeds, folder)
    return [one for one in found if not one.same], summary(found)


@needs_linuxcnc
class TestRandomPrograms:
    def test_a_few(self, tmp_path):
        wrong, facts = disagreements(range(20), tmp_path)
        assert wrong == []
        assert facts["read_here"] >= 10

    @pytest.mark.slow
    @pytest.mark.parametrize("first", range(0, 3000, CHUNK))
    def test_agree_on_what_is_refused_and_on_every_move(self, tmp_path, first):
        wrong, facts = disagreements(range(first, first + CHUNK), tmp_path)
        assert wrong == []
        assert facts["read_here"] >= CHUNK // 2
        assert facts["refused_by_both"] >= CHUNK // 10
        assert facts["moves_compared"] >= 10 * CHUNK


DIFFERENT = {
    # What a line of the table in docs/format-program.md begins with: a program of it.
    "a parameter that is not set": "F60\nG1 X#33\nM2\n",
    "`M99` outside a subroutine": "F60\nG1 X5\nM99\n",
    "words that two words of a block could take": "F60\nG0 Z5\nG82 X1 Z-1 R1 P1 G4\nM2\n",
    "a number of G10 that is not whole": "G10 L2 P1.6 X3\nG0 X1\nM2\n",
    "`G38.2` to where the tool is": "F60\nG1 X5\nG38.2 X5\nM2\n",
    "lines that begin with $ or ?": "$H\nG0 X1\nM2\n",
    "a peck that ends at the bottom": "G20\nF9\nG0 Z1\nG83 X1 Z-0.171 R0.111 Q0.047\nG80\nM2\n",
    "tapping, G74 and G84, in G18 and G19": "F600 M4 S100\nG18\nG0 Y20\nG74 X1 Y2 Z3 R9\nG80\nM2\n",
    "a do loop after a break out of a while loop": (
        "F60\n#1=0\nO1 while [#1 LT 3]\n#1=[#1+1]\nO2 if [#1 EQ 2]\nO1 break\nO2 endif\nO1 endwhile\n"
        "#1=0\nG91\nO3 do\nG1 X1\n#1=[#1+1]\nO3 while [#1 LT 3]\nM2\n"
    ),
    "F that M72 brings back": "F12.34\nM70\nF600\nM72\nG1 X1\nM2\n",
    "a block slower than 0.1 units a minute under G93": "G93\nG1 X0.01 F1\nM2\n",
    "F0 under G93": "G93\nG1 X1 F0\nM2\n",
    "a short move on a huge radius": "F600\nG2 X0.001 R2000\nG1 X5\nM2\n",
    "G93 on an arc whose radii differ": "G93\nG2 X2.02 I1 F3\nM2\n",
}


class TestDifferences:
    """The table of the page is true."""

    def test_the_page_has_these_and_no_others(self):
        page = (PROJECT / "docs" / "format-program.md").read_text()
        rows = page.split("<!-- differences -->")[1].split("\n\n")[0].strip().splitlines()[2:]
        said = [row.removeprefix("| ").split(" |")[0] for row in rows]
        assert len(said) == len(DIFFERENT)
        assert [name for name, row in zip(DIFFERENT, said, strict=True) if not row.startswith(name)] == []

    @needs_linuxcnc
    @pytest.mark.parametrize("name", DIFFERENT)
    def test_the_two_differ(self, tmp_path, name):
        path = tmp_path / "part.ngc"
        path.write_text(DIFFERENT[name])
        found = compare(path, TOOLS)
        if "slower than" in name:  # so does this
            theirs, ours = read_with_linuxcnc(path, from_zero=True), read_program(path, start=(0, 0, 0))
            assert [theirs.feed[0], ours.feed[0]] == pytest.approx([0.1 / 60, 0.01 / 60])
        elif "on an arc" in name:  # which the comparison allows for
            theirs, ours = read_with_linuxcnc(path, from_zero=True), read_program(path, start=(0, 0, 0))
            assert theirs.feed[0] == pytest.approx(np.pi * 3 / 60, rel=1e-6)
            assert ours.feed[0] == pytest.approx(np.pi * 1.01 * 3 / 60, rel=1e-4)
        else:
            assert not found.same


SPLINES = (
    "F600\nG5.1 X10 Y10 I5 J0\nG5.1 X30 Y0 I5 J0\nG1 X0\nF100 G5.2 X0 Y10 P1 L3\nX10 Y10 P1\nX10 Y0 P1\nG5.3\n"
    "G1 X5\nG5 X20 Y10 I5 J0 P0 Q5\nM2\n"
)


@needs_linuxcnc
class TestSplines:
    """LinuxCNC tells chords of them."""

    @pytest.fixture
    def path(self, tmp_path):
        path = tmp_path / "part.ngc"
        path.write_text(SPLINES)
        return path

    def test_the_chords_of_a_spline_are_the_spline(self, path):
        found = compare(path, {})
        assert (found.linuxcnc, found.ours, found.difference) == ("", "", "")

    @pytest.mark.parametrize(
        ("old", "new"), [("J0\nG1 X0", "J0.01\nG1 X0"), ("P1 L3", "P1.01 L3"), ("Q5", "Q4.99"), ("F600", "F601")]
    )
    def test_another_spline_is_found(self, path, old, new):
        theirs = read_with_linuxcnc(path, from_zero=True)
        path.write_text(SPLINES.replace(old, new))
        assert difference(theirs, read_program(path, start=(0, 0, 0))).startswith("move ")


@needs_linuxcnc
@pytest.mark.parametrize(
    "thread",
    ["G33 Z-3 K#4", "#<k>=2 G33 X5 Z-5 K[SQRT[2]*#4]", "G33 Z-3 KSQRT[#4]\nZ-5 K3", "G33.1 Z-3 K#4 I2",
     "G76 K2 P#4 Z-10 I-1 J0.5 Q29.5", "G76 K2 Z-10 I-1 J[1/3] Q29.5 P1.25", "G76 K2 Z-10 I-1 J0.5 P1.25 E2 L3",
     "G33 Z-3 K#4\nG28 X5"],
)  # fmt: skip
def test_the_pitch_of_a_thread_may_be_computed(tmp_path, thread):
    path = tmp_path / "part.ngc"
    path.write_text(f"F60 S60 M3\n#4=2.123456789\nG4 P1\n{thread}\nG4 P2\nG1 X1\nM2\n")
    found = compare(path, {})
    assert (found.linuxcnc, found.ours, found.difference) == ("", "", "")
    dwells = [event.seconds for event in read_with_linuxcnc(path).events if event.kind == "dwell"]
    assert dwells == [1, 2]


class TestTheComparisonItself:
    def test_a_seed_is_always_the_same_program(self):
        assert random_program(7) == random_program(7)
        assert len({random_program(seed) for seed in range(50)}) == 50

    @pytest.mark.parametrize(
        ("name", "change"),
        [
            ("end", lambda a: a + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2e-3])),
            ("kind", lambda a: np.where(a == 0, 1, a).astype(np.uint8)),
            ("line", lambda a: a + 1),
            ("centre", lambda a: a + 2e-3),
            ("sweep", lambda a: a * 1.001),
            ("feed", lambda a: a * (1.0 + 1e-8)),
            ("normal", lambda a: (a + 1).astype(np.uint8)),
        ],
    )
    def test_finds_what_is_not_the_same(self, tmp_path, name, change):
        path = tmp_path / "part.ngc"
        path.write_text("F60\nG1 X1\nG0 X2\nG2 X4 I1\nM2\n")
        program = read_program(path, start=(0, 0, 0))
        other = dataclasses.replace(program, **{name: change(getattr(program, name))})
        assert difference(program, program) == ""
        assert f": {name} " in difference(program, other)

    def test_finds_a_move_that_is_missing(self, tmp_path):
        path = tmp_path / "part.ngc"
        texts = "F60\nG1 X1\nM2\n", "F60\nG1 X1\nX2\nM2\n"
        one, two = [path.write_text(text) and read_program(path) for text in texts]
        assert difference(one, two) == "1 moves there, 2 here; the first 1 agree"

    def test_counts(self):
        found = [
            Agreement("a", moves=3),
            Agreement("b", linuxcnc="no"),
            Agreement("c", "no", "no"),
            Agreement("d", ours="no"),
        ]
        assert [one.same for one in found] == [True, False, True, False]
        facts = summary(found)
        assert facts["share_read"] == 0.5
        assert (facts["refused_by_both"], facts["read_here_alone"], facts["moves_compared"]) == (1, 1, 3)

"""Subroutines, loops, conditions, calls of files and M98: the order in which lines are run."""

import time

import numpy as np
import pytest

from planner.errors import InputError

END = "\nM2\n"


class TestLoops:
    def test_while(self, read):
        p = read("F60\n#1=3\no1 while [#1 gt 0]\nG1 X#1\n#1=[#1-1]\no1 endwhile" + END)
        assert p.end[:, 0].tolist() == [3, 2, 1]
        assert p.line.tolist() == [4, 4, 4]

    def test_do_while(self, read):
        p = read("F60\n#1=0\no1 do\n#1=[#1+1]\nG1 X#1\no1 while [#1 lt 3]\nG1 Y1" + END)
        assert p.end[:, 0].tolist() == [1, 2, 3, 3]

    def test_repeat_of_plain_lines(self, read):
        p = read("F60 G91\no1 repeat [3]\nG1 X1\nY2\no1 endrepeat\nG90 G1 X0" + END)
        assert p.end[:, :2].tolist() == [[1, 0], [1, 2], [2, 2], [2, 4], [3, 4], [3, 6], [0, 6]]
        assert p.line.tolist() == [3, 4, 3, 4, 3, 4, 6]

    def test_repeat_of_nothing(self, read):
        assert read("F60\no1 repeat [0]\nG1 X5\no1 endrepeat\nG1 X1" + END).end[:, 0].tolist() == [1]

    def test_within_each_other(self, read):
        text = "F60 G91\no1 repeat [2]\nG1 X1\no2 repeat [3]\nY1\no2 endrepeat\no1 endrepeat"
        p = read(text + END)
        assert p.end[-1, :3].tolist() == [2, 6, 0]
        assert len(p) == 8

    @pytest.mark.parametrize(("word", "expected"), [("break", [1, 2]), ("continue", [1, 2, 4])])
    @pytest.mark.parametrize(
        ("head", "tail"),
        [("while [#1 lt 4]", "endwhile"), ("do", "while [#1 lt 4]"), ("repeat [4]", "endrepeat")],
        ids=["while", "do", "repeat"],
    )
    def test_break_and_continue(self, read, word, expected, head, tail):
        text = f"F60\n#1=0\no1 {head}\n#1=[#1+1]\no2 if [#1 eq 3]\no1 {word}\no2 endif\nG1 X#1\no1 {tail}"
        assert read(text + END).end[:, 0].tolist() == expected


class TestConditions:
    @pytest.mark.parametrize(("number", "expected"), [(1, 10), (2, 20), (3, 30), (4, 40)])
    def test_the_first_that_holds(self, read, number, expected):
        text = f"F60\n#1={number}\no1 if [#1 eq 1]\nG1 X10\no1 elseif [#1 lt 3]\nG1 X20\no1 elseif [#1 eq 3]\nG1 X30\n"
        p = read(text + "o1 else\nG1 X40\no1 endif\nG1 Y1" + END)
        assert p.end[:, 0].tolist() == [expected, expected]

    def test_none_that_holds(self, read):
        assert len(read("F60\no1 if [0]\nG1 X10\no1 endif\nG1 Y1" + END)) == 1


class TestSubroutines:
    def test_arguments_and_own_parameters(self, read):
        text = "o<box> sub\nG1 X#1 Y[#2*2]\n#<w>=5\n#1=99\no<box> endsub\nF60\n#1=7\no<box> call [3] [4]\nG1 X#1" + END
        p = read(text)
        assert p.end[:, :2].tolist() == [[3, 8], [7, 8]]
        assert p.line.tolist() == [2, 9]

    def test_what_is_not_passed_is_0(self, read):
        assert read("o1 sub\nG1 X[#30+1]\no1 endsub\nF60\no1 call" + END).end[0, 0] == 1

    def test_return_with_a_value(self, read):
        text = "o1 sub\no2 if [#1 gt 2]\no1 return [#1*10]\no2 endif\no1 endsub [5]\nF60\no1 call [3]\n"
        p = read(text + "G1 X#<_value>\no1 call [1]\nG1 X[#<_value>+#<_value_returned>]" + END)
        assert p.end[:, 0].tolist() == [30, 6]

    def test_named_parameters_are_its_own_and_those_with_a_stroke_are_of_all(self, read, refusal):
        head = "o1 sub\n#<a>=1\n#<_b>=2\no1 endsub\nF60\no1 call\n"
        assert read(head + "G1 X#<_b>" + END).end[0, 0] == 2
        assert refusal(head + "G1 X#<a>" + END) == "7: #<A>: the parameter is not set before it is read"

    def test_calls_within_calls(self, read):
        text = (
            "o1 sub\nG1 X#1\no2 call [#1+1]\no1 endsub\no2 sub\nG1 X[#1*10]\no2 endsub\nF60\no1 call [1]\no1 call [2]"
        )
        assert read(text + END).end[:, 0].tolist() == [1, 20, 2, 30]

    def test_a_file_beside_the_program(self, read, tmp_path):
        (tmp_path / "slot.ngc").write_text("(a slot)\no<slot> sub\nG1 X#1\nG91\nG1 Y1\nG90\no<slot> endsub\nM2\n")
        p = read("F60\nG1 X1\no<slot> call [5]\no<slot> call [6]" + END)
        assert p.end[:, :2].tolist() == [[1, 0], [5, 0], [5, 1], [6, 1], [6, 2]]
        assert p.line.tolist() == [2, 3, 3, 4, 4]

    def test_programs_by_number(self, read):
        text = "O1\nF60 G91\nM98 P100 L2\nG1 X1\nM98 P0100\nM30\nO100\nG1 Y1\nM99\n"
        p = read(text)
        assert p.end[:, :2].tolist() == [[0, 1], [0, 2], [1, 2], [1, 3]]
        assert p.line.tolist() == [8, 8, 4, 8]

    def test_a_number_of_the_program_alone(self, read):
        assert len(read("%\nO1000 (part)\nN10 G1 X1 F60\nM30\n%\n")) == 1


class TestMachine:
    def test_where_it_stands(self, read):
        p = read("F60\nG10 L2 P2 X100\nG55 G1 X3 Y4\nG91 G1 X[#5420*2] Y#<_y>\nG90 G54 X#5421 Y#5241" + END)
        assert p.end[:, :2].tolist() == [[103, 4], [109, 8], [8, 100]]

    def test_in_a_loop(self, read):
        p = read("F60 G91\no1 while [#<_x> lt 3]\nG1 X1\no1 endwhile\nG90 G1 Y#[5420]" + END)
        assert p.end[:, :2].tolist() == [[1, 0], [2, 0], [3, 0], [3, 3]]

    def test_in_inches(self, read):
        assert read("G20 F60\nG1 X2\nY#5420 Z#<_imperial>" + END).end[1, :3].tolist() == [50.8, 50.8, 25.4]

    def test_what_is_in_force(self, read):
        head = "F60\nG10 L1 P4 Z7\nT4 M6 G43\nG92 X-1\nG56 G91\nG1 "
        p = read(head + "X#5220 Y#5400 Z#5403\nG90 X#5211 Y[#<_incremental>+#<_coord_system>]" + END)
        assert p.end[:, :3].tolist() == [[3, 4, 7], [2, 561, 7]]  # a line is read as a whole before it acts


class TestPlaces:
    def test_a_fault_in_a_line_that_is_evaluated(self, refusal):
        assert refusal("F60\n#1=4\nG2 X[#1+6] Y0 I#1\nM2") == (
            "3: I#1: start and end lie 4 and 6 mm from the centre; they may differ by 0.0283 mm"
        )

    def test_a_fault_in_a_file_that_is_called(self, read, tmp_path):
        (tmp_path / "slot.ngc").write_text("o<slot> sub\nG1 X[1/0]\no<slot> endsub\n")
        with pytest.raises(InputError, match=r"^slot\.ngc:2: \[1/0: divides by 0$"):
            read("F60\no<slot> call\nM2")

    def test_lines_that_are_never_run_do_not_count(self, read):
        assert len(read("F60\no1 if [0]\nG1 X[1/0]\nX?\no1 endif\nG1 X1\nM2\nG1 X#5\no7 endif?\n")) == 1

    def test_block_delete(self, read):
        assert len(read("F60\n/ o1 call\n/#1=[\nG1 X1\n#1=2" + END)) == 1

    def test_comments_and_spaces(self, read):
        p = read(
            "F60\n# 1 = 3 ; [comment\nG1 (x [) X [ # 1 + 1 ] Y - 2\n(o1 call)\nN5 O 1 IF [ 1 ]\nX9\no1 endif" + END
        )
        assert p.end[:, :2].tolist() == [[4, -2], [9, -2]]


class TestBadPrograms:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("o1 sub\nG1 X1\nM2", "1: O1SUB: is not closed"),
            ("o1 endwhile\nM2", "1: O1ENDWHILE: closes no while of this label"),
            ("o1 while [1]\no2 endwhile\nM2", "1: O1WHILE[1]: is not closed"),
            ("o1 if [1]\no2 while [0]\no1 endif\no2 endwhile\nM2", "1: O1IF[1]: is not closed"),
            ("o1 break\nM2", "1: O1BREAK: is in no loop of this label"),
            ("o1 sub\no1 endsub\no1 sub\no1 endsub\nM2", "3: O1SUB: there is a subroutine of this label already"),
            ("o1 if\no1 endif\nM2", "1: O1IF: needs 1 expression in brackets [ ]"),
            ("o1 if [1] [2]\no1 endif\nM2", "1: O1IF[1][2]: needs 1 expression in brackets [ ]"),
            ("o1 do X5\no1 while [0]\nM2", "1: O1DOX5: nothing belongs behind it"),
            ("o1 frob\nM2", "1: O1FROB: nothing belongs behind it; O words are sub"),
            ("o1 call 5\nM2", "1: 5: an expression in brackets [ ] belongs here"),
            ("o<nowhere> call\nM2", "1: O<NOWHERE>CALL: there is no subroutine nowhere in the program, and no file "),
            ("o<../part> call\nM2", "1: O<../PART>CALL: there is no subroutine ../part in the program"),
            ("o1 endsub\nM2", "1: O1ENDSUB: closes no sub of this label"),
            ("o1 return\nM2", "1: O1RETURN: ends no subroutine that was called"),
            ("M98 P7\nM2", "1: M98P7: there is no subroutine 7 in the program, and no file 7.ngc beside it"),
            ("M98\nM2", "1: M98: M98 needs the number of a program, P"),
            ("M98 P1 L0\nM2", "1: M98P1L0: the repeats L of M98 are a whole number of at least 1"),
            ("G1 X1 F60\nM99\nM2", "2: M99: repeats the program for ever; end it with M2 or M30"),
            ("F60\nG1 X[1/0]\nM2", "2: [1/0: divides by 0"),
            ("F60\nG1 X#5\nM2", "2: #5: the parameter is not set before it is read"),
            ("o1 sub\no1 call\no1 endsub\no1 call\nM2", "2: O1CALL: more than 10 calls within each other"),
            ("M98 P5\nM2\nO5\nM98 P5\nM99\n", "4: M98P5: more than 10 calls within each other"),
        ],
    )  # fmt: skip
    def test_line_word_and_reason(self, refusal, text, message):
        assert refusal(text).startswith(message)

    def test_a_file_that_calls_itself(self, read, tmp_path):
        (tmp_path / "ring.ngc").write_text("o<ring> sub\no<ring> call\no<ring> endsub\n")
        with pytest.raises(InputError, match=r"^ring\.ngc:2: O<RING>CALL: more than 10 calls within each other"):
            read("o<ring> call\nM2")

    def test_files_that_call_each_other(self, read, tmp_path):
        for name, other in (("egg", "hen"), ("hen", "egg")):
            (tmp_path / f"{name}.ngc").write_text(f"o<{name}> sub\no<{other}> call\no<{name}> endsub\n")
        with pytest.raises(InputError, match=r"^hen\.ngc:2: O<EGG>CALL: more than 10 calls within each other"):
            read("o<egg> call\nM2")

    def test_a_file_that_is_not_what_is_called(self, refusal, tmp_path):
        (tmp_path / "other.ngc").write_text("G1 X1\nM2\n")
        assert refusal("o<other> call\nM2") == "1: O<OTHER>CALL: the file other.ngc has no subroutine other"

    @pytest.mark.parametrize(
        "body",
        ["", "#1=[#1+1]\n", "G1 X1\n", "M8\n", "o2 if [0]\no2 endif\n"],
        ids=["empty", "count", "move", "switch", "if"],
    )
    def test_a_loop_that_never_ends(self, refusal, body, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.flow._MAX_WORK", 200_000)
        begin = time.perf_counter()
        message = refusal(f"F60\n#1=0\no1 while [1]\n{body}o1 endwhile\nM2")
        assert "end of steps: the program has run 20000 lines and does not end; a loop here may never end" in message
        assert time.perf_counter() - begin < 20.0

    def test_a_loop_of_moves_that_never_ends(self, refusal, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.reader._MAX_MOVES", 1000)
        monkeypatch.setattr("planner.programs.reading.flow._MAX_WORDS", 500)
        assert "more than 1000 moves" in refusal("F60 G91\no1 while [1]\nG1 X1\no1 endwhile\nM2")


@pytest.mark.parametrize("seed", range(20))
def test_programs_written_out_by_hand_are_the_same(read, seed):
    """Loops, calls, conditions, expressions and offsets at random: the blocks they stand for give the same program."""
    rng = np.random.default_rng(seed)
    flow = ["o<leg> sub", "G1 X[#1*COS[#2]] Y[#1*SIN[#2]] F[#3+100]", "o<leg> endsub"]
    plain = []
    for k in range(8):
        r, turn, count = round(rng.uniform(5, 50), 3), int(rng.integers(5, 60)), int(rng.integers(1, 6))
        match rng.integers(4):
            case 0:
                flow += [f"#10=0 #11={r:.4f}", f"o{k} while [#10 LT {count}]", f"o<leg> call [#11] [#10*{turn}] [#10]"]
                flow += ["#10=[#10+1]", f"o{k} endwhile"]
                for i in range(count):
                    x, y = r * np.cos(np.radians(i * turn)), r * np.sin(np.radians(i * turn))
                    plain.append(f"G1 X{x:.9f} Y{y:.9f} F{i + 100}")
            case 1:
                flow += [f"G91 o{k}".split()[0], f"o{k} repeat [{count}]", f"G1 Z{r:.3f}", f"o{k} endrepeat", "G90"]
                plain += ["G91", *[f"G1 Z{r:.3f}"] * count, "G90"]
            case 2:
                flow += [f"#<a>={count}", f"o{k} if [#<a> MOD 2 EQ 0]", f"G0 X[#<a>/2+{r:.3f}]", f"o{k} else"]
                flow += [f"G10 L2 P1 X[#<a>*{turn}]", f"o{k} endif"]
                plain.append(f"G0 X{count / 2 + r:.9f}" if count % 2 == 0 else f"G10 L2 P1 X{count * turn}")
            case 3:
                flow += [f"G2 X[{r:.3f}*2] Y0 R[{r:.3f}*40]", f"G81 X{turn} Z-[1+{count}] R[2*1]", "G80"]
                plain += [
                    f"G2 X{2 * float(f'{r:.3f}'):.9f} Y0 R{40 * float(f'{r:.3f}'):.9f}",
                    f"G81 X{turn} Z-{1 + count} R2",
                    "G80",
                ]
    head = "F600 G1 X1 Y1 Z3\n"
    ours, theirs = read(head + "\n".join(flow) + END), read(head + "\n".join(plain) + END)
    assert ours.kind.tolist() == theirs.kind.tolist()
    assert ours.end == pytest.approx(theirs.end, abs=1e-6)
    assert ours.feed == pytest.approx(theirs.feed, rel=1e-9)
    assert np.nan_to_num(ours.centre) == pytest.approx(np.nan_to_num(theirs.centre), abs=1e-6)


def test_many_lines_with_few_expressions_are_read_in_bulk(read):
    body = "".join(f"G1 X{k % 97} Y{k % 89}\n" for k in range(50_000))
    begin = time.process_time()
    p = read("#1=600\nF#1\n" + body + END)
    assert len(p) == 49_999
    assert time.process_time() - begin < 5.0


def test_what_the_machine_keeps_is_told_in_mm_and_where_the_program_is_in_its_own_units(read):
    head = "F60\nG10 L2 P2 X3\nT1 M6\nG10 L1 P1 X2\nG1 X4\nG28.1\nG92 X4.5\nG20\nF6\n"
    for number, there in ((5161, 4.0), (5221 + 20, 3.0), (5401, 2.0), (5211, -0.5), (5420, 4.5 / 25.4)):
        program = read(f"{head}G1 Y#{number}\nM2\n")
        assert program.end[-1, 1] == pytest.approx(25.4 * there), number

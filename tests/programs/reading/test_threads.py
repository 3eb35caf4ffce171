"""Feeds and moves that hang on the spindle: threads, feed per turn, constant cutting speed; and diameters in X."""

import os
import re
import subprocess

import numpy as np
import pytest
from compensated_programs import HAS_LINUXCNC

from planner.errors import InputError
from planner.programs.reading.program import LINE, RAPID
from planner.programs.reading.reader import read_program

END = "\nM2\n"


class TestFeedPerTurn:
    def test_is_the_feed_times_the_speed(self, read):
        p = read("G95 F0.2 S600 M3\nG1 X10\nS1200\nX20\nF0.1 X30\nG94 F60 X40" + END)
        assert p.feed == pytest.approx([2.0, 4.0, 2.0, 1.0])

    def test_in_inches(self, read):
        assert read("G20 G95\nF0.01 S600\nG1 X1" + END).feed == pytest.approx([2.54])

    def test_cycles_and_arcs_take_it_too(self, read):
        p = read("G95 F0.2 S600\nG2 X10 R5\nG81 X0 Z-5 R2" + END)
        assert p.feed[p.kind != RAPID] == pytest.approx([2.0, 2.0])

    def test_the_parts_it_is_read_in_do_not_matter(self, read, monkeypatch):
        text = "G96 D3000 S200 M3\nG95 F0.2\nG0 X10\nG1 X20\nG1 Z-5\nS100 X30\nG97 S600\nX40\nG33 Z-9 K1.5\n" + END
        whole = read(text)
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 8)
        assert read(text).feed.tolist() == whole.feed.tolist()

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G95 F0.2\nG1 X10", "2: G1: its feed is that of the spindle, which has no speed; S is missing"),
            ("G95 F0.2 S0\nG1 X10", "2: G1: its feed is that of the spindle, which has no speed; S is missing"),
            ("G95 S600\nG1 X10", "2: G1: no feed is given; F is missing"),
            ("F60 G95 S600\nG1 X10\nG94 X20", "3: X20: no feed is given; F is missing"),
            ("G95 F0.2 S9\nG1 X1\nG94\nX2", "4: X2: no feed is given; F is missing"),
            ("G96 D2000", "1: G96: needs the cutting speed S beside it"),
            (
                "G96 S200\nG95 F0.2\nG1 Z10",
                "3: G1: on the axis, at X0, the speed of G96 has no bound; write G96 with D",
            ),
        ],
    )
    def test_what_it_needs(self, refusal, text, message):
        assert refusal(text + END) == message


class TestCuttingSpeed:
    """The time of a move under G96 and G95 is the integral of its turns' times, here by small steps."""

    @pytest.mark.parametrize(("unit", "surface"), [("G21", 200e3), ("G20", 200 * 304.8)], ids=["metres", "feet"])
    @pytest.mark.parametrize(
        "move", ["G1 X50", "G1 X-30 Z4", "G1 Z-10", "G18 G2 X20 Z-10 K-5", "G18 G3 X2 Z9 R40", "G19 G2 Y2 X7 J1"]
    )
    def test_of_moves(self, read, unit, surface, move):
        p = read(f"{unit} G96 D2500 S200 M3\nG95 F0.2\nG0 X20 Z0\n{move}" + END)
        k = len(p) - 1
        share = np.linspace(0, 1, 200_001)
        x = p.start[k, 0] + share * (p.end[k, 0] - p.start[k, 0])
        if p.sweep[k] and p.normal[k] == 1:
            spoke = p.start[k, :3] - p.centre[k]
            x = p.centre[k, 0] + ((spoke[2] + 1j * spoke[0]) * np.exp(1j * share * p.sweep[k])).imag
        turn = 60.0 * np.maximum(1 / 2500, 2 * np.pi * np.abs(x) / surface)
        pitch = 0.2 * (25.4 if unit == "G20" else 1.0)
        assert p.feed[k] == pytest.approx(pitch / np.trapezoid(turn, share), rel=2e-4)

    def test_x_counts_from_the_origin_of_the_program(self, read):
        a = read("G96 S200 M3\nG95 F0.2\nG0 X20\nG1 Z-5" + END)
        b = read("G10 L2 P1 X100\nG96 S200 M3\nG95 F0.2\nG0 X20\nG1 Z-5" + END)
        assert b.feed[-1] == pytest.approx(a.feed[-1])

    def test_no_speed_counts_without_a_feed_per_turn(self, read):
        assert read("G96 S200 M3\nF60\nG1 X20" + END).feed.tolist() == [1.0]


class TestThreads:
    def test_a_thread_runs_at_the_pitch(self, read):
        p = read("S600 M3\nG0 X1 Z5\nG33 Z-5 K1.5\nX2 Z-9 K2\nG1 X5 F60" + END)
        assert p.kind[-3:].tolist() == [LINE] * 3
        assert p.feed[-3:] == pytest.approx([15.0, 20.0, 1.0])
        assert p.end[-3:-1, 2].tolist() == [-5, -9]

    def test_tapping_goes_back_to_where_it_began(self, read):
        p = read("S600 M3\nG0 X1 Z5\nG33.1 Z-5 K1.5 I2\nG91 G1 X1 F60" + END)
        assert p.end[-3:, 2].tolist() == [-5, 5, 5]
        assert p.feed[-3:] == pytest.approx([15.0, 30.0, 1.0])

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G33 Z-5 K1", "1: G33: the spindle does not turn; write M3 or M4, and S, before the thread"),
            ("M3\nG33 Z-5 K1", "2: G33: its feed is that of the spindle, which has no speed; S is missing"),
            ("M3 S9\nM5\nG33 Z-5 K1", "3: G33: the spindle does not turn; write M3 or M4, and S, before the thread"),
            ("M3 S9\nT1 M6\nG33 Z-5 K1", "3: G33: the spindle does not turn; write M3 or M4, and S, before the thread"),
            ("M3 S9\nG33 Z-5", "2: G33: needs the pitch K beside it"),
            ("M3 S9\nG33 Z-5 K1\nZ-7", "3: Z-7: needs the pitch K beside it"),
            ("M3 S9\nG33 Z-5 K0", "2: K0: the pitch of a thread must not be 0"),
            ("M3 S9\nG33 Z-5 K1 F3", "2: F3: the feed of a thread is that of the spindle"),
            ("M3 S9\nG33 K1", "2: G33: a thread needs an end point"),
            ("M3 S9\nG33.1 Z-5", "2: G33.1: needs the pitch K beside it"),
            ("M3 S9\nG76 Z-5 I1 J1 K2", "2: G76: needs P beside it"),
            ("M3 S9\nG76 Z-5", "2: G76: needs P and I and J and K beside it"),
            ("M3 S9\nG76 Z-5 P1 I0 J1 K2", "2: G76: the way I from the drive line to the crest must not be 0"),
            ("M3 S9\nG76 Z-5 P1 I1 J2 K2", "2: G76: the first depth J must be > 0, and the full depth K larger"),
            ("M3 S9\nG76 Z-5 P1 I1 J0 K2", "2: G76: the first depth J must be > 0, and the full depth K larger"),
            ("M3 S9\nG76 Z-5 P0 I1 J1 K2", "2: G76: the pitch P must be > 0"),
            ("M3 S9\nG76 Z-5 P1 I1 J0.000001 K2", "2: G76: makes more than 100000 passes; look at J, K and R"),
            ("M3 S9\nG76 Z-5 P1 I1 J1 K2 H1.5", "2: H1.5: must be a whole number"),
            ("M3 S9\nG76 P1 I1 J1 K2", "2: G76: a cycle needs X, Y or Z"),
            (
                "M3 S9\nG41.1 D1\nG33 Z-5 K1",
                "3: G33: is not possible while cutter compensation is on; write G40 before it",
            ),
        ],
    )
    def test_what_they_need(self, refusal, text, message):
        assert refusal(text + END) == message


class TestPlanesBesideXYZ:
    def test_lines_do_not_mind(self, read):
        assert len(read("G17.1 F60\nG1 X1\nG18.1\nX2\nG19.1 X3\nG17\nG2 X5 R1" + END)) == 4

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G17.1 F60\nG2 X5 R9", "2: G2: an arc needs the plane G17, G18 or G19"),
            ("G18.1 F60\nG81 X5 Z-1 R9", "2: X5: a cycle needs the plane G17, G18 or G19"),
            ("G17.1 G41.1 D1", "1: G41.1: the tool can be beside a path in G17 and G18, not in G19"),
        ],
    )
    def test_arcs_and_cycles_do(self, refusal, text, message):
        assert refusal(text + END) == message


class TestDiameters:
    def test_x_is_a_diameter(self, read):
        p = read(
            "G7 G18 F60\nG0 X20 Z0\nG1 X30 Z-5\nG91 X2\nG90 G3 X40 Z-9 R4\nG8 X7".replace("G8 X7", "G8 G1 X7") + END
        )
        assert p.end[-4:, 0] == pytest.approx([15, 16, 20, 7])

    def test_also_in_offsets_and_homes(self, read):
        p = read("G7 F60\nG10 L2 P1 X10\nG92 X0\nG1 X20\nG28 X30" + END, start=(5, 0, 0))
        assert p.end[:, 0] == pytest.approx([15, 20, 0])

    def test_centres_are_radii(self, read):
        p = read("G7 G18 F60\nG0 X20 Z0\nG3 X20 Z-10 K-5 I0" + END)
        assert p.centre[-1].tolist() == [10, 0, -5]

    def test_of_a_thread_all_depths(self, read):
        head = "S600 M3\nG0 X{} Z5\n"
        a = read("G7 " + head.format(40) + "G76 P1 Z-9 I-2 J0.6 K1.6" + END)
        b = read(head.format(20) + "G76 P1 Z-9 I-1 J0.3 K0.8" + END)
        assert a.end == pytest.approx(b.end, abs=1e-12)


@pytest.mark.skipif(not HAS_LINUXCNC, reason="LinuxCNC's interpreter rs274 is not installed")
class TestAgainstLinuxCNC:
    CALL = re.compile(
        r"(STRAIGHT_TRAVERSE|STRAIGHT_FEED|RIGID_TAP|START_SPEED_FEED_SYNC|STOP_SPEED_FEED_SYNCH)\((.*)\)"
    )

    def canonical(self, text, folder):
        """Kind, end and pitch of LinuxCNC's moves; None where it refuses."""
        (folder / "part.ngc").write_text(text)
        for name in ("tool.tbl", "var"):
            (folder / name).write_text("")
        command = ["rs274", "-g", "-n", "2", "-t", "tool.tbl", "-v", "var", "part.ngc"]
        environment = {**os.environ, "HOME": str(folder)}
        run = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
        if run.returncode:
            return None
        moves, pitch, at = [], np.nan, np.zeros(3)
        for name, values in ((m[1], [float(x) for x in m[2].split(",") if x]) for m in self.CALL.finditer(run.stdout)):
            if name.startswith("ST") and "SYNC" in name:
                pitch = values[0] if values else np.nan
                continue
            before, at = at, np.array(values[:3])
            moves.append((name, at, pitch))
            if name == "RIGID_TAP":
                moves.append((name, before, pitch))
                at = before
        return moves

    def random_program(self, seed):
        rng = np.random.default_rng(seed)
        modes = f"{'G18 ' if seed % 2 else ''}{'G7 ' if seed % 3 == 0 else ''}"
        text = f"{modes}S600 M{rng.integers(3, 5)}\nG0 X{rng.uniform(10, 40):.3f} Y0 Z3\n"
        for _ in range(rng.integers(1, 4)):
            text += f"G0 X{rng.uniform(10, 40):.3f} Z{rng.uniform(1, 5):.3f}\n"
            z, pitch = rng.uniform(-30, -1) if rng.random() < 0.8 else 40, rng.uniform(0.2, 3)
            thread = rng.random()
            if thread < 0.25:
                text += f"G33 Z{z:.3f} K{pitch:.3f}\nZ{z - 3:.3f} X{rng.uniform(10, 40):.3f} K{pitch:.3f}\n"
            elif thread < 0.35:
                text += f"G33.1 Z{z:.3f} K{pitch:.3f}\n"
            else:
                j = rng.uniform(0.05, 1.0)
                words = [
                    f"G76 Z{z:.3f} P{pitch:.3f} I{rng.choice([-1, 1]) * rng.uniform(0.5, 3):.3f}",
                    f"J{j:.3f} K{j * rng.uniform(0.6, 3):.3f}",
                ]
                choices = [f"R{rng.uniform(0.5, 2.5):.3f}", f"Q{rng.uniform(0, 40):.2f}", f"H{rng.integers(4)}"]
                choices += [f"E{rng.uniform(0, 3):.3f} L{rng.integers(4)}", f"X{rng.uniform(10, 40):.3f}"]
                text += " ".join([*words, *(word for word in choices if rng.random() < 0.5)]) + "\n"
        return text + "G0 X5\nM2\n"

    def test_the_same_moves_and_pitches(self, tmp_path):
        counted, refused = 0, 0
        for seed in range(80):
            text = self.random_program(seed)
            theirs = self.canonical(text, tmp_path)
            try:
                ours = read_program(tmp_path / "part.ngc", start=(0, 0, 0))
            except InputError as error:
                assert theirs is None, (seed, str(error))  # noqa: PT017
                refused += 1
                continue
            assert theirs is not None, seed
            at, k = np.zeros(3), 0
            for name, end, pitch in theirs:
                if np.abs(end - at).max() < 1e-6 and (k == len(ours) or np.abs(ours.end[k, :3] - end).max() > 1e-3):
                    continue  # LinuxCNC keeps moves of no length
                assert ours.end[k, :3] == pytest.approx(end, abs=1e-3), (seed, k)
                assert ours.kind[k] == (RAPID if name == "STRAIGHT_TRAVERSE" else LINE), (seed, k)
                if ours.kind[k] == LINE:
                    assert ours.feed[k] == pytest.approx(10.0 * pitch, abs=1e-4), (seed, k)
                at, k = end, k + 1
            assert k == len(ours), seed
            counted += k
        assert counted > 1000
        assert 3 < refused < 40

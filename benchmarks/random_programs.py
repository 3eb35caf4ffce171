"""Random part programs over the whole dialect, each made of a seed: for the comparison with LinuxCNC's interpreter.

Most of them are right.  About a third has one line that may be wrong, so that what is refused is compared as well.  Words
that the two read differently on purpose (docs/format-program.md says which) are not in them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
PLANES = {"G17": ("X", "Y", "Z", "I", "J"), "G18": ("Z", "X", "Y", "K", "I"), "G19": ("Y", "Z", "X", "J", "K")}
TOOLS = (1, 2, 7)  # of benchmarks.dialect.TOOLS
# What one would not write, and the readers have to agree on.
DOUBTFUL = (
    "G0 G1 X1", "G2 X5 Y5", "G3 I1", "G2 X1 Y1 I5 J9", "X1 G80", "G4", "G4 P-1", "G94 G1 X1 F0", "G1 X[1/0]",
    "G1 XSQRT[-1]", "G1 X[LN[0]]", "G10 L2 P12 X1", "G10 L7 P1 X1", "G10 P1 X1", "G81 X1 Z-1", "G81 X1 R1",
    "G83 X1 Z-1 R1", "G83 X1 Z-1 R1 Q0", "G82 X1 Z-1 R1", "G81 X1 Z5 R1", "G43 H555", "T555 M6", "G1 G28 X1", "G92",
    "G53 X1", "G53 G2 X1 I1", "G38.2", "M3 M4", "M7 M8", "M3 M8", "G17 G18", "G90 G91", "G1 XX1", "G1 X", "X1e3",
    "G1 X1.2.3", "G1 X1 (open", "G1 X1 )", "G1 X1 Q3", "G1 X1 R2", "G1 I2", "P1", "R1", "L2", "H3", "Q1",
    "G64 Q0.1", "G64 P-1", "G61 P1", "O999 endif", "O999 break", "M98 P777", "G1 X#5700", "G1 X#0", "#1=", "#33",
    "G5.9", "G123", "M123456", "M-1", "G-1", "N1.5 G0 X1", "G0 N5 X1", "G0.99999 X1", "G1 X1 M30", "G43.1",
    "G43 X1", "G92.1 X1", "G28 G0 X1", "F-1", "S-5", "T-1", "T1.5", "G17.5", "G2 X0 Y0 I0", "G2 X1 I0.5 P0",
    "G2 X1 I0.5 P1.5", "G20 G21", "G54 G55", "G43 G49", "G98 G99", "G94 G93", "M0 M1", "G4 P1 X1",
    "G18 G2 X1 Z1 J1", "G91 G81 X1 Z-1 R1 L0", "G0 X1 Y2 Z3 G4 P1", "^30", "@5 X1", "M72", "M71",
    "G1 X1 H", "G 1 X 2", "G1X1Y", "g01x1y-.5", "G1 X1.", "G1 X-", "G1 X.",
    "G59.4", "G28 X1 Y1 I1", "G1 X[1 + ]", "G1 X[1", "G1 X1]", "G1 X[2 3]", "G1 XATAN[1]", "G1 XFOO[1]", "M19 R10",
    "M60", "G80 X1", "G80 G1 X1", "G80 G0 X1", "G53 G80 X1", "G1 Z", "M61", "M66", "M67 E0 Q1", "M62",
)  # fmt: skip
_FAULTY = 0.35  # share of the programs with a line that may be wrong


class RandomProgram:
    """The lines of a program; what its words depend on is kept beside them."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.lines: list[str] = []
        self.plane, self.relative, self.inch, self.inverse = "G17", False, False, False
        self.names = ["X", "Y", "Z"]
        if self.chance(0.4):
            self.names += [str(name) for name in self.rng.permutation(list("ABCUVW"))[: self.rng.integers(1, 4)]]
        self.writes_tools = self.chance(0.5)  # what G10 L1 writes is lost to the interpreter alone at a tool change
        self.labels = 100
        self.has_do = self.chance(0.5)  # LinuxCNC runs a do once after a break out of a while

    # ------------------------------------------------------------ numbers and words

    def some(self, *choices: str) -> str:
        """One of several."""
        return choices[self.rng.integers(len(choices))]

    def chance(self, share: float) -> bool:
        """True for a share of the calls."""
        return bool(self.rng.random() < share)

    def number(self, size: float = 20.0, digits: int = 3) -> float:
        """A coordinate with some digits, in the unit in force."""
        return round(float(self.rng.normal()) * size / (25.4 if self.inch else 1.0), digits + self.inch)

    def value(self, number: float) -> str:
        """A number as it may be written: plain, with a plus, without a zero, or as an expression."""
        plain = f"{number:.6f}".rstrip("0").rstrip(".") or "0"
        kind = self.rng.random()
        if kind < 0.78:
            return plain
        if kind < 0.8:
            return f"--{plain}" if number >= 0 else f"-+{plain[1:]}"
        if kind < 0.85:
            return f"+{plain}" if number >= 0 else plain
        if kind < 0.9:
            return (
                plain.replace("0.", ".", 1)
                if abs(number) < 1 and "." in plain
                else plain
                if "." in plain
                else f"{plain}."
            )
        if kind < 0.95:
            return f"[{plain}]"
        part = round(number / 3.0, 3)
        return f"[{part}+{round(number - part, 6)}]"

    def word(self, letter: str, number: float) -> str:
        """A word, perhaps in small letters or with a space in it."""
        letter = letter.lower() if self.chance(0.1) else letter
        return f"{letter}{' ' if self.chance(0.05) else ''}{self.value(number)}"

    def axes(self, size: float = 20.0, least: int = 1) -> list[str]:
        """Words of some axes."""
        count = int(self.rng.integers(least, 4))
        names = [str(name) for name in self.rng.permutation(self.names)[:count]]
        return [
            self.word(name, round(float(self.rng.normal()) * 90.0, 2) if name in "ABC" else self.number(size))
            for name in names
        ]

    def feed(self) -> list[str]:
        """The F that a block needs in inverse time."""
        return [self.word("F", round(float(self.rng.uniform(0.5, 20.0)), 2))] if self.inverse else []

    def say(self, *words: str) -> None:
        """A line: the words in any order, with comments and line numbers here and there."""
        shuffled = [str(word) for word in self.rng.permutation(list(words))]
        if self.chance(0.1):
            shuffled.insert(int(self.rng.integers(len(shuffled) + 1)), self.some("(a comment)", "( X5 )"))
        head = f"N{10 * len(self.lines)} " if self.chance(0.1) else ""
        tail = self.some("", "", "", " ; the end", " (G1 X1)") if self.chance(0.1) else ""
        self.lines.append(head + self.some(" ", "", " ").join(shuffled) + tail)

    def label(self) -> int:
        """A label that is new."""
        self.labels += 1
        return self.labels

    # ------------------------------------------------------------ what a line may be

    def line(self) -> None:
        """A straight cut, or more without their G word."""
        self.say(self.some("G1", "G01", "G1.0", "g1"), *self.axes(), *self.feed())
        for _ in range(int(self.rng.integers(0, 3))):
            self.say(*self.axes(), *self.feed())

    def rapid(self) -> None:
        """A rapid."""
        self.say(self.some("G0", "G00"), *self.axes())

    def arc(self) -> None:
        """An arc by its centre, in relative distances, with turns or a rise."""
        first, second, along, i, j = PLANES[self.plane]
        centre = np.array([self.number(), self.number()])
        angle = float(self.rng.uniform(0.0, 2.0 * np.pi)) if self.chance(0.85) else 0.0
        cos, sin = np.cos(angle), np.sin(angle)
        end = centre + np.array([[cos, -sin], [sin, cos]]) @ -centre
        digits = 3 + self.inch
        words = [f"{i}{centre[0]:.{digits}f}", f"{j}{centre[1]:.{digits}f}"]
        if angle or self.chance(0.5):
            words += [f"{first}{end[0]:.{digits}f}", f"{second}{end[1]:.{digits}f}"]
        if self.chance(0.3):
            words.append(self.word(along, self.number(5.0)))
        if self.chance(0.2):
            words.append(f"P{self.rng.integers(1, 5)}")
        if len(self.names) > 3 and self.chance(0.3):
            words.append(self.word(self.names[3], self.number()))
        self.to_relative(True)
        self.say(self.some("G2", "G3", "G02", "G03"), *words, *self.feed())

    def arc_by_radius(self) -> None:
        """An arc by its radius, which now and then is a little too small."""
        first, second, along, *_ = PLANES[self.plane]
        a, b = self.number(), self.number()
        self.to_relative(True)
        half = float(np.hypot(a, b)) / 2.0
        radius = (
            half * float(self.rng.uniform(1.001, 3.0)) if self.chance(0.9) else half - 10.0 ** self.rng.uniform(-5, -2)
        )
        words = [self.word(first, a), self.word(second, b), f"R{self.rng.choice([-1, 1]) * radius:.4f}"]
        if self.chance(0.3):
            words.append(self.word(along, self.number(5.0)))
        self.say(self.some("G2", "G3"), *words, *self.feed())

    def arc_absolute(self) -> None:
        """An arc whose centre is absolute."""
        first, second, _, i, j = PLANES[self.plane]
        self.to_relative(False)
        start, centre = np.array([self.number(), self.number()]), np.array([self.number(), self.number()])
        turn = float(self.rng.uniform(0.2, 6.0))
        cos, sin = np.cos(turn), np.sin(turn)
        end = centre + np.array([[cos, -sin], [sin, cos]]) @ (start - centre)
        digits = 3 + self.inch
        self.say("G0", f"{first}{start[0]:.{digits}f}", f"{second}{start[1]:.{digits}f}")
        words = [
            f"{name}{value:.{digits}f}" for name, value in zip((first, second, i, j), (*end, *centre), strict=True)
        ]
        self.say("G90.1", self.some("G2", "G3"), *words, *self.feed())
        self.say("G91.1")

    def to_relative(self, relative: bool) -> None:
        """Change the distance mode where it is another."""
        if relative != self.relative:
            self.relative = relative
            self.say("G91" if relative else "G90")

    def modes(self) -> None:
        """Plane, units, distances, feed mode, path mode."""
        kind = self.rng.integers(6)
        if kind == 0:
            self.plane = self.some(*PLANES)
            self.say(self.plane)
        elif kind == 1:
            self.inch = not self.inch
            self.say("G49")
            self.say("G20" if self.inch else "G21")
            self.say(self.word("F", round(float(self.rng.uniform(1.0, 900.0)), 1))) if not self.inverse else None
        elif kind == 2:
            self.to_relative(not self.relative)
        elif kind == 3:
            self.inverse = not self.inverse
            self.say("G93" if self.inverse else "G94")
            if not self.inverse:
                self.say(self.word("F", round(float(self.rng.uniform(1.0, 900.0)), 1)))
        elif kind == 4:
            self.say(self.some("G61", "G61.1", "G64", "G64 P0.01", "G64 P0", "G64 P0.02 Q0.01"))
        elif not self.inverse:
            self.say(self.word("F", round(float(self.rng.uniform(1.0, 900.0)), 1)))

    def offsets(self) -> None:
        """Coordinate systems, G92 and its kin."""
        kind = self.rng.integers(8)
        axes = self.axes()
        if kind == 0:
            self.say(self.some(*SYSTEMS))
        elif kind == 1:
            self.say("G10", "L2", f"P{self.rng.integers(0, 10)}", *axes)
        elif kind == 2:
            self.say("G10", "L20", f"P{self.rng.integers(0, 10)}", *axes)
        elif kind == 3:
            self.say("G92", *axes)
        elif kind == 4:
            self.say(self.some("G92.1", "G92.2", "G92.3"))
        elif kind == 5:
            self.say("G52", *axes)
        elif kind == 6:
            self.to_relative(False)
            self.say("G53", self.some("G0", "G1"), *axes, *self.feed())
        else:
            self.say(self.some("G28", "G30", "G28.1", "G30.1"))
            self.say(self.some("G28", "G30"), *self.axes())

    def tools(self) -> None:
        """Tool changes and lengths."""
        tool = TOOLS[self.rng.integers(len(TOOLS))]
        kind = self.rng.integers(6)
        if kind == 0 and not self.writes_tools:
            self.to_relative(False)
            self.say("G53", "G0", *(self.word(name, self.number()) for name in self.names))
            self.say(f"T{tool}", "M6")
            self.say("G43")
        elif kind == 1:
            self.say("G43", f"H{tool}")
        elif kind == 2:
            self.say("G43.1", *(self.word(name, self.number(5.0)) for name in "XYZ"[int(self.rng.integers(3)) :]))
        elif kind == 3:
            self.say("G43.2", f"H{tool}")
        elif kind == 4:
            self.say("G49")
        elif self.writes_tools:
            self.say(
                "G10",
                "L1",
                f"P{tool}",
                *(self.word(name, self.number(30.0)) for name in "XYZ"[int(self.rng.integers(3)) :]),
            )
            self.say("G43", f"H{tool}")

    def cycle(self) -> None:
        """Canned cycles, several holes."""
        if self.inverse:
            return
        first, second, along, *_ = PLANES[self.plane]
        code = int(
            self.rng.choice([73, 81, 82, 83, 85, 86, 89] + [74, 84] * (self.plane == "G17"))
        )  # LinuxCNC taps there
        self.say(self.some("G98", "G99"), *(["S500", "M4" if code == 74 else "M3"] if code in (74, 84, 86) else []))
        depth = -abs(self.number(5.0)) - 0.1
        words = [f"{along}{depth:.3f}", f"R{abs(self.number(3.0)):.3f}"]
        if code in (73, 83):
            words.append(f"Q{abs(depth) * self.rng.uniform(0.2, 1.5):.3f}7")  # no share of the depth
        elif code not in (81, 85):
            words.append(f"P{self.rng.uniform(0.1, 2.0):.2f}")
        if self.chance(0.3) and code != 74:
            words.append(f"L{self.rng.integers(1, 4)}")
        self.say(f"G{code}", self.word(first, self.number()), self.word(second, self.number()), *words)
        for _ in range(int(self.rng.integers(0, 3))):
            more = [self.word(self.some(first, second), self.number())]
            if self.chance(0.2):
                more.append(f"R{abs(self.number(3.0)):.3f}")
            self.say(*more)
        self.say("G80")

    def numbers(self) -> None:
        """Parameters and expressions."""
        k = int(self.rng.integers(31, 60))
        a, b = round(float(self.rng.normal()) * 5, 2), round(float(self.rng.uniform(0.5, 5)), 2)
        formula = self.some(
            f"[{a}+{b}*2]", f"[{a}-{b}/3]", f"[{a}**2]", f"[-{b}**2]", f"[{a} MOD {b}]", f"SQRT[{b}]", f"ABS[{a}]",
            f"FIX[{a}]", f"FUP[{a}]", f"ROUND[{a}]", f"[SIN[{a}]*10]", f"[COS[{a}]*10]", f"TAN[{a}]", f"ATAN[{a}]/[{b}]",
            f"ASIN[{b / 10}]", f"ACOS[{b / 10}]", f"EXP[{b}]", f"LN[{b}]", f"[[{a} GT {b}]*3]", f"[{a} EQ {a}]",
            f"[[{a} LT 0] OR [{b} GE 2]]", f"[[{a} LE 0] AND [{b} NE 2]]", f"[1 XOR [{a} LT 1]]", "[2**3**2]",
            "#5420", "#5221", "#5220", "#<_x>", "#5401", "[#5422*2]", "#<_metric>", "#<_absolute>", "#5211", "#5161",
            "EXISTS[#<_here>]", "#[5400+21]",
        )  # fmt: skip
        if self.chance(0.5):
            self.lines.append(f"#{k}={formula}")
            self.say("G1", f"{self.some('X', 'Y', 'Z')}#{k}", *self.feed())
        else:
            self.lines.append(f"#<{self.some('depth', '_Here')}{k}> = {formula} #{k}=[{b}]")
            self.say("G0", f"{self.some('X', 'Y', 'Z')}[#{k}*1.5]")

    def flow(self) -> None:
        """Conditions and loops."""
        k, n = self.label(), int(self.rng.integers(0, 4))
        a = round(float(self.rng.normal()), 2)
        kind = self.rng.integers(5)
        cut = f"G1 {self.some('X', 'Y', 'Z')}{self.number(5.0)} {' '.join(self.feed())}"
        other = f"G0 {self.some('X', 'Y', 'Z')}{self.number(5.0)}"
        if kind == 0:
            self.lines += [
                f"O{k} if [{a} GT 0]",
                cut,
                f"O{k} elseif [{a} GT -0.5]",
                other,
                f"O{k} else",
                "G4 P0.1",
                f"O{k} endif",
            ]
        elif kind == 1:
            body = [
                f"G0 X[#{k}*2]",
                f"O{k + 500} if [#{k} EQ 2]",
                f"O{k} {'continue' if self.has_do else self.some('break', 'continue')}",
                f"O{k + 500} endif",
                cut,
            ]
            self.lines += [f"#{k}=0", f"o{k} while [#{k} LT {n}]", f"#{k}=[#{k}+1]", *body, f"o{k} endwhile"]
        elif kind == 2:
            self.lines += [f"O{k} repeat [{n}]", cut, f"O{k} endrepeat"]
        elif kind == 3 and self.has_do:
            self.lines += [f"#{k}=0", f"O{k} do", other, f"#{k}=[#{k}+1]", f"O{k} while [#{k} LT {n}]"]
        else:
            self.lines.append(f"o<hole> call [{a}] [{self.number(5.0)}]")
            self.lines.append("G1 X#<_value> " + " ".join(self.feed()))

    def dwell(self) -> None:
        """Dwells, stops and switches."""
        self.say(
            self.some(
                "G4 P0.5", "G4 P2", "M3 S1000", "M5", "M8", "M9", "M0", "M1", "S500", "M48", "M62 P1", "M66 P0 L0"
            )
        )

    def saved(self) -> None:
        """Modes that are kept and brought back."""
        if self.inverse:
            return
        self.lines += ["M70", self.some("G91", "G90", "G18", "G59"), f"G0 {' '.join(self.axes())}", "M72"]

    def polar(self) -> None:
        """Polar coordinates, once the tool is off the origin."""
        self.to_relative(False)
        self.plane = "G17"
        self.say("G17", "G0", self.word("X", self.number()), self.word("Y", abs(self.number()) + 1.0))
        self.say(
            self.some("G0", "G1"), self.some(f"@{self.number()}", f"^{self.number(90.0)}", "@10 ^30"), *self.feed()
        )

    def size(self, least: float, most: float) -> float:
        """A length in mm, in the unit in force."""
        return round(float(self.rng.uniform(least, most)) / (25.4 if self.inch else 1.0), 3 + self.inch)

    def beside(self) -> None:
        """Cutter compensation: an entry, lines and arcs with corners to both sides, and the way out."""
        self.plane = self.some("G17", "G17", "G18")
        first, second, along, i, j = PLANES[self.plane]
        self.to_relative(True)
        self.say(self.plane, "G1", *self.feed(), self.word(along, self.number(2.0)))
        side = self.some("G41", "G42")
        self.say(f"{side} D{self.some('1', '2')}" if self.chance(0.3) else f"{side}.1 D{self.size(0.5, 6.0)}")
        heading = float(self.rng.uniform(0.0, 2.0 * np.pi))

        def words(step: complex) -> list[str]:
            return [f"{first}{step.real:.7f}", f"{second}{step.imag:.7f}"]

        self.say(self.some("G0", "G1", "G1"), *words(self.size(9.0, 20.0) * np.exp(1j * heading)), *self.feed())
        straight = True
        for _ in range(int(self.rng.integers(1, 8))):
            heading += float(self.rng.uniform(-1.9, 1.9)) * bool(self.rng.random() < 0.8)
            rise = [self.word(along, self.number(2.0))] if self.chance(0.2) else []
            if self.chance(0.1):
                self.say("G1", self.word(along, self.number(2.0)), *self.feed())
            if self.chance(0.35):
                turn, radius = float(self.rng.uniform(0.5, 4.0)) * (1 if self.chance(0.5) else -1), self.size(6.0, 20.0)
                centre = 1j * np.copysign(radius, turn) * np.exp(1j * heading)
                step = centre - centre * np.exp(1j * turn)
                middle = words(centre)
                middle = [i + middle[0].removeprefix(first), j + middle[1].removeprefix(second)]
                self.say("G3" if turn > 0 else "G2", *words(step), *middle, *rise, *self.feed())
                heading += turn
                straight = False
            else:
                straight = True
                code = self.some("G0", "G1", "G1", "G1")
                self.say(code, *words(self.size(8.0, 25.0) * np.exp(1j * heading)), *rise, *self.feed())
        if self.chance(0.5):
            self.say("G40")
            if self.chance(0.3) and not self.writes_tools and straight:  # behind an arc the interpreter alone is lost
                self.say(f"T{TOOLS[self.rng.integers(len(TOOLS))]}", "M6")
                self.say("G0", self.word(along, self.number(5.0)))
            self.say("G1", *words(self.size(9.0, 20.0) * np.exp(1j * heading)), *self.feed())
        else:
            self.say("G40", "G0", *words(self.size(9.0, 20.0) * np.exp(1j * heading)))

    def spline(self) -> None:
        """G5, G5.1, or a NURBS."""
        if self.inverse:
            return
        self.plane = "G17"
        self.say("G17", "G0", self.word("X", self.number()), self.word("Y", self.number()))

        def pair(names: str) -> list[str]:
            return [f"{name}{self.number(15.0)}" for name in names]

        kind = self.rng.integers(3)
        if kind == 0:
            self.say("G5", *pair("XYIJPQ"))
            if self.chance(0.4):
                self.say("G5", *pair("XYPQ"))
        elif kind == 1:
            self.say("G5.1", *pair("XYIJ"))
        else:
            self.to_relative(False)
            weights = [f"P{self.rng.uniform(0.5, 2.0):.2f}" for _ in range(int(self.rng.integers(3, 7)))]
            self.say("G5.2", *pair("XY"), weights[0], f"L{self.rng.integers(3, 5)}")
            for weight in weights[1:]:
                self.say(*pair("XY"), weight)
            self.say("G5.3")

    def thread(self) -> None:
        """Threads, and tapping with a reversed spindle."""
        if self.inverse:
            return
        self.to_relative(True)
        self.say("M3", f"S{self.rng.integers(50, 900)}")
        kind = self.rng.integers(3)
        if kind == 0:
            self.say("G33", self.word("Z", self.number()), f"K{self.size(0.2, 3.0)}")
            if self.chance(0.4):
                self.say(self.word("X", self.number(3.0)), self.word("Z", self.number()), f"K{self.size(0.2, 3.0)}")
        elif kind == 1:
            self.say(
                "G33.1", self.word("Z", self.number()), f"K{self.size(0.2, 3.0)}", *self.some("", "I2", "I1").split()
            )
        else:
            self.plane = "G18"
            self.say("G18")
            peak = self.size(0.5, 3.0) * (1 if self.chance(0.5) else -1)
            words = [f"P{self.size(0.5, 3.0)}", f"Z{-self.size(20.0, 40.0)}", f"I{peak}", f"J{self.size(0.2, 0.5)}"]
            words += [f"K{self.size(0.8, 2.0)}", *self.some("", "R1.5", "R2").split(), *self.some("", "Q29.5").split()]
            words += [
                *self.some("", "H2").split(),
                *self.some("", f"E{self.size(1.0, 3.0)} L{self.rng.integers(0, 4)}").split(),
            ]
            self.say("G76", *words)

    def per_turn(self) -> None:
        """Feed per turn of the spindle."""
        if self.inverse:
            return
        self.say("M3", f"S{self.rng.integers(50, 900)}")
        self.say("G95", f"F{self.size(0.05, 0.5)}")
        self.line()
        self.say("G94", self.word("F", round(float(self.rng.uniform(1.0, 900.0)), 1)))

    def diameter(self) -> None:
        """X as a diameter."""
        self.say("G7")
        self.line()
        self.rapid()
        self.say("G8")

    def blank(self) -> None:
        """What is no block."""
        self.lines.append(self.some("", "(only a comment)", "; another", "/G0 X99", "   "))

    # ------------------------------------------------------------ what may be wrong

    def doubtful(self) -> None:
        """A line that one would not write, and that the readers have to agree on."""
        if self.chance(0.05):
            self.say(f"G2 X{self.number()} R0.1")
        else:
            self.say(self.some(*DOUBTFUL))

    def text(self) -> str:
        """The program."""
        self.lines += ["o<hole> sub", "G0 Z[#1*2]", "#3=[#1+#2]", "o<hole> endsub [#3]"]
        self.lines += ["G21 G90 G17 G94", "F600"]
        acts: list[tuple[float, Callable[[], None]]] = [
            (5, self.line), (2, self.rapid), (3, self.arc), (2, self.arc_by_radius), (1, self.arc_absolute), (3, self.modes),
            (2, self.offsets), (1.5, self.tools), (1.5, self.cycle), (2, self.numbers), (1.5, self.flow), (1, self.dwell),
            (0.4, self.saved), (0.5, self.polar), (0.7, self.blank), (1, self.beside), (1, self.spline), (0.8, self.thread),
            (0.4, self.per_turn), (0.4, self.diameter),
        ]  # fmt: skip
        weights = np.array([weight for weight, _ in acts]) / sum(weight for weight, _ in acts)
        count = int(self.rng.integers(8, 40))
        wrong = int(self.rng.integers(count)) if self.chance(_FAULTY) else -1
        for k in range(count):
            if k == wrong:
                self.doubtful()
            acts[int(self.rng.choice(len(acts), p=weights))][1]()
        self.lines += [self.some("M2", "M30", "%"), "this is not read"]
        head = "%\n" if self.lines[-2] == "%" else ""
        return head + "\n".join(self.lines) + "\n"


def random_program(seed: int) -> str:
    """The text of the program of a seed."""
    return RandomProgram(seed).text()

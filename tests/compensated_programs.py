"""Random programs with cutter compensation, and what LinuxCNC's interpreter makes of a program."""

import math
import os
import re
import shutil
import subprocess

import numpy as np

from planner.programs.reading.program import ARC, LINE, RAPID, Program

CALL = re.compile(r"(STRAIGHT_TRAVERSE|STRAIGHT_FEED|ARC_FEED|SET_FEED_RATE|SELECT_PLANE|USE_LENGTH_UNITS)\((.*)\)")
NORMALS = {"CANON_PLANE_XY": 2, "CANON_PLANE_XZ": 1, "CANON_PLANE_YZ": 0}
TOOLS_MM = "T1 P1 Z0 D2 ;end mill\nT2 P2 Z0 D-3 ;smaller than planned\nT3 P3 Z0 D1.6 Q2 ;lathe tool\n"
TURNS = (0.0, 0.03, -0.03, math.pi / 2, -math.pi / 2, math.pi)
HAS_LINUXCNC = shutil.which("rs274") is not None


class Draw:
    """Draws one program: lines, arcs, helices, rapids and moves along the normal beside which a tool goes."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.plane = "G18" if self.rng.random() < 0.4 else "G17"
        self.names = ("ZXY", "KI") if self.plane == "G18" else ("XYZ", "IJ")
        self.relative = self.rng.random() < 0.3
        self.inch = self.rng.random() < 0.2
        self.at = np.zeros(2)
        self.lines = [f"{self.plane} G90 G94 F300", "T1 M6", "G0 X0 Y0 Z0", "G20" if self.inch else "G21"]
        self.lines += ["F300", "G91" if self.relative else "G90"]

    def program(self) -> str:
        for _ in range(self.rng.integers(1, 3)):
            tool = self.tool()
            self.lines.append(tool)
            heading = self.rng.uniform(0, math.tau)
            for k in range(self.rng.integers(2, 9)):
                step = self.rng.uniform(2, 14) * np.array([math.cos(heading), math.sin(heading)])
                straight = k == 0 and ("L" in tool or "D3" in tool)  # a lathe tool begins with a line
                self.move(np.round(step, 3), 0.0 if straight else self.rng.random())
                heading += self.rng.choice([*TURNS, self.rng.uniform(-1, 1), self.rng.uniform(-3, 3)])
            self.lines.append("G40")
            if self.rng.random() < 0.9:
                self.lines.append(f"G{self.rng.integers(2)} {self.end(np.round(self.rng.uniform(-9, 9, 2), 3))}")
        return "\n".join([*self.lines, "M2", ""])

    def tool(self) -> str:
        diameter = self.length(2 * self.rng.choice([0.5, 1.0, 1.5, 2.0]))
        choices = ["G41", "G42 D1", "G41 D2", f"G41.1 D{diameter}", f"G42.1 D{diameter}", f"G42.1 D-{diameter}"]
        if self.plane == "G18":
            choices += [f"G41.1 D{diameter} L{self.rng.integers(1, 10)}", "G42 D3"]
        return str(self.rng.choice(choices))

    def length(self, value: float) -> str:
        return f"{value / 25.4:.7f}" if self.inch else f"{value:.5f}"

    def end(self, step: np.ndarray) -> str:
        self.at = self.at + step
        to = step if self.relative else self.at
        return f"{self.names[0][0]}{self.length(to[0])} {self.names[0][1]}{self.length(to[1])}"

    def height(self, chance: float) -> str:
        return f" {self.names[0][2]}{self.length(self.rng.uniform(-3, 3))}" if self.rng.random() < chance else ""

    def move(self, step: np.ndarray, kind: float) -> None:
        rng, (first, second) = self.rng, self.names[1]
        if kind < 0.5:
            block = f"G1 {self.end(step)}{self.height(0.2)}"
        elif kind < 0.6:
            block = f"G0 {self.end(step)}"
        elif kind < 0.68:
            block = f"G{rng.integers(2)}{self.height(1.0)}"
        elif kind < 0.86:
            radius = 0.5 * math.hypot(*step) * rng.choice([1.0001, 1.2, 2.0, 4.0])
            sign = "-" if rng.random() < 0.15 else ""
            block = f"G{rng.integers(2, 4)} {self.end(step)} R{sign}{self.length(radius)}"
        elif kind < 0.95:
            angle, sweep = rng.uniform(0, math.tau), rng.uniform(-5.5, 5.5)
            centre = np.round(rng.uniform(1.2, 8) * np.array([math.cos(angle), math.sin(angle)]), 5)
            turned = complex(*-centre) * complex(math.cos(sweep), math.sin(sweep))
            to = self.end(np.round(centre + np.array([turned.real, turned.imag]), 5))
            block = f"G{3 if sweep > 0 else 2} {to} {first}{self.length(centre[0])} {second}{self.length(centre[1])}"
            block += self.height(0.3) + (" P2" if rng.random() < 0.1 else "")
        else:
            block = f"G3 {first}{self.length(rng.uniform(1.5, 5))}"
        self.lines.append(block)


def canonical(text: str, folder):
    """LinuxCNC's moves in mm: kind, numbers, normal of the plane and feed of each; or None where it refuses."""
    (folder / "part.ngc").write_text(text)
    inch = re.sub(r"([DZ])(-?[\d.]+)", lambda m: f"{m[1]}{float(m[2]) / 25.4:.12f}", TOOLS_MM)
    (folder / "inch.tbl").write_text(inch)  # of a machine in inch
    (folder / "var").write_text("")
    command = ["rs274", "-g", "-n", "2", "-t", "inch.tbl", "-v", "var", "part.ngc"]
    own = {**os.environ, "HOME": str(folder)}  # a file there holds the tools, for all that run at once
    run = subprocess.run(
        command, cwd=folder, env=own, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, check=False
    )
    if run.returncode:
        return None
    moves, normal, feed, unit = [], 2, 0.0, 1.0
    for name, values in ((m[1], m[2].split(",")) for m in CALL.finditer(run.stdout)):
        if name == "SELECT_PLANE":
            normal = NORMALS[values[0]]
        elif name == "USE_LENGTH_UNITS":
            unit = 1.0 if values[0] == "CANON_UNITS_MM" else 25.4
        elif name == "SET_FEED_RATE":
            feed = float(values[0])
        else:
            numbers = np.array([float(x) for x in values])
            numbers[[0, 1, 2, 3, 5] if name == "ARC_FEED" else [0, 1, 2]] *= unit
            moves.append((name, numbers, normal, feed * unit))
    return moves


def difference(ours: Program, theirs, tolerance: float) -> str:
    """Where the moves are not the same, to a tolerance in mm; those of no length, which LinuxCNC keeps, do not count."""
    at, k = np.zeros(3), 0
    for name, values, normal, feed in theirs:
        found = expected(ours, k, name) if k < len(ours) else None
        numbers = values[[0, 1, 2, 3, 5]] if name == "ARC_FEED" else values[:3]
        if found is None or np.abs(numbers - found).max() > tolerance:
            if name != "ARC_FEED" and np.abs(numbers - at).max() <= tolerance:
                continue
            return f"move {k}: {name} {values} {found}"
        if ours.kind[k] != RAPID and abs(60.0 * ours.feed[k] - feed) > 1e-3 * max(feed, 1.0):
            return f"move {k}: F{60.0 * ours.feed[k]} and {feed}"
        if name == "ARC_FEED":
            turns = math.copysign(math.ceil(abs(ours.sweep[k]) / math.tau - 1e-7), ours.sweep[k])
            if normal != ours.normal[k] or turns != values[4]:
                return f"move {k}: {name} {values}, sweep {ours.sweep[k]} about axis {ours.normal[k]}"
        at = ours.end[k, :3]
        k += 1
    return "" if k == len(ours) else f"{len(ours) - k} moves more"


def expected(ours: Program, k: int, name: str):
    """The numbers of a move as LinuxCNC gives them; None where it is of another kind."""
    if ours.kind[k] != {"STRAIGHT_TRAVERSE": RAPID, "STRAIGHT_FEED": LINE, "ARC_FEED": ARC}[name]:
        return None
    if name != "ARC_FEED":
        return ours.end[k, :3]
    normal = int(ours.normal[k])
    i, j = (normal + 1) % 3, (normal + 2) % 3
    return np.array([ours.end[k, i], ours.end[k, j], ours.centre[k, i], ours.centre[k, j], ours.end[k, normal]])

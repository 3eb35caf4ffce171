"""Where the coordinates of a program lie on the machine: coordinate systems, G92, tool lengths, and homes.

A point of the machine is the number in a block, plus the origin of the active system (G54 to G59.3), plus the offset of
G92 or G52, plus that of the tool (G43, G43.1, G43.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from planner.geometry.curve import AXES
from planner.machine.program_setup import SYSTEMS, ProgramSetup, vector
from planner.programs.reading.setup import Tool
from planner.types import FloatArray

SYSTEM_CODES = (540, 550, 560, 570, 580, 590, 591, 592, 593)


def origin() -> FloatArray:
    """0 in every axis, (9,)."""
    return np.zeros(len(AXES))


@dataclass
class Offsets:
    """The offsets in force, of every axis in the order of ``AXES``, mm and degrees, and the tools.

    ``given`` are the tools of a table, None where there is none: then a tool that the program gives no length has 0.
    """

    given: Mapping[int, Tool] | None = None
    written: dict[int, FloatArray] = field(default_factory=dict)  # by G10 L1
    radii: dict[int, float] = field(default_factory=dict)  # by G10 L1
    systems: FloatArray = field(default_factory=lambda: np.zeros((len(SYSTEM_CODES), len(AXES))))
    active: int = 0
    shift: FloatArray = field(default_factory=origin)  # of G92
    kept_shift: FloatArray = field(default_factory=origin)  # that G92.3 brings back
    length: FloatArray = field(default_factory=origin)
    home: dict[int, FloatArray] = field(default_factory=lambda: {280: origin(), 300: origin()})
    stated: frozenset[int] = frozenset()  # codes of systems and homes that the machine file gives
    tool_change: Mapping[int, float] | None = None  # where M6 leads, by the index of the axis
    assumed: dict[str, int] = field(default_factory=dict)  # what was taken for 0, with the first line

    @classmethod
    def of(cls, setup: ProgramSetup, tools: Mapping[int, Tool] | None) -> Offsets:
        """What a machine file says, before the first block."""
        offsets = cls(tools)
        stated = set()
        homes = ((280, setup.home), (300, setup.second_home))
        systems = zip(SYSTEM_CODES, offsets.systems, (setup.offsets.get(name) for name in SYSTEMS), strict=True)
        for code, row, point in (*((code, offsets.home[code], point) for code, point in homes), *systems):
            if point is not None:
                row[:] = vector(point, AXES)
                stated.add(code)
        offsets.stated = frozenset(stated)
        if setup.tool_change is not None:
            offsets.tool_change = {AXES.index(axis): at for axis, at in setup.tool_change.items()}
        return offsets

    def is_known(self, code: int) -> bool:
        """Whether a coordinate system or a home is said, by the machine file or the program."""
        point = self.home[code] if code in self.home else self.systems[SYSTEM_CODES.index(code)]
        return code in self.stated or bool(point.any())

    @property
    def total(self) -> FloatArray:
        """From the numbers of the program to the machine, (9,), mm and degrees."""
        return np.asarray(self.systems[self.active] + self.shift + self.length)

    def of_tool(self, number: int) -> FloatArray | None:
        """Offset of a tool, (9,), mm and degrees; None where a table is given and lacks it."""
        if number in self.written:
            return self.written[number]
        if number == 0 or self.given is None:
            return origin()
        if number not in self.given:
            return None
        found = origin()
        found[: len(self.given[number].offset)] = self.given[number].offset
        return found

    def to_write(self, number: int) -> FloatArray:
        """Offset of a tool that G10 L1 changes in some axes, (9,); of the others it is that of the table."""
        if number not in self.written:
            found = self.of_tool(number)
            self.written[number] = origin() if found is None else found.copy()
        return self.written[number]

    def radius_and_orientation(self, number: int) -> tuple[float, int] | None:
        """Radius of a tool, mm, and its orientation; None where neither a table nor the program says them."""
        tool = (self.given or {}).get(number)
        orientation = 0 if tool is None else tool.orientation
        if number in self.radii:
            return self.radii[number], orientation
        return None if tool is None else (0.5 * tool.diameter, orientation)

    def assume(self, what: str, line: int) -> None:
        """Note that something the program does not say was taken for 0."""
        self.assumed.setdefault(what, line)

    def notes(self) -> list[str]:
        """What was taken for 0, in one sentence."""
        if not self.assumed:
            return []
        said = ", ".join(f"{what} (line {line})" for what, line in self.assumed.items())
        return [f"taken for 0, since the program does not say: {said}"]

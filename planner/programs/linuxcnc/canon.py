"""What LinuxCNC's interpreter makes of a program, written to a file: run by LinuxCNC's own Python, beside it.

    python3 canon.py part.ngc folder

In the folder are ``tool.tbl`` and ``numbers.var``, and this writes ``calls.bin``, rows of doubles as ``COLUMNS`` says, and
``end.json``: the message where the interpreter refuses the program, and the line it had reached.  Positions are those of
the machine in mm and degrees, with every offset in them; feeds are in mm a minute, or as the program has them.

Needs nothing but Python's own modules and those of LinuxCNC.
"""

from __future__ import annotations

import array
import ctypes
import json
import math
import sys
from pathlib import Path
from typing import Any

COLUMNS = (
    "kind", "line", "feed", "x", "y", "z", "a", "b", "c", "u", "v", "w", "first_centre", "second_centre", "turns", "plane"
)  # fmt: skip
RAPID, LINE, ARC, PROBE, TAP, DWELL, TOOL, MARK, STATE, LOST, PITCH = range(11)
LOST_UNITS, LOST_PLACE = 1, 2  # what the interpreter would have to ask of a machine
MARKED, PITCH_FOLLOWS = "feedplan-mark", "feedplan-pitch"
MAX_ROWS = 20_000_000  # a loop that never ends would fill the disk
_INCH = 25.4
_LINEAR = (0, 1, 2, 6, 7, 8)
_ABSOLUTE = 900
_APART = 1e-6  # mm
_INSIDE = "this program makes more calls than are read here; a loop may never end"


def _scaled(numbers: tuple[float, ...]) -> list[float]:
    """Inches to mm, where they are lengths."""
    out = list(numbers)
    for k in _LINEAR:
        out[k] *= _INCH
    return out


class Canon:
    """Receives the canonical calls of the interpreter; its callbacks count in inches."""

    def __init__(self, folder: Path, tools: list[tuple[float, ...]]) -> None:
        self.parameter_file = str(folder / "numbers.var")
        self.rows = array.array("d")
        self.tools = tools
        self.loaded = 0
        self.line, self.feed, self.plane = 0, 0.0, 1
        self.origin, self.shift, self.tool = [0.0] * 9, [0.0] * 9, [0.0] * 9
        self.angle = 0.0
        self.at = [0.0] * 9
        self.units, self.distances, self.stale = 0, 0, False
        self.told: tuple[float, ...] = (
            0.0,
        ) * 9  # numbers of the last straight move, which the interpreter asks for at a tool change
        self.off = [0.0] * 9  # how far from there the machine is, mm and degrees
        self.named = ""
        self.dwell_kind = DWELL

    def __getattr__(self, name: str) -> Any:
        """Answer every call that moves nothing."""
        if name.startswith("__") or name in ("move_batch", "use_move_batches"):
            raise AttributeError(name)
        return lambda *_: None

    def _row(self, kind: int, point: list[float], arc: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
        self.rows.extend((kind, self.line, self.feed, *point, *arc, self.plane))
        if len(self.rows) > MAX_ROWS * len(COLUMNS):
            raise RuntimeError(_INSIDE)

    def _on_machine(self, numbers: tuple[float, ...]) -> list[float]:
        point = [number + shift for number, shift in zip(_scaled(numbers), self.shift, strict=True)]
        if self.angle:
            cos, sin = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
            point[:2] = point[0] * cos - point[1] * sin, point[0] * sin + point[1] * cos
        return [p + o + t for p, o, t in zip(point, self.origin, self.tool, strict=True)]

    def _go(self, kind: int, numbers: tuple[float, ...]) -> None:
        self._find_off()
        self.told = numbers
        self.at = [p + d for p, d in zip(self._on_machine(numbers), self.off, strict=True)]
        self._row(kind, self.at)

    def _find_off(self) -> None:
        """After a tool change the interpreter takes the machine to be where the last straight move ended, in the offsets of
        now, and counts from there: an axis in which it is not is off, until a word says where it goes.
        """
        if not any(self.off):
            return
        if "~" in self.named:
            self._row(LOST, [float(LOST_PLACE), *[0.0] * 8])
        relative = "-" in self.named or ("+" not in self.named and self.distances != _ABSOLUTE)
        self.off = [0.0 if not relative and a in self.named else d for a, d in zip("XYZABCUVW", self.off, strict=True)]

    def next_line(self, state: Any) -> None:
        """Note the line that is run, and what was in force after the one before."""
        self.line = state.sequence_number
        modes = state.feed_mode, state.path_mode, state.speed, state.motion_mode, state.distance_mode, state.units
        self._row(STATE, [*modes, 0.0, 0.0, 0.0])
        self.stale |= self.units not in (0, state.units) and any(self.tool)
        self.units, self.distances = state.units, state.distance_mode

    def comment(self, text: str) -> None:
        """A mark: the file and the line that are run next, or that the next dwell stands for the pitch of a thread."""
        if text.strip() == PITCH_FOLLOWS:
            self.dwell_kind = PITCH
        words = text.split()
        if len(words) == 4 and words[0] == MARKED:
            self.named = words[3]
            self._row(MARK, [float(words[1]), float(words[2]), *[0.0] * 7])

    def straight_traverse(self, *numbers: float) -> None:
        """G0."""
        self._go(RAPID, numbers)

    def straight_feed(self, *numbers: float) -> None:
        """G1."""
        self._go(LINE, numbers)

    def straight_probe(self, *numbers: float) -> None:
        """G38."""
        self._go(PROBE, numbers)

    def rigid_tap(self, x: float, y: float, z: float) -> None:
        """G33.1: there and back; the axes beside X, Y and Z stay."""
        rest = [p - o - s - t for p, o, s, t in zip(self.at, self.origin, self.shift, self.tool, strict=True)]
        numbers = [x, y, z, *(value / (_INCH if k in _LINEAR else 1.0) for k, value in enumerate(rest) if k > 2)]
        back = self.at
        self._go(TAP, tuple(numbers))
        self.at = back
        self._row(TAP, back)

    def arc_feed(self, first: float, second: float, centre1: float, centre2: float, turns: int, along: float,
                 *rest: float) -> None:  # fmt: skip
        """G2 and G3: in the XY plane X and Y come first, in XZ Z and X, in YZ Y and Z."""
        x, y = {1: (0, 1), 3: (2, 0), 2: (1, 2)}[self.plane]
        end, centre = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        end[x], end[y], end[3 - x - y] = first, second, along
        centre[x], centre[y] = centre1, centre2
        middle = [p + d for p, d in zip(self._on_machine((*centre, *rest)), self.off, strict=True)]
        self._find_off()
        self.at = [p + d for p, d in zip(self._on_machine((*end, *rest)), self.off, strict=True)]
        self._row(ARC, self.at, (middle[x], middle[y], float(turns)))

    def dwell(self, seconds: float) -> None:
        """G4, and the dwells of cycles; or the pitch of a thread."""
        self._row(self.dwell_kind, [seconds, *[0.0] * 8])
        self.dwell_kind = DWELL

    def set_feed_rate(self, feed: float) -> None:
        """F, in the program's own terms but inches."""
        self.feed = feed * _INCH

    def set_plane(self, plane: int) -> None:
        """G17, G18, G19."""
        self.plane = plane

    def set_g5x_offset(self, _system: int, *numbers: float) -> None:
        """G54 to G59.3 and G10."""
        self.origin = _scaled(numbers)

    def set_g92_offset(self, *numbers: float) -> None:
        """G92 and G52."""
        self.shift = _scaled(numbers)

    def set_xy_rotation(self, angle: float) -> None:
        """G10 L2 R."""
        self.angle = angle

    def tool_offset(self, *numbers: float) -> None:
        """G43 and its kin: it keeps the one in force in the units of then, and works out from it where the tool is."""
        if self.stale:
            self._row(LOST, [float(LOST_UNITS), *[0.0] * 8])
        self.stale = False
        self.tool = _scaled(numbers)

    def change_tool(self, index: int) -> None:
        """M6, by the place of the tool in the table."""
        self.loaded = index
        self._row(TOOL, [self.tools[index][0], *[0.0] * 8])

    def get_tool(self, index: int) -> tuple[float, ...]:
        """The tool at a place of the table; at the place 0 the one in the spindle."""
        if index == 0:  # asked at every tool change
            self.off = [at - there for at, there in zip(self.at, self._on_machine(self.told), strict=True)]
            self.off = [d if abs(d) > _APART else 0.0 for d in self.off]
        place = self.loaded if index == 0 else index
        if 0 <= place < len(self.tools):
            return (int(self.tools[place][0]), *self.tools[place][1:13], int(self.tools[place][13]))
        return (-1, *[0.0] * 12, 0)

    def get_axis_mask(self) -> int:
        """X Y Z A B C U V W."""
        return 511

    def get_block_delete(self) -> int:
        """Blocks with / are passed over."""
        return 1

    def get_external_angular_units(self) -> float:
        """Degrees."""
        return 1.0

    def get_external_length_units(self) -> float:
        """Of a machine in mm."""
        return 1.0

    def check_abort(self) -> int:
        """Go on: the parent ends what takes too long."""
        return 0


def _load_tools(table: Path) -> None:
    """Give the interpreter its tool table, which it keeps in a file in HOME."""
    library = ctypes.CDLL("libtooldata.so.0")
    library["_Z17tool_mmap_creatorPK13EMC_TOOL_STATi"](None, 0)
    for name, further in (("_Z13tooldata_loadPKcPPc", (None,)), ("_Z13tooldata_loadPKc", ())):
        try:
            load = library[name]
        except AttributeError:
            continue
        load(str(table).encode(), *further)
        return
    raise RuntimeError("this LinuxCNC has no tooldata_load")


def main() -> int:
    """Interpret the program."""
    import gcode

    folder = Path(sys.argv[2])
    tools = [tuple(tool) for tool in json.loads((folder / "tools.json").read_text())]
    _load_tools(folder / "tool.tbl")
    canon = Canon(folder, [(0, *[0.0] * 13), *tools])
    message = ""
    try:
        result, _ = gcode.parse(sys.argv[1], canon, "G21", "G64")
        if result > gcode.MIN_ERROR:
            message = gcode.strerror(result) or f"error {result}"
    except RuntimeError as problem:  # raised in a callback, and again by the module without its words
        message = _INSIDE if len(canon.rows) > MAX_ROWS * len(COLUMNS) else str(problem)
    with open(folder / "calls.bin", "wb") as file:
        canon.rows.tofile(file)
    (folder / "end.json").write_text(json.dumps({"message": message}))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The reader of part programs against LinuxCNC's own interpreter: its sample programs, and random ones.

    python -m benchmarks.dialect [--output results.json] [--random 3000] [folder or file ...]

Without files: the programs of ncfiles that the package linuxcnc-uspace installs.  Of those that LinuxCNC reads it tells how
many are read here, and of these how many moves agree: order, lines, kinds, end points, centres and sweeps of arcs within
1 um, and feeds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from planner import InputError, Program, read_program
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.linuxcnc.interpreter import HOW_TO_INSTALL, is_installed
from planner.programs.reading.program import ARC
from planner.programs.reading.setup import Tool

SAMPLES = Path("/usr/share/linuxcnc/ncfiles")
WITHIN_MM = 1e-3
FEED_SHARE = 1e-9
AIM = 0.95
TOOLS = {number: Tool((0.0, 0.0, 10.0 * number), 2.0 + number) for number in (*range(1, 100), 99999)}


@dataclass(frozen=True)
class Agreement:
    """What both readers make of a program: the message where one refuses it, the moves, and the first difference."""

    program: str
    linuxcnc: str = ""
    ours: str = ""
    moves: int = 0
    difference: str = ""

    @property
    def same(self) -> bool:
        """Whether both refuse the program, or both make the same moves of it."""
        return bool(self.linuxcnc) == bool(self.ours) and not self.difference


def compare(path: Path, tools: Mapping[int, Tool]) -> Agreement:
    """Read a program by both."""
    read: list[Program | None] = []
    messages = []
    for reader in (
        lambda: read_with_linuxcnc(path, tools=tools, from_zero=True),
        lambda: read_program(path, tools=tools, start=(0.0, 0.0, 0.0)),
    ):
        try:
            read.append(reader())
            messages.append("")
        except InputError as problem:
            read.append(None)
            messages.append(str(problem))
    theirs, ours = read
    if theirs is None or ours is None:
        return Agreement(path.name, *messages)
    return Agreement(path.name, moves=len(theirs), difference=difference(theirs, ours))


def difference(theirs: Program, ours: Program) -> str:
    """The first thing that is not the same in two programs; empty where there is none."""
    count = min(len(theirs), len(ours))
    rows = slice(0, count)
    arc, at = theirs.kind[rows] == ARC, [theirs.start[rows, :3], theirs.end[rows, :3]]
    flat = np.eye(3)[theirs.normal[rows]] == 0.0
    radius, last = (np.linalg.norm(np.where(flat, point - theirs.centre[rows], 0.0), axis=1) for point in at)
    # Under G93 the feed is that of the length of an arc, which LinuxCNC counts at the radius of its start.
    off_by = WITHIN_MM + np.abs(last - radius) * np.abs(theirs.sweep[rows])
    share = np.where(arc, off_by / theirs.lengths[rows], FEED_SHARE)
    allowed = share * np.where(np.isinf(theirs.feed[rows]), 0.0, theirs.feed[rows])
    with np.errstate(invalid="ignore"):
        off = {
            "kind": theirs.kind[rows] != ours.kind[rows],
            "line": theirs.line[rows] != ours.line[rows],
            "end": (np.abs(theirs.end[rows] - ours.end[rows]) > WITHIN_MM).any(axis=1),
            "centre": arc & ~(np.abs(theirs.centre[rows] - ours.centre[rows]) <= WITHIN_MM).all(axis=1),
            "normal": arc & (theirs.normal[rows] != ours.normal[rows]),
            "sweep": arc & ~(np.abs(theirs.sweep[rows] - ours.sweep[rows]) * radius <= WITHIN_MM),
            "feed": ~np.isclose(theirs.feed[rows], ours.feed[rows], rtol=0.0, atol=allowed),
        }
    first = min((int(np.argmax(mask)) for mask in off.values() if mask.any()), default=count)
    if first < count:
        name = next(name for name, mask in off.items() if mask[first])
        said = [f"{getattr(program, name)[first]}" for program in (theirs, ours)]
        return f"move {first}, line {theirs.line[first]} ({ours.line[first]}): {name} {said[0]} there, {said[1]} here"
    if len(theirs) != len(ours):
        return f"{len(theirs)} moves there, {len(ours)} here; the first {count} agree"
    return ""


def programs_in(places: list[Path]) -> list[Path]:
    """Files, and those in folders."""
    found = [place if place.is_file() else sorted(place.rglob("*.ngc")) for place in places]
    return [path for item in found for path in (item if isinstance(item, list) else [item])]


def main() -> int:
    """Compare, print a table, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="*", type=Path, default=[SAMPLES])
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if not is_installed():
        print(f"LinuxCNC is not installed; {HOW_TO_INSTALL}")
        return 3
    began = process_time()
    found = [compare(path, TOOLS) for path in programs_in(options.places)]
    read = [one for one in found if not one.linuxcnc]
    ours = [one for one in read if not one.ours]
    same = [one for one in ours if one.same]
    table = Table("program", "not as LinuxCNC", box=SIMPLE)
    for one in found:
        if not one.same:
            table.add_row(
                one.program,
                one.difference or (f"refused: {one.ours}" if one.ours else f"read; LinuxCNC: {one.linuxcnc}"),
            )
    Console(width=200).print(table)
    summary = {
        "programs": len(found),
        "read_by_linuxcnc": len(read),
        "read_here": len(ours),
        "share_read": len(ours) / max(len(read), 1),
        "same": len(same),
        "moves_compared": sum(one.moves for one in same),
        "read_here_alone": sum(bool(one.linuxcnc) and not one.ours for one in found),
        "cpu_s": process_time() - began,
    }
    print(json.dumps(summary, indent=1))
    if options.output:
        options.output.write_text(json.dumps({**summary, "rows": [asdict(one) for one in found]}, indent=1) + "\n")
    return 0 if summary["share_read"] >= AIM and len(same) == len(ours) else 1


if __name__ == "__main__":
    sys.exit(main())

"""The reader of part programs against LinuxCNC's own interpreter: its sample programs, and random ones.

    python -m benchmarks.dialect [--output results.json] [folder or file ...]
    python -m benchmarks.dialect --random 3000

Without files: the programs of ncfiles that the package linuxcnc-uspace installs.  Of those that LinuxCNC reads it tells how
many are read here, and of these how many moves agree: order, lines, kinds, end points, centres and sweeps of arcs within
1 um, and feeds.  Of a spline LinuxCNC tells chords: their ends have to lie on it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from benchmarks.random_programs import random_program
from planner import InputError, Program, read_program
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.linuxcnc.interpreter import HOW_TO_INSTALL, is_installed
from planner.programs.reading.program import ARC, LINE, SPLINE, rows_of
from planner.programs.reading.setup import Tool

SAMPLES = Path("/usr/share/linuxcnc/ncfiles")
WITHIN_MM = 1e-3
FEED_SHARE = 1e-9
AIM = 0.95
_MAX_SAMPLES = 20_000  # of a curve
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


def with_chords_joined(theirs: Program, ours: Program) -> tuple[Program, Program]:
    """Both with the splines of ours that follow each other as a straight move, and their chords at LinuxCNC as one.

    Where the chords do not lie on the splines, in their order and to their end, or have other feeds or lines, the moves stay
    as they are, and so differ.
    """
    if ours.beziers is None:
        return theirs, ours
    spans: list[list[tuple[int, int]]] = [[], []]  # first and last row of every move
    row = at = 0
    while row < len(ours) and at < len(theirs):
        beyond = row + int(np.argmin(np.append(ours.kind[row:] == SPLINE, False)))
        chords = _chords_beside(theirs, at, ours, slice(row, beyond)) if beyond > row else 0
        if beyond > row and not chords:
            break
        moves = (max(chords, 1), max(beyond - row, 1))
        spans[0].append((at, at + moves[0] - 1))
        spans[1].append((row, row + moves[1] - 1))
        at, row = at + moves[0], row + moves[1]
    spans[0] += [(k, k) for k in range(at, len(theirs))]
    spans[1] += [(k, k) for k in range(row, len(ours))]
    joined = []
    for program, rows in zip((theirs, ours), spans, strict=True):
        first, last = np.array(rows, dtype=np.intp).reshape(-1, 2).T
        joined.append(replace(rows_of(program, last), start=program.start[first]))
    count = len(spans[1]) - (len(ours) - row)
    kind, line, feed = joined[1].kind.copy(), joined[1].line.copy(), joined[1].feed.copy()
    known = np.flatnonzero(kind[:count] == SPLINE)
    kind[known], line[known], feed[known] = LINE, joined[0].line[known], joined[0].feed[known]
    return joined[0], replace(joined[1], kind=kind, line=line, feed=feed)


def _chords_beside(theirs: Program, at: int, ours: Program, rows: slice) -> int:
    """How many straight moves of theirs, from ``at`` on, are the splines ``rows`` of ours; 0 where they are not."""
    curves = ours.beziers
    if curves is None:
        return 0
    curves = curves.taken(ours.curve[rows])
    # So many that the curve is straight between them, within a tenth of what is allowed.
    steps = curves.length / np.sqrt(0.8 * WITHIN_MM * np.maximum(curves.tightest, 1e-3))
    counts = np.clip(np.ceil(steps), 16, _MAX_SAMPLES).astype(np.intp)
    row = np.repeat(np.arange(len(curves)), counts)
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])
    points = curves.start[row] + curves.at(row, share * curves.length[row])[0]
    begin, step = points[:-1], np.diff(points, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    rest = np.cumsum(np.sqrt(square)[::-1])[::-1] - np.sqrt(square)  # behind every step
    passed = 0
    for k in range(at, len(theirs)):
        to = theirs.end[k, :3] - begin[passed:]
        along = np.clip((to * step[passed:]).sum(axis=1) / square[passed:], 0.0, 1.0)
        near = np.linalg.norm(to - along[:, None] * step[passed:], axis=1) <= WITHIN_MM
        if theirs.kind[k] != LINE or not near.any():
            return 0
        passed += int(np.argmax(near))
        of = rows.start + row[passed + 1]
        lines = ours.line[rows.start], ours.line[rows.stop - 1] + 1  # the last may be that of G5.3
        if not (lines[0] <= theirs.line[k] <= lines[1] and np.isclose(theirs.feed[k], ours.feed[of], rtol=FEED_SHARE)):
            return 0
        at_end = np.abs(theirs.end[k] - ours.end[rows.stop - 1]).max() <= WITHIN_MM and rest[passed] <= 10.0 * WITHIN_MM
        if at_end and not (k + 1 < len(theirs) and theirs.line[k + 1] == theirs.line[k]):  # chords of less than that
            return k + 1 - at
    return 0


def difference(theirs: Program, ours: Program) -> str:
    """The first thing that is not the same in two programs; empty where there is none."""
    theirs, ours = with_chords_joined(theirs, ours)
    count = min(len(theirs), len(ours))
    rows = slice(0, count)
    arc, at = theirs.kind[rows] == ARC, [theirs.start[rows, :3], theirs.end[rows, :3]]
    flat = np.eye(3)[theirs.normal[rows]] == 0.0
    radius, last = (np.linalg.norm(np.where(flat, point - theirs.centre[rows], 0.0), axis=1) for point in at)
    # Under G93 the feed is that of the length of an arc, which LinuxCNC counts at the radius of its start.
    off_by = WITHIN_MM + np.abs(last - radius) * np.abs(theirs.sweep[rows])
    share = np.where(arc, off_by / theirs.lengths[rows], FEED_SHARE)
    allowed = share * np.where(np.isinf(theirs.feed[rows]), 0.0, theirs.feed[rows])
    # LinuxCNC has a slowest feed under G93, 0.1 mm, inch or degree a minute.
    floors = np.array([0.1, 2.54]) / 60.0
    slowest = np.where(np.isclose(theirs.feed[rows, None], floors, rtol=1e-12), floors, 0.0).max(axis=1)
    with np.errstate(invalid="ignore"):
        off = {
            "kind": theirs.kind[rows] != ours.kind[rows],
            "line": theirs.line[rows] != ours.line[rows],
            "end": (np.abs(theirs.end[rows] - ours.end[rows]) > WITHIN_MM).any(axis=1),
            "centre": arc & ~(np.abs(theirs.centre[rows] - ours.centre[rows]) <= WITHIN_MM).all(axis=1),
            "normal": arc & (theirs.normal[rows] != ours.normal[rows]),
            "sweep": arc & ~(np.abs(theirs.sweep[rows] - ours.sweep[rows]) * radius <= WITHIN_MM),
            "feed": ~np.isclose(theirs.feed[rows], np.maximum(ours.feed[rows], slowest), rtol=0.0, atol=allowed),
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
    found = [[place] if place.is_file() else sorted(place.rglob("*.ngc")) for place in places]
    return [path for paths in found for path in paths]


def compare_random(seeds: Iterable[int], folder: Path) -> list[Agreement]:
    """Compare the random programs of some seeds, which are written into a folder."""
    out = []
    for seed in seeds:
        path = folder / f"random_{seed}.ngc"
        path.write_text(random_program(seed))
        out.append(compare(path, TOOLS))
    return out


def summary(found: list[Agreement]) -> dict[str, float]:
    """How many programs there are, who reads them, and how many agree."""
    read = [one for one in found if not one.linuxcnc]
    ours = [one for one in read if not one.ours]
    return {
        "programs": len(found),
        "read_by_linuxcnc": len(read),
        "read_here": len(ours),
        "share_read": len(ours) / max(len(read), 1),
        "same_moves": sum(one.same for one in ours),
        "moves_compared": sum(one.moves for one in ours),
        "refused_by_both": sum(one.same for one in found if one.linuxcnc),
        "read_here_alone": sum(not one.ours for one in found if one.linuxcnc),
    }


def main() -> int:
    """Compare, print a table, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="*", type=Path, default=[SAMPLES])
    parser.add_argument("--random", type=int, default=0, help="how many random programs to compare, and no files")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if not is_installed():
        print(f"LinuxCNC is not installed; {HOW_TO_INSTALL}")
        return 3
    if options.random:
        with tempfile.TemporaryDirectory() as folder:
            found = compare_random(range(options.random), Path(folder))
    else:
        found = [compare(path, TOOLS) for path in programs_in(options.places)]
    table = Table("program", "not as LinuxCNC", box=SIMPLE)
    for one in (one for one in found if not one.same):
        table.add_row(one.program, one.difference or f"{one.ours or one.linuxcnc}")
    facts = summary(found)
    console = Console(width=200)
    console.print(table)
    console.print("  ".join(f"{name} {value:.6g}" for name, value in facts.items()))
    if options.output:
        options.output.write_text(json.dumps({**facts, "rows": [asdict(one) for one in found]}, indent=1) + "\n")
    reached = facts["share_read"] >= (1.0 if options.random else AIM) and facts["same_moves"] == facts["read_here"]
    return 0 if reached and not (options.random and facts["read_here_alone"]) else 1


if __name__ == "__main__":
    sys.exit(main())

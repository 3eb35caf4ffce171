"""Path and feed as one problem against the path first: what must be reached, and random polygons.

    python -m benchmarks.joint [--output results.json] [--polygons 200] [--only NAME ...]

Machine: 250 mm/s, 1000 mm/s^2 and 20 000 mm/s^3 an axis, no chord error, F6000.  Every program is planned twice in one
process, with ``path="joint"`` and with ``path="separate"``; what was planned is checked, and the path's deviation measured.
The synthetic programs are compared with separate plans on six times the intervals, so that no gain is one of
the grid.  CPU is that of path, plan and check at the default density, joint over separate.  "Proven" is the
lower bound of the joint problem over the time of the joint plan, where the program has no splines.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.cases import drives
from benchmarks.corners import HUNDRED
from benchmarks.environment import environment
from feedplan.job import Job
from planner import FeedrateError, Program, read_program
from planner.geometry.tolerance import PathKind
from planner.joint.bound import joint_bound
from planner.joint.joint_run import JointRun
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.smooth_path import program_path
from planner.types import FloatArray

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data" / "programs"
FEED = 100.0  # mm/s
LIMITS = drives(FEED, dim=3)
TOLERANCES = (1e-3, 1e-2, 5e-2)  # mm
FINER = 6  # times the intervals of a default plan
SLOWER = 1e-4  # of the time, by which a joint plan may be above a separate one
MEDIAN_GAIN = 0.06  # of the random polygons


@dataclass(frozen=True)
class Goal:
    """What a program must reach at each of ``TOLERANCES``: a time, s, or a share less than separately; and in CPU time.

    ``finer``: the separate plan that is compared with has ``FINER`` times the intervals of the default one.
    """

    program: str
    seconds: tuple[float, float, float] | None = None
    less: tuple[float, float, float] | None = None
    cpu: float | None = None
    finer: bool = False


GOALS = (
    Goal("zigzag", seconds=(13.09, 12.29, 11.51), cpu=0.25),
    Goal("slots", seconds=(6.19, 5.54, 5.165)),
    Goal("raster of 15 corners", less=(0.04, 0.07, 0.125), finer=True),
    Goal("octagon", less=(0.02, 0.08, 0.20), finer=True),
    Goal("sawtooth of 135 degrees", less=(0.05, 0.079, 0.014), finer=True),
    Goal("raster of 15 corners, 20 mm lines", finer=True),
    Goal("sawtooth of 10 legs", finer=True),
    Goal("raster of 101 corners", cpu=0.25),
    Goal("butterfly_5000", less=(0.005, 0.009, 0.007), cpu=1.0),
)


def raster(corners: int, line: float = 12.0, jog: float = 0.5) -> FloatArray:
    """Lines and jogs with so many corners between them."""
    x = line * (((np.arange(corners + 2) + 1) // 2) % 2)
    return np.column_stack([x, jog * (np.arange(corners + 2) // 2)])


def octagon(radius: float = 5.0) -> FloatArray:
    """A closed polygon of eight sides."""
    angle = np.arange(9) * np.pi / 4.0
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def sawtooth(turn: float = 135.0, leg: float = 12.0, legs: int = 16) -> FloatArray:
    """Legs that turn by so many degrees to the one side and the other."""
    angle = np.deg2rad(0.5 * turn) * np.where(np.arange(legs) % 2, -1.0, 1.0)
    steps = leg * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


SYNTHETIC = {
    "raster of 15 corners": raster(15),
    "octagon": octagon(),
    "sawtooth of 135 degrees": sawtooth(),
    "raster of 15 corners, 20 mm lines": raster(15, line=20.0),
    "sawtooth of 10 legs": sawtooth(legs=10),
    "raster of 101 corners": raster(HUNDRED.corners, line=HUNDRED.line),
}


def random_polygon(seed: int) -> tuple[FloatArray, float]:
    """Points in the plane or in space, turns of 5 to 179 degrees, legs of 0.2 to 50 mm; and a tolerance of 1 to 50 um."""
    rng = np.random.default_rng(seed)
    dim, count = 2 + seed % 2, rng.integers(4, 14)
    points, heading = [np.zeros(dim)], rng.normal(size=dim)
    for _ in range(count):
        heading = heading / np.linalg.norm(heading)
        points.append(points[-1] + heading * 10.0 ** rng.uniform(np.log10(0.2), np.log10(50.0)))
        turn, aside = np.deg2rad(rng.uniform(5.0, 179.0)), rng.normal(size=dim)
        aside -= heading * (aside @ heading)
        heading = np.cos(turn) * heading + np.sin(turn) * aside / np.linalg.norm(aside)
    return np.array(points), float(10.0 ** rng.uniform(-3.0, np.log10(0.05)))


def polygon_program(points: FloatArray) -> Program:
    """A part program of straight moves between points (n + 1, 2 or 3)."""
    blocks = ["G21 G17 G90 G94", "G0 " + _words(points[0]), f"G64 P0.01 F{60.0 * FEED:g}"]
    blocks += [f"G1 {_words(point)}" for point in points[1:]]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "polygon.ngc"
        file.write_text("\n".join([*blocks, "M2", ""]), encoding="utf-8")
        return read_program(file, start=(*points[0], *np.zeros(3 - points.shape[1])))


def _words(point: FloatArray) -> str:
    return " ".join(f"{axis}{value:.6f}" for axis, value in zip("XYZ", point, strict=False))


def load(name: str) -> Program:
    """One of the programs of the table."""
    return polygon_program(SYNTHETIC[name]) if name in SYNTHETIC else read_program(FOLDER / f"{name}.ngc")


@dataclass(frozen=True)
class Made:
    """A program planned in one way.

    Attributes
    ----------
    seconds, finer_seconds : float
        Of the default plan, and of that on more intervals; the same where there is none.
    cpu_path, cpu_plan, cpu_check : float
        CPU time, s.
    within : bool
        The check found nothing, and the deviation is no larger than the tolerance.
    deviation : float
        mm.
    notes : tuple of str
        Of the path.
    """

    seconds: float
    finer_seconds: float
    cpu_path: float
    cpu_plan: float
    cpu_check: float
    within: bool
    deviation: float
    notes: tuple[str, ...]

    @property
    def cpu(self) -> float:
        """CPU time of path, plan and check, s."""
        return self.cpu_path + self.cpu_plan + self.cpu_check


def make(program: Program, tolerance: float, kind: PathKind, *, finer: bool = False) -> Made:
    """Make the path, plan and check it."""
    began = process_time()
    path = program_path(program, tolerance, LIMITS, path=kind)
    job = Job(path.curve, LIMITS.for_curve(path.curve))
    made = process_time()
    profile = job.plan()
    planned = process_time()
    report = job.check(profile)
    done = process_time()
    best = profile.duration
    if finer:
        best = min(best, job.plan(intervals=FINER * (profile.u.size - 1)).duration)
    within = report.ok and path.deviation_share <= 1.0
    times = (made - began, planned - made, done - planned)
    return Made(profile.duration, best, *times, within, path.deviation.largest, path.notes)


def proven(program: Program, tolerance: float) -> float | None:
    """The lower bound of the joint problem of all moves as one run, s; None where it has splines."""
    blocks = MovingBlocks.of(program, tolerance)
    legs = blocks.programmed.legs
    if legs.ways is not None and (legs.ways[:, 0] >= 0.0).any():
        return None
    axes = [getattr(LIMITS, name)[: legs.vectors.shape[2]] for name in ("velocity", "acceleration", "jerk")]
    feed = np.where(blocks.rapid, np.inf, FEED)
    # A stop or a tolerance of its own within the run only takes longer.
    run = JointRun(legs, np.diff(blocks.programmed.edges), np.full(feed.size, tolerance), feed, *axes)
    return joint_bound(run).seconds


@dataclass(frozen=True)
class Row:
    """A program within a tolerance, both ways."""

    program: str
    tolerance: float
    blocks: int
    joint: Made
    separate: Made
    proven: float | None
    seconds: float | None = None
    less: float | None = None
    cpu: float | None = None

    @property
    def gain(self) -> float:
        """Share of the time of the separate plan that the joint one saves."""
        return 1.0 - self.joint.seconds / self.separate.finer_seconds

    @property
    def cpu_ratio(self) -> float:
        """CPU time, joint over separate."""
        return self.joint.cpu / self.separate.cpu

    @property
    def fast(self) -> bool:
        """The motion takes no longer than it must."""
        on_time = self.seconds is None or self.joint.seconds <= self.seconds
        return on_time and (self.less is None or self.gain >= self.less)

    @property
    def cheap(self) -> bool:
        """Finding it takes no longer than it must."""
        return self.cpu is None or self.cpu_ratio <= self.cpu

    @property
    def met(self) -> bool:
        """What must be reached is; and within everything."""
        return self.joint.within and self.fast and self.cheap


def compare(name: str, program: Program, tolerance: float, *, finer: bool = False, **goals: float | None) -> Row:
    """Plan a program both ways."""
    separate = make(program, tolerance, "separate", finer=finer)
    joint = make(program, tolerance, "joint")
    return Row(name, tolerance, len(program), joint, separate, proven(program, tolerance), **goals)


def rows_of(goal: Goal) -> list[Row]:
    """A program within every tolerance."""
    program = load(goal.program)
    rows = []
    for k, tolerance in enumerate(TOLERANCES):
        seconds = None if goal.seconds is None else goal.seconds[k]
        less = None if goal.less is None else goal.less[k]
        rows.append(
            compare(goal.program, program, tolerance, finer=goal.finer, seconds=seconds, less=less, cpu=goal.cpu)
        )
    return rows


@dataclass(frozen=True)
class Polygons:
    """What random polygons came to."""

    rows: Sequence[Row]
    failed: Sequence[str]

    @property
    def beyond(self) -> list[str]:
        """Those beyond a limit or the tolerance."""
        return [row.program for row in self.rows if not row.joint.within]

    @property
    def slower(self) -> list[str]:
        """Those slower than separately."""
        return [row.program for row in self.rows if row.gain < -SLOWER]

    @property
    def above_bound(self) -> bool:
        """No plan takes less than is proven to be needed."""
        return all(row.proven is None or row.joint.seconds >= row.proven * (1.0 - 1e-6) for row in self.rows)

    @property
    def made_separately(self) -> list[str]:
        """Those of which not all was found jointly."""
        return [row.program for row in self.rows if any("separately" in note for note in row.joint.notes)]

    @property
    def median_gain(self) -> float:
        """Median of the gains."""
        return float(np.median([row.gain for row in self.rows]))

    @property
    def met(self) -> bool:
        """All that is asked of them."""
        wrong = [*self.failed, *self.beyond, *self.slower]
        return not wrong and self.above_bound and self.median_gain >= MEDIAN_GAIN


def polygons(seeds: Sequence[int], console: Console) -> Polygons:
    """Plan random polygons both ways."""
    rows, failed = [], []
    for seed in track(seeds, "random polygons", console=console):
        points, tolerance = random_polygon(seed)
        try:
            rows.append(compare(f"seed {seed}", polygon_program(points), tolerance))
        except FeedrateError as error:
            failed.append(f"seed {seed}: {error}")
    return Polygons(rows, failed)


def table_of(rows: Sequence[Row]) -> Table:
    """The table of the programs."""
    table = Table(title="path and feed as one problem", box=SIMPLE, padding=(0, 1, 0, 0))
    heads = ("program", "um", "joint s", "separate s", "less", "must", "proven", "CPU ratio", "ms a block", "within")
    for head in heads:
        table.add_column(head, justify="left" if head == "program" else "right", no_wrap=True)
    for row in rows:
        must = "" if row.seconds is None else f"<= {row.seconds:g} s"
        must = f"{row.less:.1%}" if row.less is not None else must
        cpu = "" if row.cpu is None else f" of {row.cpu:g}{'' if row.cheap else ' MISSED'}"
        table.add_row(
            row.program,
            f"{1e3 * row.tolerance:g}",
            f"{row.joint.seconds:.4f}",
            f"{row.separate.finer_seconds:.4f}",
            f"{row.gain:.2%}",
            must + ("" if row.fast else " MISSED"),
            "" if row.proven is None else f"{row.proven / row.joint.seconds:.1%}",
            f"{row.cpu_ratio:.2f}{cpu}",
            f"{1e3 * row.joint.cpu / row.blocks:.1f}",
            "yes" if row.joint.within else "NO",
        )
    return table


def told(found: Polygons) -> str:
    """What to say of the random polygons."""
    said = f"{len(found.rows)} random polygons: median gain {found.median_gain:.2%}"
    for what, names in (
        ("failed", found.failed),
        ("beyond a limit or the tolerance", found.beyond),
        ("slower than separately", found.slower),
        ("made separately, all or in part", found.made_separately),
    ):
        said += f"; {len(names)} {what}" + (f" ({', '.join(names[:12])})" if names else "")
    cpu = np.median([row.cpu_ratio for row in found.rows])
    share = np.median([row.proven / row.joint.seconds for row in found.rows if row.proven is not None])
    return said + f"; CPU ratio {cpu:.2f}, proven {share:.1%} of the time, in the median"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, help="JSON result file")
    parser.add_argument("--polygons", type=int, default=200, help="how many random polygons")
    parser.add_argument("--only", nargs="*", help="only these programs of the table; none without names")
    options = parser.parse_args(arguments)
    console, progress = Console(width=130), Console(stderr=True)
    goals = [goal for goal in GOALS if options.only is None or goal.program in options.only]
    compare("warm", polygon_program(octagon()), 0.01)
    rows = [row for goal in track(goals, "programs", console=progress) for row in rows_of(goal)]
    if rows:
        console.print(table_of(rows))
    found = polygons(range(options.polygons), progress)
    if found.rows:
        console.print(told(found))
    if options.output is not None:
        facts = environment() | {
            "programs": [asdict(row) | {"gain": row.gain, "cpu_ratio": row.cpu_ratio, "met": row.met} for row in rows],
            "polygons": [asdict(row) | {"gain": row.gain, "cpu_ratio": row.cpu_ratio} for row in found.rows],
            "failed": list(found.failed),
        }
        options.output.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return 0 if all(row.met for row in rows) and (not found.rows or found.met) else 1


if __name__ == "__main__":
    sys.exit(main())

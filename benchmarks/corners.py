"""Rasters with rounded corners: as part programs, their shortest time in closed form, and the intervals a corner needs.

A raster runs a long line, a short jog, the next line back, and so on; every corner has a right angle and is rounded by a
cubic within a tolerance e.  With A = e / sqrt(2) the fastest passage of such a corner saves 2 (6 A / J)^(1/3) of the time
in which both legs are run from rest to rest: the jerk of one axis goes on from the last arc of its braking while the
other axis is already in the first arc of its start.  So the whole takes

    T = sum of T_rest(L_i) - (number of corners) 2 (6 A / J)^(1/3)

as long as the first and the last arc of constant jerk of every leg are longer than that overlap.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.cases import drives
from feedplan.job import Job, load_job
from planner.errors import FeedrateError

FEED, VELOCITY, ACCELERATION, JERK = 100.0, 250.0, 1000.0, 20_000.0  # mm/s, mm/s^2, mm/s^3 of every axis


@dataclass(frozen=True)
class Raster:
    """Pairs of a line and a jog, mm, rounded within a tolerance, mm."""

    pairs: int
    line: float = 20.0
    jog: float = 0.5
    tolerance: float = 0.01

    @property
    def corners(self) -> int:
        """Number of corners: one between two legs."""
        return 2 * self.pairs - 1

    @property
    def program(self) -> str:
        """The part program."""
        blocks = ["G21 G17 G90 G94", "G0 X0 Y0", f"G64 P{self.tolerance:g}", f"F{60.0 * FEED:g}"]
        for k in range(self.pairs):
            x = 0.0 if k % 2 else self.line
            blocks += [f"G1 X{x:.6f} Y{k * self.jog:.6f}", f"G1 X{x:.6f} Y{(k + 1) * self.jog:.6f}"]
        return "\n".join([*blocks, "M2", ""])

    def load(self) -> Job:
        """Read the program and make its path, as for any file."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "raster.ngc"
            file.write_text(self.program, encoding="utf-8")
            return load_job(file, drives(FEED, 3), tolerance=self.tolerance, path="separate")

    @property
    def shortest_time(self) -> float:
        """T in closed form, s.

        Raises
        ------
        ValueError
            If an arc of constant jerk is shorter than the overlap.
        """
        overlap = 2.0 * (6.0 * self.tolerance / math.sqrt(2.0) / JERK) ** (1.0 / 3.0)
        for leg in (self.line, self.jog):
            if first_arc(leg) < overlap:
                raise ValueError(f"leg of {leg:g} mm: its first arc of constant jerk is shorter than {overlap:.3g} s")
        return self.pairs * (rest_to_rest(self.line) + rest_to_rest(self.jog)) - self.corners * overlap


def speeding_up(speed: float) -> float:
    """Time from rest to a speed, s."""
    if speed * JERK < ACCELERATION**2:
        return 2.0 * math.sqrt(speed / JERK)
    return speed / ACCELERATION + ACCELERATION / JERK


def highest_speed(length: float) -> float:
    """Highest speed on a line from rest to rest: speeding up and slowing down take speed times :func:`speeding_up`."""
    top = min(FEED, VELOCITY)
    if top * speeding_up(top) <= length:
        return top
    short = (0.5 * length * math.sqrt(JERK)) ** (2.0 / 3.0)
    if short * JERK < ACCELERATION**2:
        return short
    ramp = ACCELERATION**2 / JERK
    return 0.5 * (math.sqrt(ramp**2 + 4.0 * ACCELERATION * length) - ramp)


def rest_to_rest(length: float) -> float:
    """Shortest time of a line along an axis, s: v T = length + v t(v) at the highest speed v, t the time up to it."""
    speed = highest_speed(length)
    return length / speed + speeding_up(speed)


def first_arc(length: float) -> float:
    """Time for which the jerk stays at its limit at the start of a line, s."""
    return min(ACCELERATION / JERK, math.sqrt(highest_speed(length) / JERK))


HUNDRED = Raster(51)  # 101 corners
CLOSED_FORM = Raster(6, jog=5.0)
SWEPT = Raster(6)  # jogs too short for the closed form
# Its converged time, s: the plan on 64 000 intervals of 28 November 2026, on 16 000 it is 5e-6 longer.
SWEPT_OPTIMUM = 2.3747376
SWEEP = (15, 20, 25, 30, 35, 40, 45, 50, 60, 75, 90, 110, 140, 170, 200, 250, 300, 400, 500, 700, 1000, 1400)


def sweep_intervals(sweep: Sequence[int] = SWEEP) -> list[tuple[float, float]]:
    """Intervals a corner of plans on more and more of them, and their time over the optimum, minus 1.

    A plan that is refused, or that fails the check, is infinitely slow.
    """
    found = []
    for each in sweep:
        job = SWEPT.load()
        try:
            profile = job.plan(intervals=each * SWEPT.corners)
        except FeedrateError:
            found.append((float(each), math.inf))
            continue
        above = profile.duration / SWEPT_OPTIMUM - 1.0 if job.check(profile).ok else math.inf
        found.append((profile.work.intervals / SWEPT.corners, above))
    return found


def intervals_needed(found: Sequence[tuple[float, float]], above: float) -> float:
    """Fewest intervals a corner from which on no plan is further above the optimum; inf where the last one is."""
    needed = math.inf
    for each, excess in reversed(found):
        if excess > above:
            break
        needed = each
    return needed

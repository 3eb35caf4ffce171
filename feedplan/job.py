"""What a command works on: a curve and the machine's limits for it, or a part program made into a curve."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.errors import InputError

if TYPE_CHECKING:
    from feedplan.progress import ProgressLine
    from feedplan.verdict import Verdict
    from planner.geometry.curve import Curve
    from planner.machine.limits import Limits
    from planner.output.ngc import Mode, WrittenProgram
    from planner.profile import FeedrateProfile
    from planner.programs.path.path import ProgramPath
    from planner.programs.reading.program import Program
    from planner.programs.times import LineTimes

PROGRAM_SUFFIXES = (".ngc", ".nc", ".tap")
# Of the tolerance, where a program is written too: the path takes this, and the lines of the program the rest.
PATH_SHARE = 0.75
DEFAULT_TOLERANCE = 0.01  # mm
_LONG = 20_000  # moves
_POINTS_TOLERANCE = 1e-3  # mm, of the points of a CSV file


@dataclass(frozen=True, eq=False)
class Part:
    """A curve with the limits on it; program and path where it comes from a part program.

    ``room`` is the distance, mm, that the lines of a program written from the plan may leave the curve by, ``facts`` what
    the verdict says of where it comes from.
    """

    curve: Curve
    limits: Limits
    machine: str
    program: Program | None = None
    path: ProgramPath | None = None
    room: float = 0.0
    facts: tuple[tuple[str, str], ...] = ()

    def plan(self, line: ProgressLine, **options: Any) -> FeedrateProfile:
        """Plan the curve; options as for ``plan_feedrate``."""
        from planner import plan_feedrate

        return plan_feedrate(self.curve, self.limits, progress=line, **options)

    def judge(
        self, profile: FeedrateProfile, line: ProgressLine, *, seconds: float = math.nan, files: tuple[str, ...] = ()
    ) -> Verdict:
        """Check a plan and the samples of it, each on its own."""
        import interp
        from feedplan.verdict import Verdict
        from planner import check

        curve, limits = self.curve, self.limits
        line("checking the plan")
        plan_report = check(curve, limits, profile)
        line("checking the samples")
        samples = interp.replay(curve, profile, limits.period)
        samples_report = check(curve, limits, samples)
        return Verdict(
            profile, limits, self.machine, samples, plan_report, samples_report, seconds, files, self.path, self.facts
        )

    def line_times(self, profile: FeedrateProfile) -> LineTimes:
        """Share the time of a plan out among the lines of the program."""
        from planner.programs.times import line_times

        if self.program is None or self.path is None:
            raise AssertionError("only a part program has lines")
        return line_times(self.program, self.path, profile)

    def write(self, file: Path, profile: FeedrateProfile, mode: Mode, **options: Any) -> WrittenProgram:
        """Write a program of the plan."""
        from planner.output.ngc import write_ngc
        from planner.output.ngc_program import write_program

        if self.program is None or self.path is None:
            return write_ngc(file, self.curve, profile, tolerance=self.room, mode=mode, **options)
        return write_program(file, self.program, self.path, profile, tolerance=self.room, mode=mode, **options)


def is_program(source: str) -> bool:
    """Whether the name of a curve is that of a part program."""
    return Path(source).suffix.lower() in PROGRAM_SUFFIXES


def _is_points(source: str) -> bool:
    return Path(source).suffix.lower() == ".csv"


def require_program(source: str, what: str) -> None:
    """Refuse a curve without lines."""
    if not is_program(source):
        raise InputError(f"{source} has no lines; {what} needs a part program, {', '.join(PROGRAM_SUFFIXES)}")


def load_part(
    source: str,
    scale: float,
    machine: str | None,
    feed: float | None,
    period: float | None,
    tolerance: float | None = None,
    share: float = 1.0,
    notice: Callable[[str], None] | None = None,
) -> Part:
    """Load a curve, or a part program as a path, and the limits of a machine.

    ``notice`` is told what is no error and yet worth knowing. Of the tolerance the path takes ``share``, less than 1
    where a program is to be written; without a machine, the example that has the curve's axes counts.
    """
    from planner import read_program
    from planner.geometry.curve import ROTARY_AXES

    tolerance = _positive(tolerance)
    if is_program(source):
        _require_scale(source, scale)
        limits, named = load_machine(machine)
        limits = _changed(limits, feed, period)
        program = read_program(source)
        if len(program) > _LONG and notice is not None:
            notice(
                f"{source}: {len(program)} moves are planned as a whole here, which takes memory; "
                "feedplan windows plans any number"
            )
        return _part(source, program, limits, named, tolerance, share)
    plain = _load_plain(source, scale, tolerance, share)
    example = "five-axis" if ROTARY_AXES & set(plain.curve.axes) else "mill"
    limits, named = load_machine(machine, example)
    return plain.part(_changed(limits.for_curve(plain.curve), feed, period), named)


def load_machine(machine: str | None, example: str = "mill") -> tuple[Limits, str]:
    """Load the limits of a machine, or of an example where none is given; with them comes what to call it."""
    from planner import load_limits

    if machine is None:
        return load_limits(example), f"{example} (example machine)"
    return load_limits(machine), machine


def load_part_of_table(
    table: Path, source: str, scale: float, machine: str | None, tolerance: float | None = None
) -> Part:
    """Load the curve a table was planned for, and the limits of a machine; without one, those in the table's header.

    The path of a part program depends on the limits it was made for and on the tolerance: both stand in the header.
    """
    from planner import read_program, table_limits
    from planner.geometry.tolerance import PathTolerance
    from planner.output.table import table_origin

    own, said = table_limits(table), table_origin(table).tolerance or PathTolerance(None)
    tolerance = _positive(tolerance)
    # A table of an exact curve says no tolerance: one that does is of another curve, as reading it will tell.
    if tolerance is None and (is_program(source) or _is_points(source)):
        tolerance = said.mm
    share = said.share
    if is_program(source):
        _require_scale(source, scale)
        program = read_program(source)
        part = _part(source, program, _widened(own, program.axes), f"limits in {table}", tolerance, share)
    else:
        part = _load_plain(source, scale, tolerance, share).part(own, f"limits in {table}")
    if machine is None:
        return part
    limits, named = load_machine(machine)
    return replace(part, limits=limits.for_curve(part.curve), machine=named)


@dataclass(frozen=True, eq=False)
class _Plain:
    """A curve that is no part program."""

    curve: Curve
    room: float
    facts: tuple[tuple[str, str], ...] = ()

    def part(self, limits: Limits, machine: str) -> Part:
        return Part(self.curve, limits, machine, room=self.room, facts=self.facts)


def _load_plain(source: str, scale: float, tolerance: float | None, share: float) -> _Plain:
    """Load a curve that is no part program; the points of a CSV file are fitted within the path's tolerance."""
    from planner import load_curve
    from planner.geometry.points import FittedCurve, read_points

    if not _is_points(source):
        if tolerance is not None and share == 1.0:
            raise InputError(f"--tolerance-mm = {tolerance!r} is for part programs and points; {source} is exact")
        return _Plain(load_curve(source, scale=scale), tolerance or DEFAULT_TOLERANCE)
    if tolerance is None:
        curve, allowed, room = load_curve(source, scale=scale), _POINTS_TOLERANCE, DEFAULT_TOLERANCE
    else:
        _require_scale(source, scale)
        allowed, room = share * tolerance, (1.0 - share) * tolerance
        curve = read_points(source, tolerance, share=share)
    facts: tuple[tuple[str, str], ...] = ()
    if isinstance(curve, FittedCurve):
        far = f"{1e3 * curve.deviation:.4g} um at most from a point, in line {curve.row}"
        facts = (("deviation", f"{far}; {1e3 * allowed:g} um allowed"),)
    return _Plain(curve, room, facts)


def _part(source: str, program: Program, limits: Limits, machine: str, tolerance: float | None, share: float) -> Part:
    """Make the path of a part program, which takes ``share`` of the tolerance."""
    import numpy as np

    from planner.geometry.tolerance import PathTolerance
    from planner.programs.path.path import program_path

    if tolerance is None:
        given = np.where(np.isnan(program.tolerance), DEFAULT_TOLERANCE, program.tolerance)
        path = program_path(replace(program, tolerance=share * given), None, limits)
        least = float(given[given > 0.0].min(initial=np.inf))
        least = least if np.isfinite(least) else DEFAULT_TOLERANCE
    else:
        path = program_path(program, share * tolerance, limits)
        least = tolerance
    curve = replace(path.curve, name=Path(source).name, made_within=PathTolerance(tolerance, share))
    path = replace(path, curve=curve)
    return Part(
        path.curve,
        limits.for_curve(path.curve),
        machine,
        program,
        path,
        (1.0 - share) * least,
        (("program", _summary(program, path)),),
    )


def _widened(limits: Limits, axes: tuple[str, ...]) -> Limits:
    """The limits in a table are those of the axes that move; an axis that only has words needs none that counts."""
    from planner.quantity import AXIS

    resting = tuple(axis for axis in axes if axis not in limits.axes)
    if not resting:
        return limits
    rows = {q.key: [*limits.of(q), *[math.inf] * len(resting)] for q in AXIS}
    return limits.with_axes((*limits.axes, *resting), **rows)


def _positive(tolerance: float | None) -> float | None:
    from planner.inputs import positive_number

    return None if tolerance is None else positive_number(tolerance, "--tolerance-mm")


def _summary(program: Program, path: ProgramPath) -> str:
    """What is in a program, and what the path is made of."""
    from planner.programs.reading.program import ARC

    arcs = int((program.kind == ARC).sum())
    parts = [_count(program.line_count, "line"), _count(len(program), "move") + (f" ({arcs} arcs)" if arcs else "")]
    parts += [_count(path.counts[f"{what}s"], what) for what in ("corner", "tube") if path.counts[f"{what}s"]]
    dwells = [event.seconds for event in program.events if event.kind == "dwell"]
    changes = sum(event.kind == "tool_change" for event in program.events)
    if dwells:
        parts.append(f"{_count(len(dwells), 'dwell')} ({sum(dwells):g} s, apart)")
    if changes:
        parts.append(f"{_count(changes, 'tool change')} (apart)")
    return ", ".join(parts)


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _changed(limits: Limits, feed: float | None, period: float | None) -> Limits:
    if feed is not None:
        limits = limits.with_feed(feed)
    return limits if period is None else limits.with_period(period)


def _require_scale(source: str, scale: float) -> None:
    if scale != 1.0:
        raise InputError(f"--scale = {scale!r} is not for {source}; it must be 1")

"""A calibration from files: logs, or times of programs, in, a machine file and a report out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from feedplan.layout import BOLD, GREEN, RED, named, table
from planner.calibration.axis_limits import AxisLimit
from planner.calibration.calibrate import calibrate_logs
from planner.calibration.calibrated_machine import calibrated_limits, calibrated_text, is_raised, percent
from planner.calibration.controller_times import TimesCalibration, calibrate_times
from planner.calibration.laws import Laws, MotionLaw
from planner.calibration.log import Log, log_of_text
from planner.calibration.times_list import TimedProgram, is_times_list, read_times_list
from planner.errors import InputError
from planner.geometry.curve import ROTARY_AXES
from planner.inputs import read_text
from planner.machine.machine_file import read_machine
from planner.machine.machine_table import Machine
from planner.programs import SUFFIXES
from planner.programs.reading.program import Program
from planner.programs.reading.reader import read_program
from planner.types import Progress


@dataclass(frozen=True, eq=False)
class FoundMachine:
    """What was found in files.

    Attributes
    ----------
    machine : Machine
        Of the start file.
    source : str
        Its name.
    limits : tuple of AxisLimit
    laws : Laws, optional
        From logs of positions.
    times : TimesCalibration, optional
        From times of programs.
    notes : tuple of str
    """

    machine: Machine
    source: str
    limits: tuple[AxisLimit, ...]
    laws: Laws | None
    times: TimesCalibration | None
    notes: tuple[str, ...]

    def toml(self, folder: Path) -> str:
        """The machine file."""
        return calibrated_text(self.machine, self.limits, self.head(), folder)

    def head(self) -> list[str]:
        """Remarks at its beginning."""
        lines = [f"{self.source}, calibrated"]
        if self.laws is not None:
            lines.append(self.laws.says)
            if self.laws.best is MotionLaw.FIR:
                lines.append(f"jerk here is acceleration over the {1e3 * self.laws.tau:.4g} ms of the moving average")
        if self.times is not None:
            off = percent(self.times.fit.misfit)
            lines.append(f"from times of programs by the model of {self.times.controller}, off by {off} (median)")
        return lines


def calibrate_files(
    paths: Sequence[Path],
    machine: str | Path,
    *,
    complete: Mapping[str, float] | None = None,
    period: float | None = None,
    controller: str | None = None,
    trust_units: bool = False,
    progress: Progress | None = None,
) -> FoundMachine:
    """Find a machine's limits in logs of positions, or in lists of times of programs; arguments as the command has them.

    Raises
    ------
    InputError
        Naming file, line and what is allowed.
    """
    say: Progress = progress if progress is not None else (lambda _text, _share: None)
    start = read_machine(machine, complete)
    if not start.limits.axes:
        raise InputError(f"{machine}: names no axes; a calibration needs one [[axis]] table each")
    texts = [(path, read_text(path, InputError)) for path in paths]
    lists = [(path, text) for path, text in texts if is_times_list(text)]
    if lists and len(lists) < len(texts):
        raise InputError(
            f"{lists[0][0]} lists times of programs and the others are logs of positions; give the one kind or the other"
        )
    if lists:
        if period is not None:
            raise InputError("--period-s is for logs of positions")
        timed = [row for path, text in lists for row in read_times_list(text, path, start.setup)]
        return _from_times(timed, start, str(machine), controller, say)
    if controller is not None:
        raise InputError("--controller is for times of programs; logs of positions need none")
    logs: list[Log] = []
    programs: dict[int, Program] = {}
    for path, text in texts:
        say(f"reading {path}", None)
        program = _program_beside(path, start)
        if program is not None:
            programs[len(logs)] = program
        logs.append(log_of_text(text, str(path), period))
    say("looking for stretches", None)
    found = calibrate_logs(logs, start.limits, programs, trust_units=trust_units)
    return FoundMachine(start, str(machine), found.limits, found.laws, None, found.notes)


def _program_beside(log: Path, machine: Machine) -> Program | None:
    """The program that stands beside a log under its name."""
    beside = [log.with_suffix(suffix) for suffix in SUFFIXES]
    files = [file for file in beside if file.is_file() and file != log]
    return read_program(files[0], setup=machine.setup) if files else None


def _from_times(
    timed: Sequence[TimedProgram], start: Machine, source: str, controller: str | None, say: Progress
) -> FoundMachine:
    found = calibrate_times(timed, start.limits, controller, say)
    return FoundMachine(start, source, found.fit.limits, None, found, found.notes)


# ---- report --------------------------------------------------------------------------------------------------------


def calibration_lines(found: FoundMachine, file: str) -> list[str]:
    """The report for a terminal."""
    heads = ["limit", "unit", "start", "found", "spread", "seen", "written"]
    before, after = found.machine.limits, calibrated_limits(found.machine.limits, found.limits)
    rows = []
    for limit in found.limits:
        j = before.axes.index(limit.axis)
        key = limit.quantity.key
        known = limit.known
        rows.append(
            [
                limit.quantity.of(limit.axis),
                limit.quantity.unit("rad" if limit.axis in ROTARY_AXES else "mm"),
                f"{getattr(before, key)[j]:.6g}",
                _value(limit),
                percent(limit.spread) if known or limit.joint else "",
                str(limit.count) if known else "",
                f"{getattr(after, key)[j]:.6g}",
            ]
        )
    lines = [*named("machine", found.source), "", *table(heads, rows, left=("limit", "unit")), ""]
    if found.laws is not None:
        lines += named("law", found.laws.says, BOLD)
        lines += _misfits(found.laws)
    if found.times is not None:
        lines += _times_lines(found.times)
    for reason, names in _reasons(found.limits).items():
        lines += named("not told", f"{', '.join(names)}: {reason}")
    raised = [limit.quantity.of(limit.axis) for limit in found.limits if is_raised(limit, before)]
    lines += named("raised", f"{', '.join(raised)}: more was reached than {found.source} says") if raised else []
    for note in found.notes:
        lines += named("note", note)
    count = sum(limit.known for limit in found.limits)
    if count or any(limit.joint for limit in found.limits):
        result = named("OK", f"{count} of {len(found.limits)} limits measured", GREEN)
    else:
        result = named("NOTHING TOLD", f"no limit was measured: {file} has those of {found.source}", RED)
    return [*lines, *named("written", file), "", *result]


def _value(limit: AxisLimit) -> str:
    if limit.known:
        return f"{limit.value:.6g}"
    if limit.value <= 0.0:
        return "-"
    return f"~ {limit.value:.3g}" if limit.joint else f">= {limit.value:.4g}"


def _misfits(laws: Laws) -> list[str]:
    """How far each law is off around changes of acceleration."""
    shown = [f"{fit.law.value} {1e3 * fit.misfit:.3g} um" for fit in laws.fits]
    return named("misfit", f"{', '.join(shown)} (root mean square around {laws.ramps} changes)") if shown else []


def _times_lines(times: TimesCalibration) -> list[str]:
    fit = times.fit
    lines = named("model", f"{times.controller}: off by {percent(fit.misfit)} in the median", BOLD)
    if times.others:
        others = ", ".join(f"{name} {percent(misfit)}" for name, misfit in times.others.items())
        lines += named("", f"other controllers: {others}")
    rows = [
        [timed.name, f"{timed.seconds:.3f}", f"{predicted:.3f}", f"{100.0 * error:+.2f}%", "" if used else "left out"]
        for timed, predicted, error, used in zip(times.programs, fit.predicted, fit.error, fit.used, strict=True)
    ]
    return [*lines, "", *table(["program", "measured\ns", "model\ns", "off", ""], rows, left=("program", "")), ""]


def _reasons(limits: Sequence[AxisLimit]) -> dict[str, list[str]]:
    """What is not known, by why."""
    found: dict[str, list[str]] = {}
    for limit in limits:
        if not limit.known:
            found.setdefault(limit.why, []).append(limit.quantity.of(limit.axis))
    return found


def calibration_facts(found: FoundMachine) -> dict[str, Any]:
    """The same for a program."""
    after = calibrated_limits(found.machine.limits, found.limits)
    facts: dict[str, Any] = {
        "machine": found.source,
        "limits": [_limit_facts(limit, found.machine, after) for limit in found.limits],
        "notes": list(found.notes),
    }
    if found.laws is not None:
        laws = found.laws
        facts["law"] = {
            "best": None if laws.best is None else laws.best.value,
            "sure": laws.sure,
            "says": laws.says,
            "misfit_mm": {fit.law.value: fit.misfit for fit in laws.fits},
            "moving_average_s": None if math.isnan(laws.tau) or laws.best is not MotionLaw.FIR else laws.tau,
            "changes": laws.ramps,
        }
    if found.times is not None:
        fit = found.times.fit
        facts["times"] = {
            "controller": found.times.controller,
            "median_error": fit.misfit,
            "other_controllers": dict(found.times.others),
            "singular_values": fit.singular_values.tolist(),
            "programs": [
                {"program": timed.name, "seconds": timed.seconds, "model_s": float(p), "used": bool(u)}
                for timed, p, u in zip(found.times.programs, fit.predicted, fit.used, strict=True)
            ],
        }
    return facts


def _limit_facts(limit: AxisLimit, machine: Machine, after: Any) -> dict[str, Any]:
    j = machine.limits.axes.index(limit.axis)

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "axis": limit.axis,
        "limit": limit.quantity.key,
        "known": limit.known,
        "joint": limit.joint,
        "value": number(limit.value),
        "start": number(float(getattr(machine.limits, limit.quantity.key)[j])),
        "written": number(float(getattr(after, limit.quantity.key)[j])),
        "seen": limit.count,
        "spread": limit.spread,
        "why": limit.why,
    }

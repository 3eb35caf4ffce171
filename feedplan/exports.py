"""A plan in the formats of other machines' controllers: which there are, what each needs, and one call that writes them.

Every format is written of a plan that keeps its limits, and so do its samples; else nothing is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.errors import BrokenLimitError, InputError
from planner.inputs import plain_number, require_path, shorten

if TYPE_CHECKING:
    from feedplan.job import Job
    from feedplan.verdict import Verdict
    from planner.types import Progress

EXPORT_SUFFIXES = {"fpr": (".fpr",), "csp": (".csv", ".npz"), "ros": (".yaml", ".yml"), "steps": (".steps", ".csv")}
"""The first of a format is meant where a name has no suffix; of two formats with one suffix the first."""
_OWN = {
    "fpr": (),
    "csp": ("period_s", "counts_per_mm", "counts_per_rad", "velocity_offset"),
    "ros": ("joint_names", "deviation_mm"),
    "steps": ("steps_per_mm", "steps_per_rad", "clock_hz", "pulse_us", "space_us", "setup_us", "hold_us"),
}
_MICRO = 1e-6


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    text : str
        A line for a person.
    facts : mapping
        The same for a program, by keys that JSON shows.
    """

    text: str
    facts: Mapping[str, Any]


def export_format(path: str | Path, kind: str | None) -> str:
    """Format of a file by its suffix, or the one that is asked for; InputError where they do not fit."""
    suffix = require_path(path).suffix.lower()
    every = ", ".join(f"{name} ({' '.join(of)})" for name, of in EXPORT_SUFFIXES.items())
    if kind is None:
        found = next((name for name, of in EXPORT_SUFFIXES.items() if suffix in of), None)
        if found is None:
            raise InputError(f'{path}: the suffix "{suffix}" is of no format; they are {every}')
        return found
    if kind not in EXPORT_SUFFIXES:
        raise InputError(f"format = {kind!r} must be one of {every}")
    if suffix and suffix not in EXPORT_SUFFIXES[kind]:
        raise InputError(
            f'{path}: the suffix "{suffix}" of the format {kind} must be {" or ".join(EXPORT_SUFFIXES[kind])}'
        )
    return kind


def require_own(kind: str, options: Mapping[str, Any]) -> None:
    """Refuse options of other formats; those that are None or False are not given."""
    for key, value in options.items():
        if value is not None and value is not False and key not in _OWN[kind]:
            of = ", ".join(name for name, keys in _OWN.items() if key in keys)
            raise InputError(f"--{key.replace('_', '-')} is for the format {of}; this file is of the format {kind}")


def per_axis(
    per_mm: str | float | None, per_rad: str | float | None, axes: tuple[str, ...], what: str
) -> dict[str, float]:
    """One number for each axis that has one: a number for all axes of a unit, or ``X=1000,Y=800``.

    Raises InputError, naming the option ``--what-per-mm`` or ``-rad``, for what is no such text, for an axis that there is
    not or that has the other unit, and where an axis has none.
    """
    from planner.geometry.curve import ROTARY_AXES

    found: dict[str, float] = {}
    for unit, given in (("mm", per_mm), ("rad", per_rad)):
        option, own = f"--{what}-per-{unit}", tuple(a for a in axes if (a in ROTARY_AXES) == (unit == "rad"))
        for axis, value in _numbers(given, option, own).items():
            if axis not in own:
                raise InputError(f"{option}: {shorten(axis)} is none of its axes; they are {' '.join(own) or 'none'}")
            found[axis] = value
        missing = [axis for axis in own if axis not in found]
        if missing:
            raise InputError(
                f"{what} per {unit} of {', '.join(missing)} are missing; give them with {option}, one number for all "
                f"or {','.join(f'{axis}=...' for axis in own)}"
            )
    return {axis: found[axis] for axis in axes}


def _numbers(given: str | float | None, option: str, own: tuple[str, ...]) -> dict[str, float]:
    if given is None:
        return {}
    text = str(given)
    parts = [part.strip().partition("=") for part in text.split(",")] if "=" in text else []
    named = [(axis.strip(), value) for axis, _, value in parts] or [(axis, text) for axis in own]
    found: dict[str, float] = {}
    for axis, value in named:
        number = plain_number(value.strip())
        if number is None:
            raise InputError(f'{option} = "{shorten(text)}" must be a number, or numbers by axis as X=1000,Y=800')
        if axis in found:
            raise InputError(f"{option} = {shorten(text)} says {axis} twice; leave one")
        found[axis] = number
    return found


def export_plan(
    job: Job, verdict: Verdict, path: str | Path, kind: str, progress: Progress, **options: Any
) -> Exported:
    """Write a plan in a format of a controller, if it and its samples keep the limits.

    Parameters
    ----------
    job : Job
    verdict : Verdict
        Of the plan, as :meth:`Job.judge` gives it.
    path : str or Path
    kind : {"fpr", "csp", "ros", "steps"}
    progress : callable
        Is told what is being done.
    options
        Those of the format, by the names they have on the command line; None where left out.

    Raises
    ------
    InputError
        If an option is missing, or not as it must be, or the file cannot be written.
    BrokenLimitError
        If a limit is broken, by the plan, its samples, or what would be made of them.  Then nothing is written.
    """
    for name, report in verdict.reports:
        if not report.ok:
            said = "the plan" if name == "plan" else "the plan as sampled"
            raise BrokenLimitError(f"{path}: not written: {said} {report.summary()}; plan again within the limits")
    given = {key: options.get(key) for key in _OWN[kind]}
    progress(f"writing {path}", None)
    return {"fpr": _plan_file, "csp": _cyclic, "ros": _trajectory, "steps": _pulses}[kind](
        job, verdict, Path(path), given
    )


def _plan_file(job: Job, verdict: Verdict, path: Path, given: Mapping[str, Any]) -> Exported:
    """What the C step of a controller reads, with the lines of the program that the path is of."""
    import numpy as np

    from interp.plan_file import read_plan_file, write_plan_file

    lines = np.empty((0, 2))
    if job.program is not None and job.path is not None:
        from planner.programs.times import move_edges

        lines = np.stack([move_edges(job.path, verdict.profile)[:-1], job.program.line], axis=1)
        lines = lines[np.diff(lines[:, 1], prepend=-1.0) != 0.0]  # a line may have several moves
    # Left out, the limits are those of the plan, to which the file adds the reserve that it was made with.
    limits = None if job.limits == verdict.profile.limits else job.limits
    write_plan_file(verdict.profile, path, limits, lines=lines)
    nodes, size = verdict.profile.t.size, path.stat().st_size
    said = f", {len(lines)} lines of the program" if len(lines) else ""
    governor = read_plan_file(path).governor
    obeys = (
        "it obeys neither override nor hold (plan it with --override-reserve)"
        if governor is None
        else f"it obeys override and hold, and a hold from full rate takes {governor.stop_time:.3g} s"
    )
    text = f"{nodes} nodes of the plan{said}, {size} bytes, for interp/step.c; {obeys}"
    stop = None if governor is None else governor.stop_time
    return Exported(text, {"nodes": nodes, "lines": len(lines), "bytes": size, "stop_time_s": stop})


def _cyclic(job: Job, verdict: Verdict, path: Path, given: Mapping[str, Any]) -> Exported:
    from planner.output.cyclic_positions import interpolation_time, write_cyclic_positions

    increments = per_axis(given["counts_per_mm"], given["counts_per_rad"], job.curve.axes, "counts")
    samples, report = verdict.samples, verdict.samples_report
    if given["period_s"] is not None:
        interpolation_time(given["period_s"])
        samples = job.replay(verdict.profile, given["period_s"])
        report = job.check(samples)
    rows = write_cyclic_positions(
        path, verdict.profile, samples, increments, report=report, velocity_offset=bool(given["velocity_offset"])
    )
    half = ", ".join(
        f"{axis} {0.5e3 / abs(increments[axis]):.3g} {'um' if unit == 'mm' else 'mrad'}"
        for axis, unit in zip(job.curve.axes, job.curve.axis_units, strict=True)
    )
    text = f"{rows} rows, one every {1e3 * samples.period:g} ms; rounded by half an increment at most: {half}"
    return Exported(text, {"rows": rows, "period_s": samples.period, "counts": list(increments.values())})


def _trajectory(job: Job, verdict: Verdict, path: Path, given: Mapping[str, Any]) -> Exported:
    from planner.output.joint_trajectory import JOINT_TOLERANCE_MM, write_joint_trajectory

    names = given["joint_names"]
    done = write_joint_trajectory(
        path,
        verdict.profile,
        job.limits,
        joint_names=None if names is None else [name.strip() for name in names.split(",")],
        tolerance=JOINT_TOLERANCE_MM if given["deviation_mm"] is None else given["deviation_mm"],
        report=verdict.plan_report,
    )
    text = (
        f"{done.points} points, {1e3 * done.longest:.4g} ms apart at most; the quintics between them are within "
        f"{1e6 * done.deviation:.3g} nm (nrad) of the plan and use {100.0 * done.used:.5g} % of a limit"
    )
    facts = {"points": done.points, "deviation_mm": done.deviation, "used": done.used, "longest_s": done.longest}
    return Exported(text, facts)


def _pulses(job: Job, verdict: Verdict, path: Path, given: Mapping[str, Any]) -> Exported:
    from interp.pulse_file import write_pulses
    from interp.pulses import StepDriver

    axes = job.curve.axes
    steps = per_axis(given["steps_per_mm"], given["steps_per_rad"], axes, "steps")
    own = {
        name: _MICRO * given[f"{name}_us"]
        for name in ("pulse", "space", "setup", "hold")
        if given[f"{name}_us"] is not None
    }
    if given["clock_hz"] is not None:
        own["clock_hz"] = given["clock_hz"]
    driver = StepDriver(steps, **own)
    done = write_pulses(path, verdict.profile, driver)
    each = ", ".join(
        f"{axis} {count} (at most {1e-3 * hz:.4g} kHz)"
        for axis, count, hz in zip(axes, done.pulses, done.highest_hz, strict=True)
    )
    left = f"; {done.left_out} pairs left out where an axis turns" if done.left_out else ""
    text = (
        f"{sum(done.pulses)} pulses: {each}; {1e-3 * driver.max_hz:.4g} kHz allowed; within {done.error_steps:.6g} steps of "
        f"the plan{left}"
    )
    facts = {
        "pulses": done.pulses,
        "highest_hz": done.highest_hz,
        "allowed_hz": round(driver.max_hz, 6),
        "error_steps": done.error_steps,
        "left_out": done.left_out,
    }
    return Exported(text, facts)

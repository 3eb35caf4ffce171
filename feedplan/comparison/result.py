"""The row of one method, what the optimum saves against the others, and both as plain values for JSON and CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any

from feedplan.comparison.judgement import Dilation, Judgement
from feedplan.comparison.methods import OPTIMUM, REFERENCE, MethodRun
from planner.controllers.known import CONTROLLERS
from planner.quantity import QUANTITIES

# The optimum itself, the same problem by another solver, and what moves along another path of the same program.
_NO_RIVALS = (OPTIMUM, REFERENCE, "joint", "separate", *CONTROLLERS)


@dataclass(frozen=True, eq=False)
class Result:
    """One method's row.

    Attributes
    ----------
    method : str
    reason : str
        Why the method could not run; empty where it ran.
    duration : float
        Machining time, s.
    points : int
        Samples sent to the drives.
    chord_error : float
        Largest distance of the path from a chord of one period, mm.
    fluctuation : float
        Largest relative deviation of the length covered in a period from what the method meant it to be.
    computing_time : float
        Processor time without loading and compiling, s.
    judgement : Judgement or None
        From rest to rest; None where the method could not run.
    entered_at_speed : Judgement or None
        The same where the path is entered and left at the method's own feed, if that is not 0.
    motion : Motion or None
    deviation : float
        Largest distance of the path from the part program it is of, measured in both directions, mm; nan for other curves.
    """

    method: str
    reason: str = ""
    duration: float = nan
    points: int = 0
    chord_error: float = nan
    fluctuation: float = nan
    computing_time: float = nan
    judgement: Judgement | None = None
    entered_at_speed: Judgement | None = None
    motion: MethodRun | None = None
    deviation: float = nan

    @property
    def ok(self) -> bool:
        """The method ran and breaks nothing."""
        return self.judgement is not None and not self.judgement.broken


@dataclass(frozen=True)
class Saving:
    """What the optimum saves.

    Attributes
    ----------
    optimum : float
        Duration of the optimal plan, s.
    rival : str
        Fastest method that breaks nothing as it is; empty where there is none.
    rival_duration, share : float
        Its time, s, and what the optimum saves of it.
    slowed_rival : str
        Fastest method once each has been slowed until it breaks nothing.
    slowed_duration, slowed_share : float
        Its time then, s, and what the optimum saves of it.
    """

    optimum: float
    rival: str = ""
    rival_duration: float = nan
    share: float = nan
    slowed_rival: str = ""
    slowed_duration: float = nan
    slowed_share: float = nan


def saving(results: Sequence[Result]) -> Saving | None:
    """What the optimal plan saves against its rivals; None where it is not among the results or breaks a limit."""
    optimum = next((r.duration for r in results if r.method == OPTIMUM and r.ok), None)
    if optimum is None:
        return None
    rivals = [(r, r.judgement.dilation) for r in results if r.judgement and r.method not in _NO_RIVALS]
    found = Saving(optimum)
    if holding := [r for r, _ in rivals if r.ok]:
        best = min(holding, key=lambda r: r.duration)
        share = 1.0 - optimum / best.duration
        found = replace(found, rival=best.method, rival_duration=best.duration, share=share)
    if slowed := [(slow.duration, r.method) for r, slow in rivals if slow.confirmed]:
        duration, name = min(slowed)
        share = 1.0 - optimum / duration
        found = replace(found, slowed_rival=name, slowed_duration=duration, slowed_share=share)
    return found


def result_facts(result: Result) -> dict[str, Any]:
    """One row as plain values, for JSON and CSV; numbers may be inf or nan."""
    judgement, entered = result.judgement, result.entered_at_speed
    facts: dict[str, Any] = {
        "method": result.method,
        "machining_time_s": result.duration,
        "verdict": "not run" if judgement is None else ("holds" if result.ok else "breaks"),
        "breaks": [] if judgement is None else [row.limit for row in judgement.broken],
        "points": result.points,
        "chord_error_mm": result.chord_error,
        "deviation_mm": result.deviation,
    }
    for quantity in QUANTITIES:
        facts[f"{quantity.key}_ratio"] = nan if judgement is None else judgement.ratios[quantity.label]
    facts |= {"feed_fluctuation": result.fluctuation, "computing_time_s": result.computing_time}
    facts |= _dilation_facts(judgement, "")
    facts["breaks_entered_at_speed"] = [] if entered is None else [row.limit for row in entered.broken]
    facts |= _dilation_facts(entered, "_entered_at_speed")
    facts |= {"setting": "" if result.motion is None else result.motion.setting, "reason": result.reason}
    return facts


def finite(value: Any) -> Any:
    """Replace numbers that are not finite, which JSON does not know, by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _dilation_facts(judgement: Judgement | None, suffix: str) -> dict[str, Any]:
    found = Dilation(nan, nan, False) if judgement is None else judgement.dilation
    return {
        f"dilation{suffix}": found.factor,
        f"dilated_time{suffix}_s": found.duration,
        f"dilation_confirmed{suffix}": None if judgement is None else found.confirmed,
    }


def saving_facts(found: Saving | None) -> dict[str, Any] | None:
    """The saving as plain values; numbers may be nan."""
    if found is None:
        return None
    return {
        "optimum_s": found.optimum,
        "fastest_that_breaks_nothing": found.rival or None,
        "its_time_s": found.rival_duration,
        "saving": found.share,
        "fastest_once_slowed": found.slowed_rival or None,
        "slowed_time_s": found.slowed_duration,
        "saving_against_slowed": found.slowed_share,
    }

"""The verdict on a plan: how long, how near the optimum, what holds it back; as a value, as columns and as JSON.

What a person reads is made of it in ``verdict_text``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from planner.frames import Tabular
from planner.geometry.curve import Curve
from planner.machine.feed_limits import COMMANDS
from planner.machine.limits import Limits
from planner.profile import BOUND_TOLERANCE, FeedrateProfile
from planner.quantity import QUANTITIES
from planner.samples import Samples
from planner.status import Claim
from planner.verify import Report, Row

if TYPE_CHECKING:
    from planner.programs.neighbours import NeighbouringPasses
    from planner.programs.path.smooth_path import ProgramPath
    from planner.verify.certificate import BoundReport

# Rows of a report that are limits of the machine; the others say that a plan is a plan at all, and are counted.
_LIMITS = (COMMANDS[0], COMMANDS[1], *(q.label for q in QUANTITIES[1:]), "jerk at a curvature break")


@dataclass(frozen=True)
class ReserveCost:
    """What a plan pays for its reserve for feed override, and what it gets.

    Attributes
    ----------
    share : float
        Of every jerk limit; a third of it of every acceleration limit.
    without : float
        Duration of the plan without a reserve on the same path, s; nan where there is none to compare with.
    stop_time : float
        From full rate to a feed hold, s, wherever it begins; nan where the reserve is too small for any.
    """

    share: float
    without: float
    stop_time: float


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Tabular):
    """A plan, what was found about it and about the samples of it; as a table, what is used of each limit.

    Attributes
    ----------
    profile : FeedrateProfile
    limits : Limits
        Against which both were checked.
    machine : str
        Where the limits come from.
    samples : Samples
    plan_report, samples_report : Report
    planning_time : float
        s, with the making of the path of a program; nan where the plan was read from a table.
    files : tuple of str
        What was written.
    program : ProgramPath, optional
        The path, where it comes from a part program.
    facts : tuple of (str, str)
        Further lines on where the path comes from, each with its name.
    proof : BoundReport, optional
        What the certificate of the lower bound proves; None where none was given.
    any_path : float
        Of a part program: no motion within its tolerance is faster, whatever its path, s; nan where that is not known.
    passes : NeighbouringPasses, optional
        How equal the feed is at the same place in neighbouring passes of a part program; None where it has none.
    reserve : ReserveCost, optional
        Of a plan with a reserve for feed override; None where it has none.
    """

    profile: FeedrateProfile
    limits: Limits
    machine: str
    samples: Samples
    plan_report: Report
    samples_report: Report
    planning_time: float = math.nan
    files: tuple[str, ...] = ()
    program: ProgramPath | None = None
    facts: tuple[tuple[str, str], ...] = ()
    proof: BoundReport | None = None
    any_path: float = math.nan
    passes: NeighbouringPasses | None = None
    reserve: ReserveCost | None = None

    def columns(self) -> dict[str, NDArray[Any]]:
        """Limit, axis, what is allowed, the share of it that the plan and its samples use, and when most is used."""
        rows = side_by_side(self.reports)
        worst = [max((row for row in pair if row is not None), key=lambda row: row.ratio) for pair in rows]
        used = np.array([[math.nan if row is None else row.ratio for row in pair] for pair in rows])
        words = {name: np.array([getattr(row, name) for row in worst], object) for name in ("limit", "axis", "unit")}
        return {
            "limit": words["limit"],
            "axis": words["axis"],
            "allowed": np.array([row.allowed for row in worst]),
            "unit": words["unit"],
            "plan": used[:, 0],
            "samples": used[:, 1],
            "t_s": np.array([row.t for row in worst]),
            "ok": np.array([all(row is None or row.ok for row in pair) for pair in rows]),
        }

    def __repr__(self) -> str:
        said = "every limit holds" if self.holds else "LIMIT BROKEN"
        # A bound says how near the optimum a plan is only where the plan holds, and somebody computed the bound.
        known = self.holds and self.claim in {Claim.COMPUTED, Claim.CERTIFIED} and self.gap >= -BOUND_TOLERANCE
        gap = f", at most {percent(max(self.gap, 0.0), 2)} above the optimum on its path" if known else ""
        if self.holds and not self.ok:
            said += ", but its lower bound does not"
        return f"Verdict({self.profile.curve.name}: {self.profile.duration:.6g} s{gap};\n        {said})"

    @property
    def reports(self) -> list[tuple[str, Report]]:
        """Both reports, each with the name of what it checks."""
        return [("plan", self.plan_report), ("samples", self.samples_report)]

    @property
    def holds(self) -> bool:
        """Every limit holds, for the plan and for its samples."""
        return self.plan_report.ok and self.samples_report.ok

    @property
    def ok(self) -> bool:
        """Every limit holds, and nothing contradicts the lower bound: neither its certificate nor the plan itself."""
        return self.holds and (self.proof is None or self.proof.ok) and not self.contradicted

    @property
    def contradicted(self) -> bool:
        """A lower bound lies above a plan that keeps every limit: the bound is wrong."""
        return self.holds and (
            self.gap < -BOUND_TOLERANCE or self.profile.duration < self.any_path * (1.0 - BOUND_TOLERANCE)
        )

    @property
    def lower_bound(self) -> float:
        """No plan is faster, s: as far as it was proved, else what the plan says; nan where there is none."""
        return self.profile.lower_bound if self.proof is None else self.proof.proved

    @property
    def claim(self) -> Claim:
        """How the lower bound is known."""
        return self.profile.claim if self.proof is None else Claim.CERTIFIED

    @property
    def report(self) -> Report:
        """The report that decides, for the heads of files: that of the samples where only they break a limit."""
        return self.samples_report if self.plan_report.ok else self.plan_report

    @property
    def gap(self) -> float:
        """Time above the lower bound as a fraction of it; nan where there is none."""
        bound = self.lower_bound
        return self.profile.duration / bound - 1.0 if bound > 0.0 else math.nan

    @property
    def notes(self) -> list[str]:
        """What the planner says of its plan, and why a plan without a jerk limit breaks one."""
        notes = list(self.profile.notes)
        if self.program is not None:  # its stops are told by line, not by the parameter of the path
            told = {f"exact stop at u = {stop.u:.6g}" for stop in self.program.stops}
            notes = [*self.program.notes, *(note for note in notes if note not in told)]
        if not self.profile.status.as_meant:
            sentence = self.profile.status.sentence
            notes.append(f"not the optimum: {sentence}; the gap says how much time may be left in the plan")
        if self.profile.method == "toppra" and not self.ok:
            notes.append("the method toppra knows no jerk limit: compare with its time, but do not cut with its plan")
        return notes


def to_json(verdict: Verdict) -> str:
    """Write the verdict as JSON; a number that is not finite becomes null."""
    profile, limits = verdict.profile, verdict.limits
    facts = {
        "ok": verdict.ok,
        "curve": _curve_facts(profile.curve),
        "machine": verdict.machine,
        "feed_mm_s": limits.feed,
        "rapid_mm_s": limits.rapid,
        "period_s": verdict.samples.period,
        "method": profile.method,
        "duration_s": profile.duration,
        "lower_bound_s": verdict.lower_bound,
        "lower_bound_is": verdict.claim.value,
        "gap": verdict.gap,
        "any_path_s": verdict.any_path,
        "nodes": profile.nodes,
        "samples": verdict.samples.t.size,
        "planning_time_s": verdict.planning_time,
        "checks": {
            "plan": [_row_facts(row) for row in verdict.plan_report.rows],
            "samples": [_row_facts(row) for row in verdict.samples_report.rows],
        },
        "held_back_by": profile.shares(),
        "saved_by_one_percent_s": dict(profile.saved_by_one_percent),
        "notes": verdict.notes,
        "files": list(verdict.files),
    }
    if verdict.proof is not None:
        facts["certificate"] = _proof_facts(verdict.proof)
    if verdict.facts:
        facts["source"] = dict(verdict.facts)
    if verdict.program is not None:
        facts["program"] = program_facts(verdict.program)
    if verdict.reserve is not None:
        reserve = verdict.reserve
        facts["override_reserve"] = {
            "share": reserve.share,
            "without_s": reserve.without,
            "costs_s": profile.duration - reserve.without,
            "costs_share": profile.duration / reserve.without - 1.0,
            "stop_time_s": reserve.stop_time,
        }
    if verdict.passes is not None:
        facts["neighbouring_passes"] = _passes_facts(verdict.passes)
    return json.dumps(_finite(facts), indent=2, allow_nan=False)


def _proof_facts(proof: BoundReport) -> dict[str, Any]:
    return {
        "ok": proof.ok,
        "proved_s": proof.proved,
        "claimed_s": proof.claimed,
        "quadrature_allowance_s": proof.allowance,
        "scale": proof.scale,
        "assumed_stops": list(proof.stops),
        "statement": proof.statement,
    }


def _curve_facts(curve: Curve) -> dict[str, Any]:
    """Name, hash, axes, domain and length of a curve."""
    return {
        "name": curve.name,
        "hash": curve.fingerprint,
        "axes": list(curve.axes),
        "domain": list(curve.domain),
        "length_mm": curve.length,
    }


def program_facts(path: ProgramPath) -> dict[str, Any]:
    """Tolerance and deviation of the path of a part program, and where it stops."""
    return {
        "path": "joint" if path.counts["joint"] else "separate",
        "tolerance_mm": path.tolerance,
        "deviation_mm": path.deviation.largest,
        "deviation_line": path.deviation_line,
        "deviation_share": path.deviation_share,
        "exact_stops": [{"line": stop.line, "u": stop.u, "reason": stop.reason} for stop in path.stops],
        "side": "both" if path.curve.made_within is None else path.curve.made_within.side,
        "overcut_mm": path.overcut,
        **path.counts,
    }


def _passes_facts(passes: NeighbouringPasses) -> dict[str, Any]:
    return {
        "mean": passes.mean,
        "worst": passes.worst,
        "lines": list(passes.lines),
        "feeds_mm_s": list(passes.feeds),
        "places": passes.places,
        "length_mm": passes.length,
    }


def _row_facts(row: Row) -> dict[str, Any]:
    return {
        "limit": row.limit,
        "axis": row.axis,
        "worst": row.worst,
        "allowed": row.allowed,
        "unit": row.unit,
        "ratio": row.ratio,
        "t_s": row.t,
        "u": row.u,
        "ok": row.ok,
    }


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def side_by_side(reports: Sequence[tuple[str, Report]]) -> list[list[Row | None]]:
    """The rows that are shown, in the order of the limits; of each report one, None where it has none."""
    names = dict.fromkeys((row.limit, row.axis) for _, report in reports for row in report.rows if _is_shown(row))
    order = sorted(names, key=lambda name: _LIMITS.index(name[0]) if name[0] in _LIMITS else len(_LIMITS))
    found = [{(row.limit, row.axis): row for row in report.rows} for _, report in reports]
    return [[rows.get(name) for rows in found] for name in order]


def _is_shown(row: Row) -> bool:
    return not row.ok or (row.limit in _LIMITS and math.isfinite(row.allowed))


def percent(share: float, digits: int = 1) -> str:
    """A share as text, never -0%."""
    return f"{100.0 * share + 0.0:.{digits}f}%"

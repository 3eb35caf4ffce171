"""What a plan says of the work that it took: every solve counted, the first one by itself, and what was proven."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import pytest
from cases import DRIVES

from planner import FeedrateProfile, load_curve, plan_feedrate
from planner.plan.solvers import interior as optimal
from planner.plan.solvers import ipopt as nlp
from planner.status import Status


def planned_with(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    intervals: int,
    method: Literal["optimal", "nlp"] = "optimal",
    **found: Any,
) -> tuple[FeedrateProfile, int]:
    """A plan whose solves take 1, 2, 4, ... seconds and say what is given; and how many there were."""
    solver = {"optimal": optimal, "nlp": nlp}[method]
    solve, solves = solver.solve, []

    def timed(*args: Any, **kwargs: Any) -> Any:
        solves.append(2.0 ** len(solves))
        return replace(solve(*args, **kwargs), cpu_s=solves[-1], **found)

    monkeypatch.setattr(solver, "solve", timed)
    return plan_feedrate(load_curve(name), DRIVES, method=method, intervals=intervals), len(solves)


def test_every_solve_is_counted_and_the_first_with_the_coarse_one(monkeypatch: pytest.MonkeyPatch) -> None:
    profile, count = planned_with(monkeypatch, "circle", 400)
    assert count > 2
    assert profile.work.solve_cpu_s == 2.0**count - 1.0
    assert profile.work.first_solve_cpu_s == 3.0  # on the coarse grid and on the wanted one


def test_the_reference_method_has_no_coarse_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    profile, count = planned_with(monkeypatch, "circle", 100, method="nlp")
    assert count > 1
    assert profile.work.solve_cpu_s == 2.0**count - 1.0
    assert profile.work.first_solve_cpu_s == 1.0


@pytest.mark.parametrize(
    ("name", "status", "proven"),
    [("circle", Status.OPTIMAL, True), ("circle", Status.BUDGET, False), ("teardrop", Status.OPTIMAL, False)],
)
def test_only_an_optimum_is_proven_to_be_global(
    monkeypatch: pytest.MonkeyPatch, name: str, status: Status, proven: bool
) -> None:
    """The multipliers of few intervals on a circle are smooth enough; those of a teardrop jump."""
    profile, _ = planned_with(monkeypatch, name, 100, status=status)
    assert profile.work.proven_global is proven

"""The words of a verdict: what is shown, what is summed up, and how a violation is told."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from itertools import takewhile
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest
from cases import drives
from check_plans import with_columns

from feedplan.verdict import Verdict, to_json
from feedplan.verdict_text import quantity, to_text
from interp import replay
from planner import check, load_curve, plan_feedrate
from planner.geometry.tolerance import PathSide, PathTolerance
from planner.programs.neighbours import NeighbouringPasses
from planner.status import Claim, Status
from planner.verify import Report, Row

CURVE = load_curve("teardrop")
LIMITS = drives()


@pytest.fixture(scope="module")
def sound() -> Verdict:
    profile = plan_feedrate(CURVE, LIMITS, intervals=200)
    samples = replay(CURVE, profile)
    return Verdict(profile, LIMITS, "mill", samples, check(CURVE, LIMITS, profile), check(CURVE, LIMITS, samples))


def text_of(verdict: Verdict, width: int = 200) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        return click.unstyle("\n".join(to_text(verdict)))


def with_plan(verdict: Verdict, **changes: Any) -> Verdict:
    return replace(verdict, profile=replace(verdict.profile, **changes))


def with_shares(verdict: Verdict, **shares: float) -> Verdict:
    """A plan of equal intervals of which each limit holds such a share."""
    names = ("none", *shares)
    counts = [round(100_000 * share) for share in shares.values()]
    binding = np.repeat(np.arange(len(names)), [100_000 - sum(counts), *counts]).astype(np.int8)
    t = np.linspace(0.0, 1.0, 100_000)
    columns = {key: np.zeros(100_000) for key in ("u", "u_rate", "u_acceleration", "s", "feed", "acceleration", "jerk")}
    profile = with_columns(verdict.profile, t=t, binding=binding, limit_names=names, **columns)
    return replace(verdict, profile=profile)


def test_in_two_lines_a_plan_is_near_the_optimum_only_where_that_is_known(sound: Verdict) -> None:
    """Neither a claim of a table, nor a bound above the plan, nor one on a plan that breaks a limit says so."""
    near = "above the optimum"
    assert near in repr(sound)
    duration = sound.profile.duration
    broken = replace(sound, samples_report=report_with(sound.samples_report, (0, 1.5, False)))
    for other in (
        with_plan(sound, claim=Claim.TABLE),
        with_plan(sound, lower_bound=math.nan),
        with_plan(sound, lower_bound=2.0 * duration),
        broken,
    ):
        assert near not in repr(other)
        assert f"{duration:.6g} s" in repr(other)
    assert "LIMIT BROKEN" in repr(broken)


def report_with(report: Report, *rows: tuple[int, float, bool]) -> Report:
    """The same report with other ratios in some rows."""
    found = list(report.rows)
    for k, ratio, ok in rows:
        found[k] = replace(found[k], ratio=ratio, worst=ratio * found[k].allowed, ok=ok)
    return replace(report, rows=tuple(found))


def at(report: Report, limit: str, axis: str = "") -> int:
    return next(k for k, row in enumerate(report.rows) if (row.limit, row.axis) == (limit, axis))


def test_a_sound_plan(sound: Verdict) -> None:
    text = text_of(sound)
    assert sound.ok
    assert f"OK  every limit holds, for the plan and for its {sound.samples.t.size} samples" in text
    assert sound.gap == pytest.approx(sound.profile.duration / sound.profile.lower_bound - 1.0, rel=1e-12, abs=0.0)
    assert f"{sound.profile.duration:.6g} s" in text
    assert f"the gap is at most {100.0 * sound.gap:.2f}%" in text
    assert "planned in" not in text
    assert "planned in 0.25 s" in text_of(replace(sound, planning_time=0.25))


@pytest.mark.parametrize("bound", [np.nan, 0.0])
def test_without_a_bound_there_is_no_gap(sound: Verdict, bound: float) -> None:
    verdict = replace(sound, profile=replace(sound.profile, lower_bound=bound))
    assert math.isnan(verdict.gap)
    assert "none from this method" in text_of(verdict)
    assert json.loads(to_json(verdict))["gap"] is None


def test_ten_percent_more_of_the_four_limits_worth_most(sound: Verdict) -> None:
    duration = sound.profile.duration
    worth = {name: 1e-5 * duration * share for name, share in zip("abcdef", (50, 20, 10, 5, 4, 0.9), strict=True)}
    text = text_of(with_plan(sound, saved_by_one_percent=worth))
    shown = ", ".join(f"{name} saves {10.0 * worth[name]:.3g} s" for name in "abcd")
    assert shown in text
    assert "e saves" not in text
    for share, said in ((1.01, True), (0.99, False)):
        one = with_plan(sound, saved_by_one_percent={"jerk X": 1e-5 * duration * share})
        assert ("jerk X saves" in text_of(one)) is said


def test_small_shares_are_summed_up(sound: Verdict) -> None:
    text = text_of(with_shares(sound, feed=0.9, jerk=0.006, velocity=0.003, chord=0.002))
    assert "feed 90.0%, no limit 8.9%, jerk 0.6%, others 0.5%" in text
    assert "others" not in text_of(with_shares(sound, feed=0.9, jerk=0.006))


@pytest.mark.parametrize(("count", "shown"), [(8, 8), (9, 7)])
def test_many_notes_are_cut_short(sound: Verdict, count: int, shown: int) -> None:
    text = text_of(with_plan(sound, notes=tuple(f"note number {k}." for k in range(count))))
    assert [f"note number {k}." in text for k in range(count)] == [k < shown for k in range(count)]
    assert (f"{count - shown} more notes are in --json" in text) is (count > shown)


def test_a_plan_that_is_not_the_optimum_says_so(sound: Verdict) -> None:
    for status in Status:
        notes = with_plan(sound, status=status).notes
        said = any(f"not the optimum: {status.sentence}; the gap" in note for note in notes)
        assert said is (status not in {Status.OPTIMAL, Status.FEASIBLE})


def program_of(
    largest: float, tolerance: float, lines: int, notes: tuple[str, ...] = (), joint: int = 0, side: PathSide = "both"
) -> Any:
    stops = [SimpleNamespace(line=10 * k, u=0.1 * k, reason="corner") for k in range(lines)]
    deviation = SimpleNamespace(largest=largest)
    counts = {"runs": 3, "joint": joint}
    curve = SimpleNamespace(made_within=PathTolerance(tolerance, side=side))
    return SimpleNamespace(
        curve=curve,
        deviation=deviation,
        deviation_line=7,
        tolerance=tolerance,
        stops=stops,
        notes=notes,
        counts=counts,
        overcut=2e-6,
    )


@pytest.mark.parametrize(
    ("largest", "tolerance", "said"),
    [
        (0.0042, 0.01, "4.2 um at most, at line 7; 10 um allowed"),
        (0.0, 0.01, "none; 10 um allowed"),
        (0.0, 0.0, "none"),
    ],
)
def test_how_a_path_keeps_to_its_program(sound: Verdict, largest: float, tolerance: float, said: str) -> None:
    text = text_of(replace(sound, program=program_of(largest, tolerance, 2)))
    assert next(line for line in text.splitlines() if line.startswith("deviation")).split(maxsplit=1)[1].strip() == said


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        (0, "separate, before its feed"),
        (2, "joint, with its feed: 2 of 3 runs from stop to stop"),
        (3, "joint, with its feed: all of 3 runs from stop to stop"),
    ],
)
def test_how_a_path_was_made(sound: Verdict, joint: int, said: str) -> None:
    text = text_of(replace(sound, program=program_of(0.0042, 0.01, 2, joint=joint)))
    assert next(line for line in text.splitlines() if line.startswith("path ")).split(maxsplit=1)[1].strip() == said


def test_the_side_of_a_path_is_told_with_its_overcut(sound: Verdict) -> None:
    told = [text_of(replace(sound, program=program_of(0.004, 0.01, 0, side=side))) for side in ("both", "inside")]
    assert ["inside alone; overcut 0.002 um, measured" in text for text in told] == [False, True]


@pytest.mark.parametrize(("count", "said"), [(8, "60, 70"), (9, "60, 70, ...")])
def test_stops_of_a_program_are_told_by_line(sound: Verdict, count: int, said: str) -> None:
    verdict = with_plan(sound, notes=("exact stop at u = 0.1", "exact stop at u = 0.15"))
    verdict = replace(verdict, program=program_of(0.0, 0.01, count, ("read in inches",)))
    assert verdict.notes == ["read in inches", "exact stop at u = 0.15"]
    wanted = f"exact stops   {count}, corner: after line 0, 10, 20, 30, 40, 50, {said}"
    assert wanted in [line.rstrip() for line in text_of(verdict).splitlines()]


def test_what_is_broken_is_counted_and_the_worst_is_told(sound: Verdict) -> None:
    plan, samples = sound.plan_report, sound.samples_report
    broken = replace(
        sound,
        plan_report=report_with(plan, (at(plan, "jerk", "Y"), 1.02, False)),
        samples_report=report_with(
            samples, (at(samples, "feed"), 1.0000004, False), (at(samples, "acceleration", "X"), 12.34, False)
        ),
    )
    text = text_of(broken)
    row: Row = broken.samples_report.row("acceleration", "X")
    assert not broken.ok
    assert "LIMIT BROKEN" in text
    assert "OK  every" not in text
    assert (
        "1 of the plan, 2 of the samples; the worst is acceleration X of the samples: 12340 mm/s^2 at "
        f"t = {row.t:.6g} s, u = {row.u:.6g}, where 1000 mm/s^2 is allowed"
    ) in text
    cells = {line.split("  ")[0].strip(): line for line in text.splitlines()}
    assert "12.3 x" in cells["acceleration X"]
    assert "102.0%" in cells["jerk Y"]
    assert "> 100.0%" in cells["feed"]
    assert "> " not in cells["jerk Y"]
    for side in ("plan_report", "samples_report"):
        assert not replace(sound, **{side: getattr(broken, side)}).ok  # type: ignore[arg-type]
    facts = json.loads(to_json(broken))
    assert facts["ok"] is False
    assert sum(not row["ok"] for row in facts["checks"]["plan"]) == 1


def test_limits_that_are_absent_are_not_shown(sound: Verdict) -> None:
    lines = [line.split("  ")[0].strip() for line in text_of(sound).splitlines()]
    assert "jerk X" in lines
    assert not {"chord error", "tangential jerk", "path end"} & set(lines)
    report = sound.plan_report
    broken = report_with(report, (at(report, "path end"), np.inf, False))
    assert "path end" in text_of(replace(sound, plan_report=broken))
    assert "broken" in text_of(replace(sound, plan_report=broken))


@pytest.mark.parametrize(
    ("value", "said"), [(np.inf, "none"), (-np.inf, "-inf mm"), (1234567.0, "1.23457e+06 mm"), (0.5, "0.5 mm")]
)
def test_quantities(value: float, said: str) -> None:
    assert quantity(value, "mm") == said
    assert quantity(0.5, "") == "0.5"


@pytest.mark.parametrize(
    ("claim", "said"), [(Claim.TABLE, "the claim of the table is false"), (Claim.COMPUTED, "please report it")]
)
def test_a_bound_above_a_sound_plan_is_no_ok(sound: Verdict, claim: Claim, said: str) -> None:
    above = replace(sound.profile, lower_bound=(1.0 + 3e-6) * sound.profile.duration, claim=claim)
    verdict = replace(sound, profile=above)
    assert verdict.contradicted
    assert not verdict.ok
    text = text_of(verdict)
    assert "BOUND CONTRADICTED" in text
    assert said in text
    assert "OK " not in text
    assert replace(sound, profile=replace(above, lower_bound=(1.0 + 1e-6) * sound.profile.duration)).ok


def test_a_plan_below_the_bound_is_told_to_break_its_limits(sound: Verdict) -> None:
    above = replace(sound.profile, lower_bound=1.01 * sound.profile.duration)
    broken = report_with(sound.plan_report, (0, 1.5, False))
    text = text_of(replace(sound, profile=above, plan_report=broken))
    assert "no plan within the limits is as fast as this one, which breaks them" in text
    assert "the gap is at most" not in text
    assert "the gap is at most" in text_of(sound)


def test_the_table_of_limits_has_two_spaces_between_its_columns(sound: Verdict) -> None:
    lines = text_of(sound, width=80).splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("limit "))
    table = [line.rstrip() for line in takewhile(str.strip, lines[first:])]
    rows = [re.split(r" {2,}", line) for line in table]
    assert rows[0] == ["limit", "allowed", "plan", "samples", "worst at"]
    assert {len(row) for row in rows} == {5}
    assert len(rows) == 1 + 7  # the feed, and of two axes velocity, acceleration, jerk
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for line, (name, *numbers) in zip(table, rows, strict=True):
        cells = [name.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(numbers, widths[1:], strict=True))]
        assert line == "  ".join(cells)


def test_what_is_broken_stands_right_below_the_word(sound: Verdict) -> None:
    broken = replace(sound, plan_report=report_with(sound.plan_report, (0, 1.5, False)))
    lines = [line.rstrip() for line in text_of(broken).splitlines()]
    assert lines[lines.index("LIMIT BROKEN") + 1].startswith("  1 of the plan; the worst is")


def test_a_broken_limit_is_told_before_a_bound_that_is_not_proved(sound: Verdict) -> None:
    proof: Any = SimpleNamespace(
        ok=False, proved=0.5, claimed=0.6, statement="no plan", refusal="proves 0.5 s, not 0.6 s"
    )
    proof.allowance, proof.scale, proof.stops = 0.0, 1.0, ()
    unproved = replace(sound, proof=proof)
    lines = [line.rstrip() for line in text_of(unproved).splitlines()]
    assert (unproved.holds, unproved.ok) == (True, False)
    assert lines[-2:] == ["NOT PROVED", "  proves 0.5 s, not 0.6 s"]
    assert json.loads(to_json(unproved))["lower_bound_is"] == "proved by the certificate"
    broken = replace(unproved, plan_report=report_with(sound.plan_report, (0, 1.5, False)))
    assert "LIMIT BROKEN" in text_of(broken)
    assert "NOT PROVED" not in text_of(broken)
    proved = replace(sound, proof=SimpleNamespace(**vars(proof) | {"ok": True}))  # type: ignore[arg-type]
    assert proved.ok
    assert "OK  every limit holds" in text_of(proved)


def test_feeds_in_neighbouring_passes_are_told_where_there_are_any(sound: Verdict) -> None:
    """Average, largest and the two lines of it, in text and in JSON; nothing where no passes lie side by side."""
    assert "passes" not in text_of(sound)
    assert "neighbouring_passes" not in json.loads(to_json(sound))
    verdict = replace(sound, passes=NeighbouringPasses(0.00076, 0.0138, (2146, 1482), (95.5, 94.19), 1504, 752.0))
    assert (
        "feeds at the same place differ by 0.076% on average and 1.38% at most, between lines 2146 and 1482 "
        "(95.5 and 94.19 mm/s)"
    ) in text_of(verdict)
    assert json.loads(to_json(verdict))["neighbouring_passes"] == {
        "mean": 0.00076,
        "worst": 0.0138,
        "lines": [2146, 1482],
        "feeds_mm_s": [95.5, 94.19],
        "places": 1504,
        "length_mm": 752.0,
    }

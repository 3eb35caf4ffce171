"""What a plan says of itself: words that files keep, a sentence each, and the sum of the work on its sections."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from planner.status import Claim, Status, Work


def test_every_status_has_a_word_and_a_sentence_of_its_own() -> None:
    assert len({status.value for status in Status}) == len({status.sentence for status in Status}) == len(Status)
    assert all(status.value and status.sentence[0].islower() and status.sentence[-1] != "." for status in Status)
    assert len({claim.value for claim in Claim}) == len(Claim)


def test_what_a_method_looks_for_is_no_stall() -> None:
    assert {status for status in Status if status.as_meant} == {Status.OPTIMAL, Status.FEASIBLE}
    assert {status for status in Status if status.stalled} == {Status.SINGULAR, Status.NO_STEP, Status.TOO_MANY}


def test_the_work_on_sections_is_summed_up_and_the_worst_of_them_kept() -> None:
    one = Work(1, 100, 20, 3, 0.5, 0.25, gap=1e-6, residual=np.nan, slowdown=1.5, proven_global=True)
    two = Work(1, 50, 10, 1, 0.25, 0.125, gap=np.nan, residual=np.nan, slowdown=1.0, proven_global=False)
    whole = Work.of_all(iter([one, two]), planning_s=2.0)
    expected = Work(2, 150, 30, 3, 0.75, 0.375, 2.0, 1e-6, np.nan, 1.5, False)
    for field in fields(Work):
        assert getattr(whole, field.name) == pytest.approx(getattr(expected, field.name), abs=0.0, rel=0.0, nan_ok=True)
    assert Work.of_all([one, one], planning_s=0.0).proven_global

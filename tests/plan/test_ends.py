"""What is asked for at the ends of a section, and what a plan does there."""

from __future__ import annotations

import math

import pytest
from cases import drives

from planner import load_curve, plan_feedrate
from planner.plan.ends import FREE, REST, Feed, end_with, feed_at


def test_no_feed_is_rest() -> None:
    assert end_with(0.0) is end_with(-0.0) is REST
    assert end_with(5.0) == Feed(5.0)
    assert end_with(5.0, -3.0) == Feed(5.0, -3.0)


def test_ends_of_a_kind_are_equal_and_the_kinds_differ() -> None:
    assert Feed(5.0) != Feed(5.0, 0.0)
    assert len({REST, FREE, Feed(5.0), Feed(5.0, 1.0)}) == 4


def test_the_feed_of_an_end_for_messages() -> None:
    assert (feed_at(REST), feed_at(Feed(5.0, 1.0))) == (0.0, 5.0)
    assert math.isnan(feed_at(FREE))


@pytest.mark.parametrize("method", ["optimal", "nlp"])
def test_a_plan_does_what_is_asked_for(method: str) -> None:
    """From rest, from a feed with or without its acceleration, and around a circle at a feed of its own."""
    curve, limits = load_curve("circle"), drives()
    asked = {"start_feed": 30.0, "end_feed": 20.0, "start_acceleration": 100.0}
    profile = plan_feedrate(curve, limits, method=method, intervals=60, **asked)  # type: ignore[arg-type]
    ends = (profile.feed[0], profile.feed[-1], profile.acceleration[0])
    assert ends == pytest.approx((30.0, 20.0, 100.0), rel=1e-4)
    around = plan_feedrate(curve, limits, method=method, intervals=60, periodic=True)  # type: ignore[arg-type]
    assert around.feed[0] == pytest.approx(around.feed[-1], rel=1e-6)
    assert around.feed[0] > 30.0
    assert around.origin.periodic is True

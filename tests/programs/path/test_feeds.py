"""F words as feed caps: the feed at every place is that of its block, in as few caps as there are changes."""

import numpy as np
import pytest

from planner.geometry.nurbs import NurbsCurve
from planner.machine.feed_limits import command_kind, commanded_feed, largest_command
from planner.machine.limits import Limits
from planner.programs.path.feeds import caps_of_blocks
from planner.verify.scan import machine_caps


@pytest.mark.parametrize(
    ("feed", "changes"),
    [([7.0], 0), ([7.0, 7.0, 7.0], 0), ([5.0, 5.0, 9.0], 1), ([5.0, np.inf, np.inf, 5.0], 2), ([1.0, 2.0, 3.0], 2)],
)
def test_every_place_has_the_feed_of_its_block(feed, changes):
    edges = np.cumsum([0.25, *(1.0 + 0.5 * k for k in range(len(feed)))])
    caps = caps_of_blocks(edges, np.array(feed), np.zeros(len(feed), dtype=bool))
    assert caps.feed.size == changes + 1
    assert (caps.edges[0], caps.edges[-1]) == (edges[0], edges[-1])
    inside = 0.5 * (edges[1:] + edges[:-1])
    assert caps.at(inside, False).tolist() == feed
    # On an edge the side decides.
    assert caps.at(edges[1:-1], True).tolist() == feed[:-1]
    assert caps.at(edges[1:-1], False).tolist() == feed[1:]


def test_limits_of_a_machine_are_not_of_angles():
    """They hold where the cap is of lengths: the feed below the cap, that of rapids where there is none."""
    feed, angular = np.array([5.0, np.inf, 5.0, 50.0, np.inf]), np.array([False, False, True, True, True])
    caps = caps_of_blocks(np.arange(6.0), feed, angular)
    assert caps.commanded(3.0, 7.0).tolist() == [3.0, 7.0, 5.0, 50.0, np.inf]
    curve = line_of_caps(caps)
    limits = Limits(3.0, [9.0, 9.0], [9.0, 9.0], [9.0, 9.0], rapid=7.0)
    u = np.arange(5.0) + 0.5
    assert commanded_feed(curve, limits, u).tolist() == [3.0, 7.0, 5.0, 50.0, np.inf]
    assert command_kind(curve, limits, u).tolist() == [0, 2, 1, 1, 2]
    assert largest_command(curve, limits) == np.inf
    assert machine_caps(caps, limits).feed.tolist() == [3.0, 7.0, np.inf, np.inf, np.inf]


def line_of_caps(caps):
    """A straight line with caps."""
    curve = NurbsCurve([[0, 0], [5, 0]], [0, 0, 5, 5], 1)
    object.__setattr__(curve, "feed_caps", caps)
    return curve

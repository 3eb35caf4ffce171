"""F words as feed caps: the feed at every place is that of its block, in as few caps as there are changes."""

import numpy as np
import pytest

from planner.programs.path.feeds import caps_of_blocks


@pytest.mark.parametrize(
    ("feed", "changes"),
    [([7.0], 0), ([7.0, 7.0, 7.0], 0), ([5.0, 5.0, 9.0], 1), ([5.0, np.inf, np.inf, 5.0], 2), ([1.0, 2.0, 3.0], 2)],
)
def test_every_place_has_the_feed_of_its_block(feed, changes):
    edges = np.cumsum([0.25, *(1.0 + 0.5 * k for k in range(len(feed)))])
    caps = caps_of_blocks(edges, np.array(feed))
    assert caps.feed.size == changes + 1
    assert (caps.edges[0], caps.edges[-1]) == (edges[0], edges[-1])
    inside = 0.5 * (edges[1:] + edges[:-1])
    assert caps.at(inside, False).tolist() == feed
    # On an edge the side decides.
    assert caps.at(edges[1:-1], True).tolist() == feed[:-1]
    assert caps.at(edges[1:-1], False).tolist() == feed[1:]

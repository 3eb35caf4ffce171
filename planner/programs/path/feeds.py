"""F words of a part program as feed caps of its path."""

from __future__ import annotations

import numpy as np

from planner.geometry.curve import FeedCaps
from planner.types import BoolArray, FloatArray


def caps_of_blocks(edges: FloatArray, feed: FloatArray, angular: BoolArray) -> FeedCaps:
    """Feed caps along a path from the feeds of its blocks; blocks that follow one another at one feed share a cap.

    Parameters
    ----------
    edges : (n + 1,) array
        Curve parameters at which the blocks begin, and the end of the last one.
    feed : (n,) array
        Commanded feed of each block, mm/s; inf for a rapid.
    angular : (n,) bool array
        Blocks whose feed is in degrees/s.
    """
    first = np.concatenate([[0], 1 + np.flatnonzero((feed[1:] != feed[:-1]) | (angular[1:] != angular[:-1]))])
    return FeedCaps(np.append(edges[first], edges[-1]), feed[first], angular[first] if angular.any() else None)

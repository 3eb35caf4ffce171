"""Chains of paths: found whatever the order, the direction and the rounding of the drawing."""

from itertools import pairwise

import numpy as np
import pytest

from planner.geometry.drawing.bezier_pieces import line
from planner.geometry.drawing.drawing_chains import find_chains
from planner.geometry.drawing.drawn_entities import DrawnEntity


def entity(start, end, name=""):
    return DrawnEntity(
        f"part.dxf: LINE #{name}", "0", list(line(np.array(start, dtype=float), np.array(end, dtype=float)))
    )


def drawn(corners, rng):
    """The sides of a polygon as lines, their ends off by less than a joint takes."""
    sides = pairwise(corners)
    return [entity(*(p + rng.uniform(-2e-4, 2e-4, 3) for p in side)) for side in sides]


@pytest.mark.parametrize("seed", range(20))
def test_every_chain_is_found_in_any_order_and_direction(seed):
    rng = np.random.default_rng(seed)
    lines, truth = [], []
    for k in range(rng.integers(1, 6)):
        corners = np.cumsum(rng.uniform(1, 9, (rng.integers(2, 12), 3)), axis=0)
        corners[:, 0] += 1000 * k
        closed = bool(rng.integers(2)) and len(corners) > 2
        if closed:
            corners[-1] = corners[0]
        truth.append((len(lines), len(corners) - 1, closed))
        lines += drawn(corners, rng)
    way = rng.permutation(len(lines))
    flipped = rng.integers(0, 2, len(lines)).astype(bool)
    shuffled = [
        DrawnEntity("", "0", [lines[k].pieces[0].reversed()]) if flip else lines[k]
        for k, flip in zip(way, flipped, strict=True)
    ]
    chains = find_chains(shuffled, "part.dxf")
    position = {int(k): at for at, k in enumerate(way)}
    expected = sorted(
        (min(position[k] for k in range(first, first + count)), count, closed) for first, count, closed in truth
    )
    index = {id(one): at for at, one in enumerate(shuffled)}
    found = [(min(index[id(one)] for one, _ in chain.entities), len(chain.entities), chain.closed) for chain in chains]
    assert found == expected
    for chain in chains:
        pieces = chain.pieces
        gaps = [np.linalg.norm(a.end - b.start) for a, b in zip(pieces, pieces[1:] + pieces[:1], strict=True)]
        assert max(gaps[: None if chain.closed else -1], default=0.0) < 1e-3
        first, backwards = chain.entities[0]
        if chain.closed:  # it begins with the first in the file, as drawn
            assert (index[id(first)], backwards) == (min(index[id(one)] for one, _ in chain.entities), False)
        else:
            last = index[id(chain.entities[-1][0])]
            ends = [(backwards, index[id(first)]), (not chain.entities[-1][1], last)]
            assert ends[0] == min(ends)


def test_the_order_does_not_depend_on_what_was_read_before():
    square = [((0, 0, 0), (1, 0, 0)), ((1, 1, 0), (1, 0, 0)), ((1, 1, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, 0))]
    orders = set()
    for _ in range(50):
        chain = find_chains([entity(*side, name=str(k)) for k, side in enumerate(square)], "part.dxf")[0]
        orders.add(tuple((one.label, backwards) for one, backwards in chain.entities))
    assert orders == {tuple((f"part.dxf: LINE #{k}", k == 1) for k in range(4))}


def test_three_ends_of_which_two_are_farther_apart_than_a_joint_are_one_place():
    """The edge miner by itself would run in a circle for ever: a, b, c, b, c ..."""
    lines = [entity((0, 0, 0), (10, 0, 0)), entity((10.0008, 0, 0), (20, 0, 0)), entity((20, 0, 0), (10.0016, 0, 0))]
    chains = find_chains(lines, "part.dxf")
    assert [len(chain.entities) for chain in chains] == [1, 2]


def test_chains_end_where_more_than_two_meet_and_loops_come_back_to_it():
    lines = [
        entity((-5, 0, 0), (0, 0, 0)),
        entity((0, 0, 0), (3, 4, 0)),
        entity((3, 4, 0), (6, 0, 0)),
        entity((6, 0, 0), (0, 0, 0)),
    ]
    chains = find_chains(lines, "part.dxf")
    assert [(len(chain.entities), chain.closed) for chain in chains] == [(1, False), (3, True)]


def test_a_long_drawing_takes_no_time_to_speak_of():
    import time

    began = time.process_time()
    chains = find_chains([entity((k, k % 7, 0), (k + 1, (k + 1) % 7, 0)) for k in range(5000)], "part.dxf")
    assert (len(chains), len(chains[0].entities)) == (1, 5000)
    assert time.process_time() - began < 10.0

"""A motion as pieces of a chain with their law: it is the same motion, at every time."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from joint_motions import corner, motion_of, run_of, there_and_back

from planner.errors import SolverError
from planner.geometry.blend import Legs
from planner.geometry.chain import ChainCurve, Kind
from planner.geometry.differential import chain_rule
from planner.programs.path.joint_pieces import pieces_of


def chain_of(part):
    """The pieces as a curve."""
    legs = part.kind == Kind.LEG
    vectors = np.zeros((int(legs.sum()), 4, part.powers.shape[1]))
    vectors[:, 0], vectors[:, 3] = part.powers[legs, :, 0], part.powers[legs, :, 1]
    row = np.where(legs, np.cumsum(legs) - 1, np.cumsum(~legs) - 1)
    return ChainCurve(
        part.edges, part.kind.astype(np.int8), row, np.zeros(row.size), Legs(vectors, np.zeros((len(vectors), 2))), None,
        part.powers[~legs], part.edges[1:-1], part.edges[1:-1][part.turns], np.empty(0),
    )  # fmt: skip


def moved(part, t):
    """Position and three time derivatives by curve and law."""
    u, *rates = part.law.at(t)
    d = chain_of(part).derivatives(np.clip(u, 0.0, part.edges[-1]), 3)
    return np.stack([d[0], *chain_rule(d[1], d[2], d[3], *(rate[:, None] for rate in rates))])


def inner_times(motion, count=7):
    """Times inside the pieces, where the jerk is one."""
    share = (np.arange(count) + 0.5) / count
    return (motion.t[:-1, None] + np.diff(motion.t)[:, None] * share).reshape(-1)


@pytest.mark.parametrize(("made", "allowed"), [(corner, 1e-9), (there_and_back, 1e-9)])
def test_curve_and_law_are_the_motion(made, allowed):
    run, motion = made()
    part = pieces_of(run, motion)
    t = inner_times(motion)
    scale = np.array([1e-12, 1e-10, 1e-7, 1e-4])
    away = np.abs(moved(part, t) - motion.at(t)).max(axis=(1, 2))
    assert (away <= scale).all(), away
    assert part.law.duration == pytest.approx(motion.duration, rel=1e-14)


def test_a_corner_begins_and_ends_with_legs_and_goes_like_time_between():
    part = pieces_of(*corner())
    assert part.kind.tolist() == [Kind.LEG, *[Kind.SPAN] * 4, Kind.LEG]
    assert not part.turns.any()
    curve = chain_of(part)
    # C2 where spans join; where a leg begins the path goes on straight.
    assert [(b.parametric, b.geometric) for b in curve.breaks] == [(0, 3), (2, 2), (2, 2), (2, 2), (0, 3)]
    # the law is linear on spans
    middle = (part.law.u > part.edges[1]) & (part.law.u < part.edges[5])
    assert (part.law.u_acceleration[middle] == 0.0).all()


def test_a_single_line_is_one_leg():
    _run, motion = corner()
    jerks = motion.jerk[:4] * [1.0, 0.0]
    jerks = np.stack([jerks[:, 0], 2.0 * jerks[:, 0]], axis=1)
    alone = motion_of([0.01] * 4, jerks, [0] * 4)
    part = pieces_of(run_of([[0.0, 0.0], alone.position[-1]]), alone)
    assert part.kind.tolist() == [Kind.LEG]
    assert part.edges[-1] == pytest.approx(np.hypot(*alone.position[-1]), rel=1e-14)
    assert part.law.t.tolist() == alone.t.tolist()


def test_a_piece_without_a_length_is_none():
    run, motion = corner()
    h, j = np.insert(np.diff(motion.t), 3, 1e-16), np.insert(motion.jerk, 3, 0.0, axis=0)
    part = pieces_of(run, motion_of(h, j, [0, 0, 0, 1, 1, 1, 1]))
    assert part.law.u == pytest.approx(pieces_of(run, motion).law.u, rel=1e-12)
    assert part.ends == pytest.approx(pieces_of(run, motion).ends, rel=1e-12)


@pytest.mark.parametrize("early", [0.0, 0.003, -0.003, 1e-9])
def test_a_reversal_is_cut_where_the_speed_is_zero(early):
    run, motion = there_and_back(early)
    part = pieces_of(run, motion)
    assert part.kind.tolist() == [Kind.LEG, Kind.LEG]
    assert part.turns.tolist() == [True]
    far = run.lengths[0]
    assert part.edges == pytest.approx([0.0, far, 2.0 * far], rel=1e-9)
    at = np.flatnonzero(part.law.u == part.edges[1])
    assert at.size == 2
    assert part.law.u_rate[at].tolist() == [0.0, 0.0]
    # it slows down before and gains speed after: the acceleration of the axis goes on
    assert part.law.u_acceleration[at] == pytest.approx([-200.0, 200.0])
    t = inner_times(motion)
    assert np.abs(moved(part, t)[:3] - motion.at(t)[:3]).max() < 1e-6
    assert np.abs(moved(part, t)[0] - motion.at(t)[0]).max() < 1e-12


def test_blocks_end_at_their_vertices_and_the_abscissa_rises():
    run, motion = corner()
    part = pieces_of(run, motion)
    vertex = int(np.flatnonzero(np.diff(motion.leg))[0]) + 1
    assert part.ends.size == 3
    assert part.law.at(motion.t[[vertex]])[0] == pytest.approx(part.ends[1], rel=1e-14)
    assert (np.diff(part.at) > 0.0).all()
    assert (np.diff(part.abscissa) > 0.0).all()
    length = run.lengths
    assert np.interp(part.ends, part.at, part.abscissa) == pytest.approx([0.0, length[0], length.sum()])


def test_a_motion_that_does_not_rest_is_refused():
    run, motion = corner()
    jerk = motion.jerk.copy()
    jerk[-1, 0] = 5000.0
    with pytest.raises(SolverError, match="begin and end at rest"):
        pieces_of(run, motion_of(np.diff(motion.t), jerk, motion.leg))


@given(seed=st.integers(0, 10**6), pieces=st.integers(3, 12))
def test_any_motion_is_kept(seed, pieces):
    rng = np.random.default_rng(seed)
    h = rng.uniform(1e-3, 2e-2, pieces)
    half = rng.uniform(-2e4, 2e4, (pieces, 3))
    # to and fro in time: at rest again at the end
    jerks = np.concatenate([half, -half[::-1]])
    jerks = np.concatenate([jerks, -jerks])
    h = np.concatenate([h, h[::-1], h, h[::-1]])
    motion = motion_of(h, jerks, np.repeat([0, 1], 2 * pieces))
    end = motion.position[-1]
    middle = motion.position[2 * pieces]
    assume(np.sqrt(np.sum(motion.velocity[1:-1] ** 2, axis=1)).min() > 1e-2)
    assume(min(np.abs(middle).max(), np.abs(end - middle).max()) > 1e-3)
    assert np.abs(motion.acceleration[-1]).max() < 1e-9
    assert np.abs(motion.velocity[-1]).max() < 1e-9
    part = pieces_of(run_of([[0.0, 0.0, 0.0], middle, end]), motion)
    t = inner_times(motion, 3)
    away = np.abs(moved(part, t) - motion.at(t)).max(axis=(1, 2))
    largest = [max(1.0, np.abs(values).max()) for values in motion.at(t)]
    assert (away <= np.array([1e-12, 1e-10, 1e-8, 1e-6]) * largest).all()

"""A motion found by the joint solver as pieces of a chain, and the time law that goes with them.

The path is the motion's own cubics, never refitted.  Where the motion bends, a piece p + v h + a h^2 / 2 + j h^3 / 6 is a
span of the parameter u = u0 + c h, c the mean feed of the run: the law is linear there, and the path C2 in u.  Where v, a
and j are parallel it is a straight line and may be a leg by its length x, with the cubic law x(h): so are the first and the
last piece, at whose ends u = c h would have no tangent, and all such pieces where the motion is on one line or turns back on
itself.  There the speed is 0 and the acceleration is not: both legs end at a corner of the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import SolverError
from planner.geometry.chain import Kind
from planner.geometry.differential import dot
from planner.joint.joint_run import JointMotion, JointRun
from planner.law import TimeLaw
from planner.types import BoolArray, FloatArray, IntArray

# Parts of v and a across a line that are rounding, well below the steps that a check sees: against the largest on the piece,
# beside a rest on the run.  With these at both ends the jerk is along it too.
_STRAIGHT = (1e-10, 1e-8)
_SAME_WAY = 1e-9  # of the direction
_NEAR = 1e-2  # of a piece: nearer to a turn no node stands, since digits of u would be worth a jerk
_DOUBLE = 1e-6  # of the jerk: what rounding leaves of a double root
_MAX_SLOWED = 1e-3
_BETWEEN = np.array([0.0, 0.1, 0.3, 0.6])  # of a piece: where the abscissa is looked at
_EMPTY = 1e-13  # of the duration: a piece that rounding left a length
_FOOT_PASSES = 6  # of Newton, to the nearest point of a block


@dataclass(frozen=True, eq=False)
class JointPart:
    """A run of blocks as pieces of a chain, k of them; parameters count from its start.

    Attributes
    ----------
    edges : (k + 1,) array
        Parameters at which the pieces join, mm, from 0.
    kind : (k,) int array
        ``Kind.LEG`` or ``Kind.SPAN`` each.
    powers : (k, d, 5) array
        Ascending powers, of spans over their share in [0, 1], of legs over the distance from their start, mm; in mm and
        degrees.
    turns : (k - 1,) bool array
        Edges at which the motion turns back.
    at, abscissa : (n,) arrays
        Parameters, and the distance along the blocks that goes with each, both increasing; the ends of the blocks are among
        them.
    ends : (b + 1,) array
        Parameters at which the blocks begin and end.
    law : TimeLaw
    iterations : int
        Of the solver.
    """

    edges: FloatArray
    kind: IntArray
    powers: FloatArray
    turns: BoolArray
    at: FloatArray
    abscissa: FloatArray
    ends: FloatArray
    law: TimeLaw
    iterations: int


def pieces_of(run: JointRun, motion: JointMotion) -> JointPart:
    """Take a motion as pieces.

    Raises
    ------
    SolverError
        If the motion does not begin and end at rest, on straight pieces.
    """
    t, state, jerk, leg = _cut_where_turning(motion)
    step = np.diff(t)
    straight, along, length = _straight(state, jerk, step)
    if not (straight[0] and straight[-1] and _rests(motion)):
        raise SolverError("the motion found does not begin and end at rest")
    pace = float(run.lengths.sum() / t[-1])
    # Legs go on as long as their direction does.
    on = _goes_on(along)
    if not (straight.all() or (straight[1:] & straight[:-1] & ~on).any()):
        # A leg of several pieces has the direction of one: the last digits of it are worth a jerk at its other end.
        straight[1:-1] = False
    new = np.concatenate([[True], ~(straight[1:] & straight[:-1] & on)])
    first = np.flatnonzero(new)
    last = np.append(first[1:], step.size)
    kind = np.where(straight[first], Kind.LEG, Kind.SPAN)
    width = np.where(straight, length, pace * step)
    u = np.concatenate([[0.0], np.cumsum(width)])
    powers = np.zeros((first.size, motion.position.shape[1], 5))
    powers[:, :, 0] = state[0, first]
    legs = kind == Kind.LEG
    powers[legs, :, 1] = along[first[legs]]
    h = step[first[~legs], None]
    for order, column in enumerate((state[1, first], 0.5 * state[2, first], jerk[first] / 6.0), start=1):
        powers[~legs, :, order] = column[~legs] * h**order
    turns = straight[first[1:] - 1] & straight[first[1:]]
    law = _law(t, u, (state, straight, along), pace)
    if turns.any():
        law = _within_jerk(law, run, (u, straight, along))
    edges = u[np.append(first, last[-1])]
    begins = np.flatnonzero(np.diff(leg, prepend=-1, append=-1))
    at, abscissa = _abscissae(run, (t, u), (state, jerk, leg), straight)
    return JointPart(edges, kind, powers, turns, at, abscissa, u[begins], law, motion.iterations)


def _rests(motion: JointMotion) -> bool:
    """Whether a motion begins and ends at rest, but for rounding."""
    sizes = zip(_STRAIGHT, (motion.velocity, motion.acceleration), strict=True)
    return all(bool(np.abs(rates[[0, -1]]).max() <= share * np.abs(rates).max()) for share, rates in sizes)


def _cut_where_turning(motion: JointMotion) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Nodes of a motion, with those at which it turns back: t, position with two derivatives (3, n, d), jerk, block."""
    kept = np.append(np.diff(motion.t) > _EMPTY * motion.duration, True)
    t, jerk, leg = motion.t[kept], motion.jerk[kept[:-1]], motion.leg[kept[:-1]]
    state = np.stack([motion.position, motion.velocity, motion.acceleration])[:, kept]
    state[1:, [0, -1]] = 0.0  # but for rounding
    straight = _straight(state, jerk, np.diff(t))[0]
    straight[[0, -1]] = False  # from rest, and to it
    new = []
    for i in np.flatnonzero(straight):
        step = float(t[i + 1] - t[i])
        for h in _turning_times(state[:, i], jerk[i], step):
            found = motion.at(t[i] + np.array([h]))[:3, 0]
            found[1] = 0.0
            if _NEAR * step < h < (1.0 - _NEAR) * step:
                new.append((i, t[i] + h, found))
            else:  # as good as at a node
                node = i + int(h > 0.5 * step)
                t[node], state[:, node] = t[i] + h, found
    if not new:
        return t, state, jerk, leg
    at = np.array([i for i, _, _ in new])
    return (
        np.insert(t, at + 1, [time for _, time, _ in new]),
        np.insert(state, at + 1, np.stack([found for _, _, found in new], axis=1), axis=1),
        np.insert(jerk, at + 1, jerk[at], axis=0),
        np.insert(leg, at + 1, leg[at]),
    )


def _turning_times(state: FloatArray, jerk: FloatArray, step: float) -> list[float]:
    """Times within a straight piece at which its speed passes through 0."""
    _, v, a = state
    axis = int(np.argmax(np.abs(v) + np.abs(a) * step + np.abs(jerk) * step**2))
    roots = np.roots([0.5 * jerk[axis], a[axis], v[axis]])
    inside = [float(root.real) for root in roots if root.imag == 0.0 and 0.0 <= root.real <= step]
    # A double root touches 0 and does not turn.
    return [h for h in sorted(inside) if abs(a[axis] + jerk[axis] * h) > _DOUBLE * abs(jerk[axis]) * step]


def _straight(state: FloatArray, jerk: FloatArray, step: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Pieces on which v, a and j are parallel; the direction of each, (n, d), and its length."""
    h = step[:, None]
    along = h * (state[1, :-1] + h * (0.5 * state[2, :-1] + h * (jerk / 6.0)))
    length = np.sqrt(_squares(along))
    # What rounding leaves at the rests must not turn the tangent at their other ends.
    along[[0, -1]] = state[1, [1, -2]]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.nan_to_num(along / np.sqrt(_squares(along))[:, None])
    straight = length > 0.0
    for share, vectors in zip(_STRAIGHT, state[1:], strict=True):
        size = np.sqrt(_squares(vectors))
        own = np.maximum(size[:-1], size[1:])
        own[[0, -1]] = size.max()
        for part in (vectors[:-1], vectors[1:]):
            across = part - np.sum(part * along, axis=1)[:, None] * along
            straight &= _squares(across) <= (share * own) ** 2
    return straight, along, length


def _goes_on(along: FloatArray) -> BoolArray:
    """Whether the direction of each piece is that of the one before it."""
    return np.asarray(np.abs(along[1:] - along[:-1]).max(axis=1) < _SAME_WAY)


def _squares(vectors: FloatArray) -> FloatArray:
    return np.asarray(dot(vectors, vectors))


def _law(t: FloatArray, u: FloatArray, parts: tuple[FloatArray, BoolArray, FloatArray], pace: float) -> TimeLaw:
    """The parameter over time: linear on spans, by the length on legs; two nodes where one becomes the other."""
    state, straight, along = parts
    sides = []
    for side in (slice(0, -1), slice(1, None)):
        rate, acceleration = (np.sum(state[k, side] * along, axis=1) for k in (1, 2))
        sides.append([np.where(straight, rate, pace), np.where(straight, acceleration, 0.0)])
    (rate, acceleration), (rate_after, acceleration_after) = sides[1], sides[0]
    turned = straight[1:] & straight[:-1] & ~_goes_on(along)
    rate[:-1][turned] = rate_after[1:][turned] = 0.0
    double = np.flatnonzero((straight[1:] != straight[:-1]) | turned) + 1
    node = np.insert(np.arange(t.size), double, double)
    second = np.zeros(node.size, dtype=np.bool_)
    second[double + np.arange(double.size) + 1] = True
    after = np.minimum(node, t.size - 2)
    before = np.maximum(node - 1, 0)
    right = second | (node == 0)
    return TimeLaw(
        t[node],
        u[node],
        np.where(right, rate_after[after], rate[before]),
        np.where(right, acceleration_after[after], acceleration[before]),
    )


def _within_jerk(law: TimeLaw, run: JointRun, places: tuple[FloatArray, BoolArray, FloatArray]) -> TimeLaw:
    """Slow a law down by what moving nodes to the places at which it turns made of the jerk on its legs."""
    u, straight, along = places
    i = np.flatnonzero(np.diff(law.t) > 0.0)
    piece = np.clip(np.searchsorted(u, 0.5 * (law.u[i] + law.u[i + 1])) - 1, 0, straight.size - 1)
    i, piece = i[straight[piece]], piece[straight[piece]]
    c, h = law.coefficients(i), np.diff(law.t)[i]
    jerk = np.stack([6.0 * c[3] + x * h * (24.0 * c[4] + x * h * 60.0 * c[5]) for x in (0.0, 0.2, 0.5, 0.8, 1.0)])
    used = float((np.abs(jerk).max(axis=0)[:, None] * np.abs(along[piece]) / run.jerk).max())
    slowed = max(1.0, float(np.cbrt(used)))
    if slowed > 1.0 + _MAX_SLOWED:
        raise SolverError("the motion found turns back too near to a change of its jerk")
    return law.dilated(slowed)


def _abscissae(
    run: JointRun,
    places: tuple[FloatArray, FloatArray],
    motion: tuple[FloatArray, FloatArray, IntArray],
    straight: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """The distance along the blocks that goes with parameters: of their nearest points, wherever it has increased.

    Between two nodes there are some more, closer together at the first: from near a rest on it goes with the cube.
    """
    (t, u), (state, jerk, leg) = places, motion
    edges = np.concatenate([[0.0], np.cumsum(run.lengths)])
    h = np.diff(t)[:, None] * _BETWEEN
    x = h[..., None]
    points = state[0, :-1, None] + x * (
        state[1, :-1, None] + x * (0.5 * state[2, :-1, None] + x * (jerk[:, None] / 6.0))
    )
    begins = np.flatnonzero(np.diff(leg, prepend=-1, append=-1))
    starts = t[begins]
    of = np.repeat(leg, _BETWEEN.size)
    share = ((t[:-1, None] + h).reshape(-1) - starts[of]) / np.diff(starts)[of]
    s = np.append(edges[of] + feet(run, of, points.reshape(of.size, -1), share)[0], edges[-1])
    along = np.sqrt(_squares(points - points[:, :1]))
    at = np.append(
        (u[:-1, None] + np.where(straight[:, None], along, np.diff(u)[:, None] * _BETWEEN)).reshape(-1), u[-1]
    )
    vertex = begins * _BETWEEN.size
    s[vertex] = edges
    kept = np.append((s[:-1] > edges[of]) & (s[:-1] < edges[of + 1]), True)
    kept[1:] &= s[1:] > np.maximum.accumulate(s)[:-1]
    kept[vertex] = True
    return at[kept], s[kept]


def feet(run: JointRun, leg: IntArray, position: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where on its block the nearest point to each position (n, d) is, mm from its start, and how far away that is.

    ``share`` (n,) says about where, of the length of the block.
    """
    length = run.lengths[leg]
    x = share * length
    for _ in range(_FOOT_PASSES if run.legs.curved.any() else 1):
        d = run.legs.at(leg, x)
        x = np.clip(x + np.sum((position - d[0]) * d[1], axis=1) / _squares(d[1]), 0.0, length)
    return x, np.sqrt(_squares(position - run.legs.at(leg, x)[0]))

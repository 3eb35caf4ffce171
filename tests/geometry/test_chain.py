"""The compiled chain against array arithmetic over its pieces, and the inverse of the arc length of blends."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import CurveError
from planner.geometry.blend import Blends, Legs
from planner.geometry.chain import ChainCurve, Kind, span_derivatives
from planner.geometry.differential import arc_derivatives

DIM = 3


def legs_of(kinds, rng):
    """Legs that move at unit speed, or nearly: lines, arcs and spirals."""
    vectors, rates = np.zeros((len(kinds), 4, DIM)), np.zeros((len(kinds), 2))
    for i, kind in enumerate(kinds):
        vectors[i, 0] = rng.normal(size=DIM)
        frame, _ = np.linalg.qr(rng.normal(size=(DIM, DIM)))
        if kind == "line":
            vectors[i, 3] = frame[0]
            continue
        rates[i, 0] = rng.uniform(0.1, 0.5)
        vectors[i, 1], vectors[i, 2] = frame[0] / rates[i, 0], frame[1] / rates[i, 0]
        if kind == "spiral":
            rates[i, 1], vectors[i, 3] = 0.01, 0.05 * frame[2]
    return Legs(vectors, rates)


def corner(angle, size, *, bend=0.0):
    """A blend between two legs in the plane: lines, or with ``bend`` arcs that leave the corner with that curvature."""
    before, after, rates = np.zeros((1, 4, 2)), np.zeros((1, 4, 2)), np.zeros((1, 2))
    for vectors, x, y in ((before, -1.0, 0.0), (after, np.cos(angle), np.sin(angle))):
        if bend:
            vectors[0, 0], vectors[0, 1], vectors[0, 2] = (
                [-y / bend, x / bend],
                [y / bend, -x / bend],
                [x / bend, y / bend],
            )
        else:
            vectors[0, 3] = [x, y]
    rates[0, 0] = bend
    return Blends.between(Legs(before, rates), Legs(after, rates), np.array([size]))


def alone(blends):
    """A chain of one blend."""
    nothing = np.empty(0)
    empty = Legs(np.empty((0, 4, blends.vertex.shape[1])), np.empty((0, 2)))
    parts = np.array([0.0, blends.length[0]]), np.array([Kind.BLEND], dtype=np.int8), np.zeros(1, dtype=np.intp)
    return ChainCurve(
        *parts, np.zeros(1), empty, blends, np.empty((0, blends.vertex.shape[1], 5)), nothing, nothing, nothing
    )


@pytest.fixture(scope="module")
def chain():
    """Forty pieces of every kind, one after the other, that need not join: the evaluation does not ask."""
    rng = np.random.default_rng(2)
    kinds = [str(kind) for kind in rng.choice(["line", "arc", "spiral"], 12)]
    legs = legs_of(kinds, rng)
    after = legs_of([str(kind) for kind in rng.choice(["line", "arc"], 8)], rng)
    blends = Blends.between(after.taken(np.roll(np.arange(8), 1)), after, rng.uniform(0.01, 0.2, 8))
    spans = rng.normal(size=(6, DIM, 5))
    kind = rng.permutation(np.repeat([Kind.LEG, Kind.BLEND, Kind.SPAN], [20, 12, 8])).astype(np.int8)
    row = np.array([rng.integers([12, 8, 6][k]) for k in kind], dtype=np.intp)
    width = np.where(
        kind == Kind.BLEND, blends.length[np.where(kind == Kind.BLEND, row, 0)], rng.uniform(0.1, 3.0, kind.size)
    )
    edges = np.concatenate([[0.0], np.cumsum(width)])
    offset = np.where(kind == Kind.LEG, rng.uniform(0.0, 1.0, kind.size), 0.0)
    nothing = np.empty(0)
    return ChainCurve(edges, kind, row, offset, legs, blends, spans, nothing, nothing, nothing)


def plain(chain, piece, x):
    """Position and three derivatives at the distances x from the starts of pieces, piece by piece in array arithmetic."""
    out = np.empty((4, x.size, chain.dim))
    for i, (at, here) in enumerate(zip(piece, x, strict=True)):
        row, distance = chain.row[[at]], np.array([here])
        if chain.kind[at] == Kind.LEG:
            d = chain.legs.at(row, chain.offset[at] + distance)
        elif chain.kind[at] == Kind.BLEND:
            d = arc_derivatives(chain.blends.at(row, chain.blends.tau(row, distance)))
        else:
            width = np.array([[chain.edges[at + 1] - chain.edges[at]]])
            d = span_derivatives(chain.spans[row], distance[:, None] / width, width)
        out[:, i] = d[:, 0]
    return out


def test_a_chain_is_made_of_its_pieces(chain):
    rng = np.random.default_rng(3)
    u = np.concatenate([rng.uniform(*chain.domain, 400), chain.edges])
    left = rng.uniform(size=u.size) < 0.5
    piece = np.where(left, np.searchsorted(chain.edges, u) - 1, np.searchsorted(chain.edges, u, side="right") - 1)
    piece = np.clip(piece, 0, chain.kind.size - 1)
    expected = plain(chain, piece, u - chain.edges[piece])
    for order in range(4):
        found = chain.derivatives(u, order, side=left)
        for k in range(order + 1):
            size = np.zeros((chain.kind.size, 1))
            np.maximum.at(size, piece, np.abs(expected[k]).max(axis=1, keepdims=True))
            assert (np.abs(found[k] - expected[k]) <= 4e-15 * size[piece]).all()
    assert {int(kind) for kind in chain.kind[piece]} == {0, 1, 2}


def test_order_zero_is_the_position_of_order_three(chain):
    u = np.linspace(*chain.domain, 997)
    assert (chain.derivatives(u, 0)[0] == chain.derivatives(u, 3)[0]).all()


@pytest.mark.parametrize("bend", [0.0, 0.3])
@pytest.mark.parametrize("degrees", [20.5, 90.0, 150.0])
def test_tabulated_inverse_against_quadrature_in_30_digits(degrees, bend):
    blend = corner(np.deg2rad(degrees), 0.02, bend=bend)
    s = blend.length[0] * np.concatenate([[0.0, 1.0], np.random.default_rng(1).uniform(size=5), [0.5, 0.4999, 0.0312]])
    with mpmath.workdps(30):
        legs = [(legs.vectors[0], float(legs.rates[0, 0])) for legs in (blend.before, blend.after)]

        def speed(tau):
            total = [mpmath.mpf(0), mpmath.mpf(0)]
            for ((_, e1, e2, g), w), sign in zip(legs, (-1, 1), strict=True):
                reach = 1 + sign * tau
                x, slope = mpmath.mpf(0.02) * reach**3, 3 * sign * mpmath.mpf(0.02) * reach**2
                for j in range(2):
                    turned = w * (mpmath.mpf(e2[j]) * mpmath.cos(w * x) - mpmath.mpf(e1[j]) * mpmath.sin(w * x))
                    total[j] += (turned + mpmath.mpf(g[j])) * slope
            return mpmath.sqrt(total[0] ** 2 + total[1] ** 2)

        exact = [
            float(mpmath.quad(speed, mpmath.linspace(-1, mpmath.mpf(float(x)), 12)))
            for x in blend.tau(np.zeros(s.size, dtype=np.intp), s)
        ]
    assert np.abs(np.array(exact) - s).max() < 2e-14 * blend.length[0]


@given(st.floats(0.01, 2.65), st.floats(1e-5, 1.0))
def test_length_of_the_inverse_is_the_length(angle, size):
    """Everywhere, also at the edges of the panels: by the series that the table was made from; and tau increases."""
    blend = corner(angle, size)
    edges, _, first = blend.inverse
    assert first.tolist() == [0, edges.size - 1]
    share = np.unique(np.concatenate([np.linspace(0.0, 1.0, 301), edges, np.nextafter(edges[:-1], 0.0)]).clip(0.0, 1.0))
    tau = blend.tau(np.zeros(share.size, dtype=np.intp), share * blend.length[0])
    b = blend._half_angle[0]
    x = np.arcsinh(tau / b) / np.arcsinh(1.0 / b)
    lengths = np.polynomial.chebyshev.chebval(x, blend._lengths[0])
    assert np.abs(lengths / lengths[-1] - share).max() < 3e-15
    assert tau[[0, -1]] == pytest.approx([-1.0, 1.0], abs=4e-15)
    assert (np.diff(tau) >= -2e-15).all()


def test_each_blend_among_others_is_what_it_is_alone():
    angles = np.deg2rad([30.0, 60.0, 90.0, 60.0, 150.0])
    each = [corner(angle, 0.1) for angle in angles]
    legs = [
        Legs(
            *(np.concatenate([getattr(getattr(blend, side), name) for blend in each]) for name in ("vectors", "rates"))
        )
        for side in ("before", "after")
    ]
    together = Blends.between(*legs, np.full(5, 0.1))
    assert together.inverse[2].size == 5  # four shapes
    row, s = np.repeat(np.arange(5), 7), np.tile(np.linspace(0.0, 1.0, 7), 5)
    order = np.random.default_rng(0).permutation(row.size)
    found = together.tau(row[order], (s * together.length[row])[order])
    expected = [each[i].tau(np.zeros(1, dtype=np.intp), s[[k]] * each[i].length[0])[0] for k, i in enumerate(row)]
    assert found == pytest.approx(np.array(expected)[order], abs=4e-15)


def test_blend_begins_and_ends_with_exactly_its_legs():
    d = alone(corner(0.5 * np.pi, 0.1)).derivatives(np.array([0.0, 1.0]) * corner(0.5 * np.pi, 0.1).length[0])
    assert d[1, 0].tolist() == [1.0, 0.0]
    assert d[1, 1] == pytest.approx([0.0, 1.0], abs=1e-15)
    assert (np.abs(d[2]) < 1e-13).all()


def test_a_shape_that_needs_more_panels_than_there_is_room_for_is_refused(monkeypatch):
    monkeypatch.setattr("planner.geometry.bezier._MAX_PANELS", 3)
    with pytest.raises(CurveError, match="within 3 panels"):
        _ = corner(0.5 * np.pi, 0.1).inverse


@pytest.mark.parametrize("turns", [1, 30, 1000])
def test_an_arc_of_many_turns_has_as_many_pieces_a_turn_as_one_of_one(turns):
    vectors = np.array([[[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [0.0, 0.0]]])
    legs = Legs(vectors, np.array([[0.1, 0.0]]))
    edges = np.array([0.0, 20.0 * np.pi * turns])
    only = np.zeros(1, dtype=np.intp)
    nothing = np.empty(0)
    curve = ChainCurve(edges, only, only, np.zeros(1), legs, None, np.empty((0, 2, 5)), nothing, nothing, nothing)
    assert curve.pieces.breaks.size - 1 <= 16 * turns

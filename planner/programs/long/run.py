"""A run: part of the path of a program, which can be cut between its pieces and joined to the run that follows.

A run begins at the parameter 0.  With its curve it keeps the abscissa along the program and where in it the blocks lie.
Stretches of it that were found together with their feed (``curve.timing``) are not cut, but for their path alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.geometry.bezier import Beziers
from planner.geometry.blend import Blends, Legs, with_own_curves
from planner.geometry.chain import INTERVALS_OF_KIND, ChainCurve, Kind
from planner.law import TimeLaw, Timing
from planner.machine.limits import Limits
from planner.programs.path.feeds import caps_of_blocks
from planner.programs.path.splice import Placed
from planner.types import BoolArray, FloatArray

_SAME = 1e-9  # mm
_OF_LAWS = ("t", "u", "u_rate", "u_acceleration")


@dataclass(frozen=True, eq=False)
class Run:
    """Part of a path.

    Attributes
    ----------
    curve : ChainCurve
        From the parameter 0, mm.
    at, s : (n,) arrays
        Parameters, and the programmed abscissae that go with them, from the start of the run, mm; both increasing.
    row : (k,) int array
        Moves of the program that the run covers, the first and the last of them perhaps in part.
    u : (k + 1,) array
        Curve parameters at which they begin and end.
    feed : (k,) array
        Cap on the feed in each, mm/s.
    angular : (k,) bool array
        Where it is degrees/s.
    """

    curve: ChainCurve
    at: FloatArray
    s: FloatArray
    row: NDArray[np.intp]
    u: FloatArray
    feed: FloatArray
    angular: BoolArray

    @property
    def length(self) -> float:
        """Range of the parameter, mm."""
        return float(self.curve.edges[-1])

    @property
    def laws(self) -> tuple[TimeLaw, ...]:
        """Those that were found together with the path, in their order."""
        timing = self.curve.timing
        return () if timing is None else timing.laws

    @property
    def timed(self) -> NDArray[np.intp]:
        """First edge and last edge of each stretch that has a law, (l, 2)."""
        ends = np.array([law.u[[0, -1]] for law in self.laws]).reshape(-1, 2)
        return np.searchsorted(self.curve.edges, ends)

    @property
    def intervals(self) -> NDArray[np.intp]:
        """How many intervals of a plan resolve the pieces, (m,); a span that has its law is one."""
        found = np.array(INTERVALS_OF_KIND[self.curve.kind])
        for first, last in self.timed:
            some = slice(first, last)
            found[some] = np.where(self.curve.kind[some] == Kind.SPAN, 1, found[some])
        return found

    @property
    def s_edges(self) -> FloatArray:
        """Abscissae at the edges of the curve, (m + 1,)."""
        return np.interp(self.curve.edges, self.at, self.s)

    @property
    def stops(self) -> NDArray[np.intp]:
        """Indices of the edges at which the path stops."""
        return np.searchsorted(self.curve.edges, self.curve.stops)

    def pieces(self, first: int, last: int) -> Run:
        """Cut out the pieces from ``first`` to before ``last``."""
        curve = self.curve
        u0, u1 = curve.edges[[first, last]]
        inside = slice(first, last)
        kind, old = curve.kind[inside], curve.row[inside]
        row = np.zeros(old.size, dtype=np.intp)
        used = {}
        for one in Kind:
            on = kind == one
            used[one], row[on] = np.unique(old[on], return_inverse=True)

        def within(values: FloatArray) -> FloatArray:
            return np.asarray(values[(values > u0) & (values < u1)] - u0)

        some = used[Kind.BLEND]
        parts = [curve.legs.taken(used[Kind.LEG])]
        if curve.blends is not None:
            parts += [curve.blends.before.taken(some), curve.blends.after.taken(some)]
        legs, *sides = with_own_curves(parts)
        blends = None
        if curve.blends is not None and some.size:
            blends = Blends.between(sides[0], sides[1], curve.blends.size[some], curve.blends.weight)
        part = replace(
            curve,
            edges=curve.edges[first : last + 1] - u0,
            kind=kind,
            row=row,
            offset=curve.offset[inside],
            legs=legs,
            blends=blends,
            spans=curve.spans[used[Kind.SPAN]],
            joints=within(curve.joints),
            stops=within(curve.stops),
            marks=within(curve.marks),
            feed_caps=None,
            timing=_timing([_moved(law, -u0) for law in self.laws if u0 <= law.u[0] and law.u[-1] <= u1], self),
        )
        i = int(np.searchsorted(self.u, u0, side="right")) - 1
        j = int(np.searchsorted(self.u, u1, side="left"))
        u = np.concatenate([[0.0], self.u[i + 1 : j] - u0, [u1 - u0]])
        at = np.concatenate([[u0], self.at[(self.at > u0) & (self.at < u1)], [u1]])
        s = np.interp(at, self.at, self.s)
        return Run(part, at - u0, s - s[0], self.row[i:j], u, self.feed[i:j], self.angular[i:j])

    def untimed(self) -> Run:
        """The path alone."""
        return replace(self, curve=replace(self.curve, timing=None))

    def joined(self, other: Run, *, rests: bool) -> Run:
        """Append the run that follows; ``rests``: the path stops between them."""
        a, at = self.curve, self.length
        b = _moved_on(a, other.curve)
        count = {Kind.LEG: a.legs.rates.shape[0], Kind.BLEND: _count(a.blends), Kind.SPAN: a.spans.shape[0]}
        shift = np.array([count[one] for one in Kind])
        legs = a.legs.joined(b.legs)
        blends = a.blends
        if b.blends is not None:
            none = a.legs.taken(np.empty(0, dtype=np.intp))  # on the curves of a, which come first
            before, after = (none, none) if a.blends is None else (a.blends.before, a.blends.after)
            size = b.blends.size if a.blends is None else np.concatenate([a.blends.size, b.blends.size])
            blends = Blends.between(before.joined(b.blends.before), after.joined(b.blends.after), size, b.blends.weight)
        # A block that the joint cuts in two is one block.
        same = bool(self.row[-1] == other.row[0])
        changes = not same and (self.feed[-1] != other.feed[0] or self.angular[-1] != other.angular[0])
        curve = replace(
            a,
            edges=np.concatenate([a.edges, at + b.edges[1:]]),
            kind=np.concatenate([a.kind, b.kind]),
            row=np.concatenate([a.row, b.row + shift[b.kind]]),
            offset=np.concatenate([a.offset, b.offset]),
            legs=legs,
            blends=blends,
            spans=np.concatenate([a.spans, b.spans]),
            joints=np.concatenate([a.joints, [at], at + b.joints]),
            stops=np.concatenate([a.stops, [at] if rests else [], at + b.stops]),
            marks=np.concatenate([a.marks, [at] if changes else [], at + b.marks]),
            timing=_timing([*self.laws, *(_moved(law, at) for law in other.laws)], self, other),
        )
        return Run(
            curve,
            np.concatenate([self.at, at + other.at[1:]]),
            np.concatenate([self.s, self.s[-1] + other.s[1:]]),
            np.concatenate([self.row, other.row[same:]]),
            np.concatenate([self.u[: -1 if same else None], at + other.u[1:]]),
            np.concatenate([self.feed, other.feed[same:]]),
            np.concatenate([self.angular, other.angular[same:]]),
        )

    def with_caps(self) -> ChainCurve:
        """The curve with the feed caps of its blocks."""
        return replace(self.curve, feed_caps=caps_of_blocks(self.u, self.feed, self.angular))

    def arrays(self) -> dict[str, FloatArray]:
        """Everything the run is made of, by name."""
        curve = self.curve
        out = {name: getattr(curve, name) for name in ("edges", "kind", "offset", "spans", "joints", "stops", "marks")}
        out |= {"piece_row": curve.row, "at": self.at, "s": self.s, "row": self.row, "u": self.u, "feed": self.feed}
        out |= {"angular": self.angular, "tip_columns": np.array(curve.tip_columns, dtype=np.intp)}
        parts = {"legs": curve.legs}
        if curve.blends is not None:
            parts |= {"before": curve.blends.before, "after": curve.blends.after}
            out |= {"size": curve.blends.size, "weight": curve.blends.weight}
        for name, legs in parts.items():
            out |= {f"{name}_vectors": legs.vectors, f"{name}_rates": legs.rates}
            if legs.ways is not None:
                out[f"{name}_ways"] = legs.ways
        if curve.legs.beziers is not None:
            out |= {f"curves_{name}": array for name, array in curve.legs.beziers.arrays().items()}
        if self.laws:
            out["law_first"] = np.cumsum([0, *(law.t.size for law in self.laws)])
            out |= {f"law_{name}": np.concatenate([getattr(law, name) for law in self.laws]) for name in _OF_LAWS}
        return out

    @classmethod
    def of_arrays(cls, arrays: dict[str, FloatArray], axes: tuple[str, ...], name: str, limits: Limits | None) -> Run:
        """The run that :meth:`arrays` came from; ``limits``: those that its laws were found for."""
        of_curves = {key.removeprefix("curves_"): array for key, array in arrays.items() if key.startswith("curves_")}
        beziers = Beziers.of_arrays(of_curves) if of_curves else None

        def legs(part: str) -> Legs:
            return Legs(arrays[f"{part}_vectors"], arrays[f"{part}_rates"], arrays.get(f"{part}_ways"), beziers)

        blends = (
            Blends.between(legs("before"), legs("after"), arrays["size"], arrays["weight"])
            if "size" in arrays
            else None
        )
        timing = None
        if "law_first" in arrays:
            laws = (
                TimeLaw(*(np.array(arrays[f"law_{name}"][i:j]) for name in _OF_LAWS))
                for i, j in pairwise(arrays["law_first"].astype(int).tolist())
            )
            timing = Timing(tuple(laws), limits)
        names = ("edges", "kind", "offset", "spans", "joints", "stops", "marks")
        curve = ChainCurve(
            **{key: arrays[key] for key in names},  # type: ignore[arg-type]
            row=np.asarray(arrays["piece_row"], dtype=np.intp),
            legs=legs("legs"),
            blends=blends,
            axes=axes,
            name=name,
            tip_columns=tuple(arrays["tip_columns"].astype(int).tolist()),
            timing=timing,
        )
        return cls(
            curve,
            arrays["at"],
            arrays["s"],
            np.asarray(arrays["row"], dtype=np.intp),
            arrays["u"],
            arrays["feed"],
            arrays["angular"].astype(np.bool_),
        )


def cut_run(placed: Placed, blocks: tuple[FloatArray, FloatArray, BoolArray], start: float, end: float) -> Run:
    """The run of a path from one abscissa to another, each at an edge or on a leg.

    Parameters
    ----------
    placed : Placed
    blocks : tuple
        Parameters at which blocks begin and end (k + 1,), their feed caps (k,), and which of these are angular (k,).
    start, end : float
        mm.
    """
    u, feed, angular = blocks
    whole = Run(placed.curve, placed.u_edges, placed.s_edges, np.arange(feed.size), u, feed, angular)
    for s in (start, end):
        whole = _split_leg(whole, s)
    # Of edges that differ by rounding the inner ones: the piece between two of them would have no length behind another run.
    first, last = _edge_at(whole, start, inner=-1), _edge_at(whole, end)
    assert first is not None
    assert last is not None
    return whole.pieces(first, last)


def _edge_at(run: Run, s: float, inner: int = 0) -> int | None:
    """The edge at an abscissa, None if there is none.

    Of several but for rounding the one at which the path rests, else the first, or the last for an ``inner`` of -1.
    """
    near = np.flatnonzero(np.abs(run.s_edges - s) <= _SAME)
    if not near.size:
        return None
    resting = np.intersect1d(near, [0, *run.stops, run.curve.kind.size])
    return int(resting[0] if resting.size else near[inner])


def _split_leg(run: Run, s: float) -> Run:
    """Cut a leg in two at an abscissa, unless there is an edge."""
    if _edge_at(run, s) is not None:
        return run
    i = int(np.searchsorted(run.s_edges, s, side="right")) - 1
    curve, along = run.curve, s - run.s_edges[i]
    assert curve.kind[i] == Kind.LEG
    u = curve.edges[i] + along
    split = replace(
        curve,
        edges=np.insert(curve.edges, i + 1, u),
        kind=np.insert(curve.kind, i + 1, Kind.LEG),
        row=np.insert(curve.row, i + 1, curve.row[i]),
        offset=np.insert(curve.offset, i + 1, curve.offset[i] + along),
    )
    k = int(np.searchsorted(run.at, u))
    return replace(run, curve=split, at=np.insert(run.at, k, u), s=np.insert(run.s, k, s))


def _moved(law: TimeLaw, by: float) -> TimeLaw:
    """A law of a curve that is moved along its parameter."""
    return replace(law, u=law.u + by)


def _timing(laws: list[TimeLaw], *runs: Run) -> Timing | None:
    """Laws, found for the limits of the runs they come from."""
    limits = next((run.curve.timing.limits for run in runs if run.curve.timing is not None), None)
    return Timing(tuple(laws), limits) if laws else None


def _moved_on(before: ChainCurve, curve: ChainCurve) -> ChainCurve:
    """A chain with the columns beyond its axes moved, so that they go on where another one ends."""
    if curve.columns == curve.dim:
        return curve
    end, start = (
        part.every_column(np.array([part.domain[k]]), 0, np.array([k == 1]))[0, 0]
        for part, k in ((before, 1), (curve, 0))
    )
    by = np.where(np.arange(curve.columns) < curve.dim, 0.0, end - start)

    def moved(legs: Legs) -> Legs:
        vectors = legs.vectors.copy()
        vectors[:, 0] += by
        return replace(legs, vectors=vectors)

    spans, blends = curve.spans.copy(), curve.blends
    spans[:, :, 0] += by
    if blends is not None:
        blends = replace(blends, vertex=blends.vertex + by, before=moved(blends.before), after=moved(blends.after))
    return replace(curve, legs=moved(curve.legs), spans=spans, blends=blends)


def _count(blends: Blends | None) -> int:
    return 0 if blends is None else int(blends.size.size)

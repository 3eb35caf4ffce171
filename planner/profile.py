"""The plan as a function of time.

A plan is a time law (``law.py``) on its curve, with what its solver says of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.compiled import core
from planner.errors import InputError
from planner.frames import Tabular
from planner.geometry.continuity import MAX_DERIVATIVE
from planner.geometry.curve import Curve
from planner.geometry.differential import rates_along
from planner.inputs import coordinates, shorten
from planner.law import TimeLaw
from planner.machine.feed_limits import commanded_feed, osculating_limits
from planner.machine.limit_rows import limit_rows
from planner.machine.limits import Limits
from planner.origin import Origin
from planner.quantity import CHORD_ERROR, FEED, limit_names
from planner.samples import axis_columns
from planner.status import Claim, Status, Work
from planner.types import FloatArray

# A limit holds the path back where it is used up to within half a percent.
BINDING_SHARE = 0.995
# Of the duration: by so much a plan that passes its check may be faster than the bound of every plan, since it may exceed
# its limits by half of that.
BOUND_TOLERANCE = 2e-6
_WORTH_KEEPING = 1.0001  # of slowing down: less changes no name of a limit


@dataclass(frozen=True, eq=False)
class ProfileStates:
    """The plan at given times: all arrays have the shape of t.

    ``u_rate``, ``u_acceleration`` and ``u_jerk`` are the time derivatives of the curve parameter; ``feed`` (mm/s),
    ``acceleration`` (mm/s^2) and ``jerk`` (mm/s^3) those of the arc length ``s`` (mm).
    """

    t: FloatArray
    u: FloatArray
    u_rate: FloatArray
    u_acceleration: FloatArray
    u_jerk: FloatArray
    s: FloatArray
    feed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray


class _LowerBound:
    """A number, or what computes it when it is first asked for: most plans are run, and nobody asks."""

    def __get__(self, profile: FeedrateProfile | None, owner: type[FeedrateProfile] | None = None) -> float:
        if profile is None:  # the default of the field
            return np.nan
        kept = vars(profile)
        if callable(kept["lower_bound"]):
            kept["lower_bound"] = kept["lower_bound"]()
        return float(kept["lower_bound"])

    def __set__(self, profile: FeedrateProfile, value: float | Callable[[], float]) -> None:
        vars(profile)["lower_bound"] = value


class _BoundClaim:
    """How the bound is known: NONE where it is nan, and nowhere else."""

    def __get__(self, profile: FeedrateProfile | None, owner: type[FeedrateProfile] | None = None) -> Claim:
        if profile is None:  # the default of the field
            return Claim.COMPUTED
        if np.isnan(profile.lower_bound):
            return Claim.NONE
        given: Claim = vars(profile)["claim"]
        return Claim.COMPUTED if given is Claim.NONE else given

    def __set__(self, profile: FeedrateProfile, value: Claim) -> None:
        vars(profile)["claim"] = value


@dataclass(frozen=True, eq=False)
class FeedrateProfile(Tabular):
    """A feedrate plan: what comes out of ``plan_feedrate`` and goes into ``replay``, ``check`` and tables.

    ``to_frame()`` gives its nodes as a ``pandas.DataFrame`` where pandas is installed, else as a plain dict of arrays; so
    does ``pandas.DataFrame(profile)``.

    Attributes
    ----------
    curve : Curve
        The tool path it was planned for.
    law : TimeLaw
        The curve parameter as a function of time; ``t``, ``u``, ``u_rate`` and ``u_acceleration`` are its nodes, (n,).
    s, feed, acceleration, jerk : (n,) arrays
        The same nodes seen along the tool tip: mm, mm/s, mm/s^2, mm/s^3.
    binding : (n,) int array
        Index into ``limit_names`` of the limit that holds the path back at a node; 0 where none does.
    limit_names : tuple of str
        "none" first, then for example "feed", "velocity X", "acceleration Y", "jerk Y".
    lower_bound : float
        No profile within the limits is faster than this, s (nan where the method gives none).  A plan computes its own
        when it is first asked for.
    method : str
        The solver that made it.
    limits : Limits, optional
        What it was planned for: by these ``binding`` is named.
    claim : Claim
        How ``lower_bound`` is known; NONE where it is nan, and nowhere else.
    origin : Origin
        How it was asked for.
    status : Status
        How it ended.
    notes : tuple of str
        What a person should know of it.
    slowed : tuple of (int, float)
        Where the plan was slowed down as a whole, the first nodes and by which factors; ``binding`` is what held it back
        before.  Empty where it was not.
    saved_by_one_percent : mapping
        Time that one percent more of a limit saves, s, by the limit's name, most first; empty where the method tells none.
    work : Work
        What it took.
    checked : str
        What the check said when the table that it was read from was written; empty otherwise.
    """

    curve: Curve
    law: TimeLaw
    s: FloatArray
    feed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    binding: NDArray[np.int8]
    limit_names: tuple[str, ...]
    lower_bound: float = _LowerBound()  # type: ignore[assignment]
    method: str = ""
    limits: Limits | None = None
    claim: Claim = _BoundClaim()  # type: ignore[assignment]
    origin: Origin = field(default_factory=Origin)
    status: Status = Status.FEASIBLE
    notes: tuple[str, ...] = ()
    slowed: tuple[tuple[int, float], ...] = ()
    saved_by_one_percent: Mapping[str, float] = field(default_factory=dict)
    work: Work = field(default_factory=Work)
    checked: str = ""

    def __post_init__(self) -> None:
        for name in ("s", "feed", "acceleration", "jerk", "binding"):
            getattr(self, name).setflags(write=False)

    @property
    def t(self) -> FloatArray:
        """Times of the nodes (n,), s."""
        return self.law.t

    @property
    def u(self) -> FloatArray:
        """Curve parameter at the nodes (n,)."""
        return self.law.u

    @property
    def u_rate(self) -> FloatArray:
        """First time derivative of the curve parameter at the nodes (n,)."""
        return self.law.u_rate

    @property
    def u_acceleration(self) -> FloatArray:
        """Second time derivative of the curve parameter at the nodes (n,)."""
        return self.law.u_acceleration

    @property
    def nodes(self) -> int:
        """Number of nodes, rows of its table."""
        return int(self.law.t.size)

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return self.law.duration

    def at(self, t: ArrayLike) -> ProfileStates:
        """Evaluate the plan at any times within [0, duration], any shape; calling the plan does the same.

        Raises
        ------
        InputError
            If a time lies outside the plan.
        """
        times = coordinates(t, "t")
        outside = ~((times >= 0.0) & (times <= self.duration))
        if outside.any():
            worst = float(times[outside].flat[0])
            raise InputError(f"t = {worst!r} must lie within [0, {self.duration!r}], the duration of the plan")
        law = self.law.at(times.reshape(-1))
        s, along = along_tip(self.curve, law)
        columns = (times.reshape(-1), *law, s, *along)
        return ProfileStates(*(column.reshape(times.shape) for column in columns))

    __call__ = at

    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Return the columns of the feedrate table, one row a node, by the names they have there."""
        return {
            "t_s": self.t,
            "u": self.u,
            "s_mm": self.s,
            **axis_columns(self.curve.axes, self.curve.derivatives(self.u, 0)[0]),
            "feed_mm_s": self.feed,
            "acceleration_mm_s2": self.acceleration,
            "jerk_mm_s3": self.jerk,
            "binding": np.array(self.limit_names, dtype=object)[self.binding],
            "u_rate": self.u_rate,
            "u_acceleration": self.u_acceleration,
        }

    def __len__(self) -> int:
        """Number of nodes."""
        return self.t.size

    def __repr__(self) -> str:
        bound = "none" if self.claim is Claim.NONE else f"{self.lower_bound:.6g} s, {self.claim.value}"
        return (
            f"FeedrateProfile of {shorten(self.curve.name)}: {self.duration:.6g} s, {self.t.size} nodes, method "
            f"{shorten(self.method)}, {self.status.value}\n    lower bound {bound}; {len(self.notes)} notes"
        )

    def shares(self) -> dict[str, float]:
        """Share of the time during which each limit holds the path back, largest first."""
        weight = np.diff(self.t)
        half = np.bincount(self.binding[:-1], weight, len(self.limit_names))
        half += np.bincount(self.binding[1:], weight, len(self.limit_names))
        share = half / (2.0 * self.duration)
        order = np.argsort(-share, kind="stable")
        return {self.limit_names[i]: float(share[i]) for i in order if share[i] > 0.0}


def along_tip(
    curve: Curve, law: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """Arc length of the tool tip and its first three time derivatives, from those of u."""
    return curve.arclength.s(law[0]), rates_along(curve.tip.derivatives(law[0]), *law[1:])


def make_profile(
    curve: Curve,
    limits: Limits,
    law: TimeLaw,
    *,
    method: str,
    lower_bound: float = np.nan,
    slowed: FloatArray | None = None,
) -> FeedrateProfile:
    """Build a profile from its time law.

    Of two nodes that share a time the first holds the values before a break, the second those after it.  ``slowed (n,)``:
    by which factor each node's section was slowed down as a whole; what binds is what did before.
    """
    t, u, rate, acceleration = (
        np.ascontiguousarray(column, dtype=np.float64) for column in (law.t, law.u, law.u_rate, law.u_acceleration)
    )
    inner = np.diff(t) > 0.0
    gap = np.where(inner, np.diff(t), 1.0)
    # A node takes the jerk of the interval after it; before a break, and at the end, of the one before it.
    forward = np.append(inner, False)
    jerk = np.empty_like(t)
    core.profile_jerk(t.size, u, rate, acceleration, forward, gap, np.stack([gap**3, gap**4, gap**5]), jerk)
    names, along, binding = _binding(curve, limits, np.stack([u, rate, acceleration, jerk]), ~forward, slowed)
    s = curve.arclength.s(u)
    kept: tuple[tuple[int, float], ...] = ()
    if slowed is not None and slowed.max() > _WORTH_KEEPING:
        first = np.flatnonzero(np.diff(slowed, prepend=np.nan) != 0.0)
        kept = tuple((int(node), float(slowed[node])) for node in first)
    return FeedrateProfile(
        curve,
        TimeLaw(t, u, rate, acceleration),
        s,
        along[0],
        along[1],
        along[2],
        binding,
        names,
        float(lower_bound),
        method,
        limits,
        origin=Origin(limits.period, tolerance=curve.made_within),
        slowed=kept,
    )


def _binding(
    curve: Curve, limits: Limits, law: FloatArray, left: NDArray[np.bool_], slowed: FloatArray | None
) -> tuple[tuple[str, ...], FloatArray, NDArray[np.int8]]:
    """Name, at each node, the limit with the largest share used, if it is nearly used up.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    law : (4, n) array
        u and its first three time derivatives.
    left : (n,) bool array
        Nodes at which the path is taken from the left.
    slowed : (n,) array, optional
        By which factor each was slowed down.

    Returns
    -------
    names : tuple of str
    along : (3, n) array
        Time derivatives of the arc length of the tip.
    binding : (n,) int array
        Index into the names.
    """
    u, n = law[0], law.shape[1]
    q = curve.pieces.evaluate(u, MAX_DERIVATIVE, left)
    tip = q if curve.tip is curve else curve.tip.pieces.evaluate(u, MAX_DERIVATIVE, left)
    names = limit_names(curve.axes)
    rows = sorted(limit_rows(limits.on(curve)), key=lambda row: names.index(row.name))
    along, binding = np.empty((3, n)), np.empty(n, dtype=np.uint8)
    cubes = None if slowed is None else slowed**3
    core.profile_binding(
        *(n, curve.dim, tip.shape[2], q, tip, law[1:], law[1] ** 3, slowed, cubes),
        *(commanded_feed(curve, limits, u, left), osculating_limits(curve, limits).chord_error),
        *(limits.period, len(rows)),
        np.array([(*row.weights, row.lower, row.upper) for row in rows], dtype=np.float64).reshape(-1, 5),
        np.array([(row.motion, names.index(row.name)) for row in rows], dtype=np.int64).reshape(-1, 2),
        *(names.index(FEED.label), names.index(CHORD_ERROR.label), BINDING_SHARE, along, binding),
    )
    return names, along, binding.astype(np.int8)

"""A machine's limits, and the four feedrate limits they put on a curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.frames import escaped
from planner.geometry.curve import AXES, ROTARY_AXES, Curve, axis_names
from planner.inputs import numbers, positive_number, require_instance, shorten
from planner.quantity import AXIS, CHORD_ERROR, FEED, PATH, QUANTITIES, TANGENTIAL, Quantity, Scope, limit_names
from planner.types import FloatArray

DEFAULT_PERIOD = 1e-3  # of a controller, s
MAX_RESERVE = 0.5  # of the jerk; more makes plans longer and no stop much shorter
_MAX_AXES = len(AXES)
_WIDTH = 100  # characters of a line of the repr
# What besides the quantities is one number: the period (s), and the feed of rapids (mm/s).
PERIOD, RAPID = "period", "rapid"
SCALARS = (FEED.key, CHORD_ERROR.key, PERIOD, *(q.key for q in PATH if q not in (FEED, CHORD_ERROR)), RAPID)
SCALABLE = (*(q.key for q in AXIS), *(name for name in SCALARS if name != PERIOD))
"""What :meth:`Limits.scaled` multiplies."""


@dataclass(frozen=True, eq=False, repr=False)
class Limits:
    """What the machine and the process allow.

    Parameters
    ----------
    feed : float
        Commanded feedrate of the tool tip, mm/s.
    velocity, acceleration, jerk : float or (dim,) sequence of float
        Per axis, mm/s, mm/s^2, mm/s^3 (rad in place of mm for rotary axes); inf where there is no limit.  One number holds
        for every axis: of ``axes``, or of the curve the limits are used on.  Rotary axes need their own.
    chord_error : float
        Largest distance between the path and the chord of one period, mm.
    period : float
        Interpolation period, s.
    tangential_acceleration, tangential_jerk : float
        Limits on the second and third time derivative of the arc length, mm/s^2 and mm/s^3.
    axes : sequence of str, optional
        Names; X, Y, Z, U, V, W if left out, none where every limit is one number.
    rapid : float
        Feedrate of the tool tip in the rapids of a part program, mm/s; inf where the axes alone limit them.

    Raises
    ------
    InputError
        If a value is not a positive number, or the sequences differ in length.

    Notes
    -----
    Limits with the same values and axes are equal.
    """

    feed: float
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    chord_error: float
    period: float
    tangential_acceleration: float
    tangential_jerk: float
    axes: tuple[str, ...]
    rapid: float

    def __init__(
        self,
        feed: float,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        jerk: ArrayLike,
        chord_error: float = np.inf,
        period: float = DEFAULT_PERIOD,
        tangential_acceleration: float = np.inf,
        tangential_jerk: float = np.inf,
        axes: Sequence[str] = (),
        rapid: float = np.inf,
    ) -> None:
        single = {
            "feed": feed,
            "chord_error": chord_error,
            "period": period,
            "tangential_acceleration": tangential_acceleration,
            "tangential_jerk": tangential_jerk,
            "rapid": rapid,
        }
        for name, value in single.items():
            hint = "" if name == PERIOD else "; use inf for no limit"
            object.__setattr__(self, name, positive_number(value, name, hint))
        if np.isinf(self.period):
            raise InputError("period = inf must be finite, the time between two points in s")
        rows = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
        found = {name: _positive_row(values, name) for name, values in rows.items()}
        sizes = {name: row.size for name, row in found.items() if row.ndim == 1}
        if len(set(sizes.values())) > 1:
            raise InputError(
                f"{_listed(list(sizes))} have {_listed([str(size) for size in sizes.values()])} values; "
                "each needs one for every axis, or one number for all"
            )
        named = len(axes) if isinstance(axes, Sequence) else 0
        count = next(iter(sizes.values()), named)
        if count > _MAX_AXES:
            raise InputError(f"{count} axes are given; at most {_MAX_AXES} are allowed")
        names = axis_names(axes or None, count, "limits", InputError)
        object.__setattr__(self, "axes", names)
        for name, row in found.items():
            object.__setattr__(self, name, _spread(row, name, names) if names else row)

    @property
    def dim(self) -> int:
        """Number of axes; 0 where every limit is one number, for the axes of any curve."""
        return len(self.axes)

    def on(self, curve: Curve) -> Limits:
        """Limits of every axis of a curve: picked by name, or one number for every axis spread over them.

        A machine may have more axes than the curve.  Where it lacks the name of one, as many limits as the curve has axes
        are those in its order.  Raises InputError unless there is one limit for every axis, and for a rotary axis one of
        its own.
        """
        require_instance(curve, Curve, "curve")
        if not self.axes:
            return self._replace(axes=curve.axes)
        if set(curve.axes) <= set(self.axes):
            return self.for_curve(curve)
        if self.dim != curve.dim:
            raise InputError(
                f"the limits have {'1 axis' if self.dim == 1 else f'{self.dim} axes'} ({', '.join(self.axes)}), "
                f"but {curve.name} has {curve.dim} "
                f"({', '.join(curve.axes)}); give one limit for each axis of the curve"
            )
        return self if self.axes == tuple(curve.axes) else self._replace(axes=curve.axes)

    def of(self, quantity: Quantity) -> list[float]:
        """Limits on a quantity: one number, or one for each axis."""
        return np.atleast_1d(getattr(self, quantity.key)).tolist()

    def of_motions(self, order: int) -> FloatArray:
        """Limits on one order of derivatives of the motions, (dim + 1,): of each axis, and last of the tip's arc length."""
        found = [np.atleast_1d(getattr(self, q.key)) for q in (*AXIS, FEED, *TANGENTIAL) if q.order == order]
        return np.concatenate(found)

    def __eq__(self, other: object) -> bool:
        """Whether every limit, the period and the axes are the same."""
        return self._key() == other._key() if isinstance(other, Limits) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        rows = (tuple(self.of(quantity)) for quantity in AXIS)
        return self.axes, *(getattr(self, name) for name in SCALARS), *rows

    def __repr__(self) -> str:
        """Two lines: what is one number, and what is of the axes; what has no limit is left out.

        Where one of them would be too long, they part where the longer one is shortest.
        """
        single = [f"{name}={getattr(self, name):.6g}" for name in SCALARS if np.isfinite(getattr(self, name))]
        axes = [f"axes={''.join(self.axes)!r}"] if self.axes else []
        axes += [f"{q.key}={_short(self.of(q))}" for q in AXIS]
        parts = [*single, *axes]

        def lines(count: int) -> list[str]:
            return [f"Limits({', '.join(parts[:count])},", f"       {', '.join(parts[count:])})"]

        said = lines(len(single))
        if max(map(len, said)) > _WIDTH:
            said = min(map(lines, range(1, len(parts))), key=lambda two: max(map(len, two)))
        return "\n".join(said)

    def _repr_html_(self) -> str:
        """Lay the limits out as a table, one row a quantity."""
        axes = self.axes or ("every axis",)
        units = ["rad" if axis in ROTARY_AXES else "mm" for axis in axes]
        rows = [("limit", "of", "value")]
        for q in QUANTITIES:
            if q in AXIS:
                rows += [
                    (q.label, axis, f"{value:.6g} {q.unit(unit)}")
                    for axis, unit, value in zip(axes, units, self.of(q), strict=True)
                ]
            else:
                rows.append((q.label, "path", f"{getattr(self, q.key):.6g} {q.unit()}"))
        rows += [(RAPID, "path", f"{self.rapid:.6g} {FEED.unit()}"), (PERIOD, "", f"{self.period:.6g} s")]
        lines = ("".join(f"<td>{escaped(cell)}</td>" for cell in row) for row in rows if not row[2].startswith("inf "))
        return "<table>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"

    def with_feed(self, feed: float) -> Limits:
        """Return the same limits with another commanded feedrate, mm/s."""
        return self._replace(feed=feed)

    def with_acceleration_share(self, share: float) -> Limits:
        """Return the same limits with a part of each axis's acceleration."""
        return self._replace(acceleration=share * self.acceleration)

    def with_reserve(self, reserve: float) -> Limits:
        """Return what a plan may use of these limits, so that its feed can be overridden and held within them.

        ``reserve``, 0 to 0.5, is what is left of every jerk limit; a third of it is left of every acceleration limit.
        """
        return self._with_shares(*reserve_shares(reserve))

    def without_reserve(self, reserve: float) -> Limits:
        """Return the limits of which :meth:`with_reserve` made these."""
        acceleration, jerk = reserve_shares(reserve)
        return self._with_shares(1.0 / acceleration, 1.0 / jerk)

    def _with_shares(self, acceleration: float, jerk: float) -> Limits:
        return self._replace(
            acceleration=acceleration * self.acceleration,
            jerk=jerk * self.jerk,
            tangential_acceleration=acceleration * self.tangential_acceleration,
            tangential_jerk=jerk * self.tangential_jerk,
        )

    def with_period(self, period: float) -> Limits:
        """Return the same limits with another interpolation period, s."""
        return self._replace(period=period)

    @property
    def has_jerk(self) -> bool:
        """Whether there is any jerk limit."""
        return bool(np.isfinite(self.jerk).any() or np.isfinite(self.tangential_jerk))

    def without_jerk(self) -> Limits:
        """Return the same limits without any of the jerk."""
        return self._replace(jerk=np.full_like(self.jerk, np.inf), tangential_jerk=np.inf)

    def without_chord_error(self) -> Limits:
        """Return the same limits with any chord error allowed."""
        return self._replace(chord_error=np.inf)

    def scaled(self, key: str, factor: float, axis: str = "") -> Limits:
        """Return the same limits with one of them multiplied; of the axes, of one where it is named.

        Parameters
        ----------
        key : str
            One of :data:`SCALABLE`.
        factor : float
            > 0.
        axis : str
            Name of an axis, for what is limited on each.

        Raises
        ------
        InputError
            If there is no such limit or axis, or the factor is not a finite number > 0.
        """
        if key not in SCALABLE:
            raise InputError(f"{key}: is no limit to scale; these are {', '.join(SCALABLE)}")
        if np.isinf(positive_number(factor, f"factor of {key}")):
            raise InputError(f"factor of {key} = {factor!r} must be finite")
        of_axes = key in [q.key for q in AXIS]
        if axis and (not of_axes or axis not in self.axes):
            allowed = f"its axes are {', '.join(self.axes)}" if of_axes else "it is one of the path"
            raise InputError(f"{key}.{axis}: the machine has no such limit; {allowed}")
        factors = np.where([name == axis for name in self.axes], factor, 1.0) if axis else factor
        return self._replace(**{key: getattr(self, key) * factors})

    def raised(self, name: str, factor: float) -> Limits:
        """Return the same limits with one of them multiplied: "jerk X", "chord error"; with "feed" also the rapids.

        Raises InputError where there is no such limit.
        """
        factor = positive_number(factor, "factor")
        for quantity in QUANTITIES:
            if quantity.scope is Scope.PATH and name == quantity.label:
                found = self.scaled(quantity.key, factor)
                return found._replace(**{RAPID: factor * self.rapid}) if quantity is FEED else found
            for axis in self.axes if quantity.scope is Scope.AXIS else ():
                if name == quantity.of(axis):
                    return self.scaled(quantity.key, factor, axis)
        known = ", ".join(limit_names(self.axes)[1:])
        raise InputError(f'"{shorten(name)}" is no limit of these; they are {known}')

    def with_axes(self, axes: Sequence[str], **rows: ArrayLike) -> Limits:
        """Return the same limits for other axes; ``rows`` by the keys of what is limited on an axis."""
        return self._replace(**rows, axes=axes)

    def for_axes(self, axes: Sequence[str], what: str) -> Limits:
        """Pick axes by name; ``what`` moves them, for the message where the machine lacks one."""
        if not self.axes:
            return self._replace(axes=axes)
        missing = [axis for axis in axes if axis not in self.axes]
        if missing:
            raise InputError(
                f"the machine has no axis {missing[0]}, which {what} moves; its axes are {', '.join(self.axes)}"
            )
        index = [self.axes.index(axis) for axis in axes]
        return self._replace(**{q.key: getattr(self, q.key)[index] for q in AXIS}, axes=axes)

    def for_curve(self, curve: Curve) -> Limits:
        """Pick the curve's axes by name out of a machine that has more of them.

        Raises InputError where the machine lacks an axis of the curve.
        """
        require_instance(curve, Curve, "curve")
        return self if tuple(curve.axes) == self.axes else self.for_axes(curve.axes, curve.name)

    def _replace(self, **changes: Any) -> Limits:
        names = (*SCALARS, *(q.key for q in AXIS), "axes")
        return Limits(**({name: getattr(self, name) for name in names} | changes))


def reserve_shares(reserve: float) -> tuple[float, float]:
    """Shares of the acceleration and of the jerk limits that a plan with a reserve for feed override uses.

    Close to full rate the jerk that is left bounds how fast the rate begins to fall, the acceleration that is left how
    fast it falls: a third as much of it is enough for both to be about equally tight.

    Raises
    ------
    InputError
        If the reserve does not lie within 0 and 0.5.
    """
    if not 0.0 <= reserve <= MAX_RESERVE:
        raise InputError(f"override_reserve = {reserve!r} must lie within 0 and {MAX_RESERVE}; 0.1 is usual, 0 is none")
    return 1.0 - reserve / 3.0, 1.0 - reserve


def require_limits(curve: Curve, limits: Limits) -> Limits:
    """Limits of every axis of a curve, at the door of a public function.

    Raises InputError if one of the two is something else, the axes do not match, or a single number is given for a rotary
    axis.
    """
    require_instance(curve, Curve, "curve")
    require_instance(limits, Limits, "limits")
    return limits.on(curve)


def _positive_row(values: ArrayLike, name: str) -> FloatArray:
    """A number > 0 for every axis (no dimension), or one for each (one dimension)."""
    row = numbers(values, name, InputError)
    if row.ndim > 1 or row.size == 0:
        raise InputError(f"{name} must be a sequence of numbers > 0, one for each axis, or one number for all")
    bad = np.flatnonzero(~(row > 0.0))
    if bad.size:
        place = f"[{bad[0]}]" if row.ndim else ""
        raise InputError(f"{name}{place} = {float(row.flat[bad[0]])!r} must be > 0; use inf for no limit")
    row.setflags(write=False)
    return row


def _spread(row: FloatArray, name: str, axes: tuple[str, ...]) -> FloatArray:
    """One number for each axis; a finite one in mm says nothing of an axis that turns."""
    rotary = [axis for axis in axes if axis in ROTARY_AXES]
    if row.ndim == 0 and rotary and np.isfinite(row):
        raise InputError(
            f"{name} = {float(row):.6g} is one number for every axis, but {rotary[0]} turns and is measured in rad; give "
            f"one number for each of {', '.join(axes)}"
        )
    spread = np.broadcast_to(row, (len(axes),)).copy()
    spread.setflags(write=False)
    return spread


def _short(values: list[float]) -> str:
    """Numbers in a list, or one where they are all the same."""
    if len(set(values)) == 1:
        return f"{values[0]:.6g}"
    return f"[{', '.join(f'{value:.6g}' for value in values)}]"


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))

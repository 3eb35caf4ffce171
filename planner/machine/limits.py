"""A machine's limits, the four feedrate limits they put on a curve, and machine files."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES, Curve, axis_names
from planner.inputs import numbers, positive_number, read_text, shorten
from planner.machine.linuxcnc_ini import machine_table
from planner.types import FloatArray, Side

if TYPE_CHECKING:
    from pydantic import BaseModel

EXAMPLE_MACHINES = ("mill", "five-axis")
_MAX_AXES = 6
_SCALARS = ("feed", "chord_error", "period", "tangential_acceleration", "tangential_jerk", "rapid")


@dataclass(frozen=True, eq=False)
class Limits:
    """What the machine and the process allow.

    Parameters
    ----------
    feed : float
        Commanded feedrate of the tool tip, mm/s.
    velocity, acceleration, jerk : (dim,) sequence of float
        Per axis, mm/s, mm/s^2, mm/s^3 (rad in place of mm for rotary axes); inf where there is no limit.
    chord_error : float
        Largest distance between the path and the chord of one period, mm.
    period : float
        Interpolation period, s.
    tangential_acceleration, tangential_jerk : float
        Limits on the second and third time derivative of the arc length, mm/s^2 and mm/s^3.
    axes : sequence of str, optional
        Names; X, Y, Z, U, V, W if left out.
    rapid : float
        Feedrate of the tool tip in the rapids of a part program, mm/s; inf where the axes alone limit them.

    Raises
    ------
    InputError
        If a value is not a positive number, or the three sequences differ in length.
    """

    feed: float
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    chord_error: float = np.inf
    period: float = 1e-3
    tangential_acceleration: float = np.inf
    tangential_jerk: float = np.inf
    axes: tuple[str, ...] = field(default=())
    rapid: float = np.inf

    def __init__(
        self,
        feed: float,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        jerk: ArrayLike,
        chord_error: float = np.inf,
        period: float = 1e-3,
        tangential_acceleration: float = np.inf,
        tangential_jerk: float = np.inf,
        axes: Sequence[str] = (),
        rapid: float = np.inf,
    ) -> None:
        given = {
            "feed": feed,
            "chord_error": chord_error,
            "period": period,
            "tangential_acceleration": tangential_acceleration,
            "tangential_jerk": tangential_jerk,
            "rapid": rapid,
        }
        for name, value in given.items():
            hint = "" if name == "period" else "; use inf for no limit"
            object.__setattr__(self, name, positive_number(value, name, hint))
        if np.isinf(self.period):
            raise InputError("period = inf must be finite, the time between two points in s")
        for name, values in (("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk)):
            object.__setattr__(self, name, _positive_row(values, f"axis_{name}"))
        sizes = [row.size for row in (self.velocity, self.acceleration, self.jerk)]
        if len(set(sizes)) != 1:
            raise InputError(
                f"velocity, acceleration and jerk have {sizes[0]}, {sizes[1]} and {sizes[2]} values; "
                "each needs one for every axis"
            )
        if sizes[0] > _MAX_AXES:
            raise InputError(f"{sizes[0]} axes are given; at most {_MAX_AXES} are allowed")
        object.__setattr__(self, "axes", axis_names(axes or None, sizes[0], "limits", InputError))

    @property
    def dim(self) -> int:
        """Number of axes."""
        return int(self.velocity.size)

    def require_matches(self, curve: Curve) -> None:
        """Raise InputError unless there is one limit for every axis of the curve."""
        if self.dim != curve.dim:
            raise InputError(
                f"the limits have {self.dim} axes ({', '.join(self.axes)}), but {curve.name} has {curve.dim} "
                f"({', '.join(curve.axes)}); give one limit for each axis of the curve"
            )

    def same_as(self, other: Limits) -> bool:
        """Whether every limit, the period and the axes are the same."""
        rows = ("velocity", "acceleration", "jerk")
        return (
            self.axes == other.axes
            and all(getattr(self, name) == getattr(other, name) for name in _SCALARS)
            and all(np.array_equal(getattr(self, name), getattr(other, name)) for name in rows)
        )

    def with_feed(self, feed: float) -> Limits:
        """Return the same limits with another commanded feedrate, mm/s."""
        return self._replace(feed=feed)

    def with_period(self, period: float) -> Limits:
        """Return the same limits with another interpolation period, s."""
        return self._replace(period=period)

    @property
    def has_jerk(self) -> bool:
        """Whether there is any jerk limit."""
        return bool(np.isfinite(self.jerk).any() or np.isfinite(self.tangential_jerk))

    def without_jerk(self) -> Limits:
        """Return the same limits without any of the jerk."""
        return self._replace(jerk=np.full(self.dim, np.inf), tangential_jerk=np.inf)

    def with_axes(self, axes: Sequence[str], **rows: ArrayLike) -> Limits:
        """Return the same limits for other axes; ``velocity``, ``acceleration`` and ``jerk`` of these."""
        return self._replace(**rows, axes=axes)

    def for_curve(self, curve: Curve) -> Limits:
        """Pick the curve's axes by name out of a machine that has more of them.

        Raises InputError where the machine lacks an axis of the curve.
        """
        if tuple(curve.axes) == self.axes:
            return self
        missing = [axis for axis in curve.axes if axis not in self.axes]
        if missing:
            raise InputError(
                f"the machine has no axis {missing[0]}, which {curve.name} moves; its axes are {', '.join(self.axes)}"
            )
        index = [self.axes.index(axis) for axis in curve.axes]
        rows = {name: getattr(self, name)[index] for name in ("velocity", "acceleration", "jerk")}
        return self._replace(**rows, axes=curve.axes)

    def _replace(self, **changes: Any) -> Limits:
        names = (*_SCALARS, "velocity", "acceleration", "jerk", "axes")
        return Limits(**({name: getattr(self, name) for name in names} | changes))


@dataclass(frozen=True, eq=False)
class FeedrateLimits:
    """The four feedrate limits along a curve, mm/s, each with the shape of u (2022, FRLimit-1 to 4)."""

    command: FloatArray
    axis_velocity: FloatArray
    chord_error: FloatArray
    normal_acceleration: FloatArray

    @property
    def lowest(self) -> FloatArray:
        """The limit that counts at every u."""
        stacked = np.stack([self.command, self.axis_velocity, self.chord_error, self.normal_acceleration])
        return np.asarray(stacked.min(axis=0))


def feedrate_limits(
    curve: Curve, limits: Limits, u: ArrayLike, *, safety: float = 1.0, side: Side = "right"
) -> FeedrateLimits:
    """Evaluate the four feedrate limits as functions of the curve parameter.

        1  F                                     the command
        2  min_j V_j / |t_j|                     t = dq/ds, the axes' share of the feed
        3  (2/T) sqrt(2 rho e - e^2)             e = min(chord_error, rho)
        4  min_j sqrt(lambda A_j / |k_j|)        k = d2q/ds2; on a plane curve k = n/rho

    Parameters
    ----------
    curve : Curve
    limits : Limits
    u : array_like
        Curve parameters.
    safety : float
        The factor lambda in (0, 1] of limit 4.
    side : {"right", "left"}
        One-sided value at a break.

    Returns
    -------
    FeedrateLimits
        Each limit with the shape of u, mm/s; inf where a limit does not apply (also where the tip rests).

    Raises
    ------
    InputError
        If the safety factor is outside (0, 1] or the axes do not match.
    """
    limits.require_matches(curve)
    factor = positive_number(safety, "safety")
    if factor > 1.0:
        raise InputError(f"safety = {factor!r} must lie in (0, 1]")
    axes = curve.derivatives(u, 2, side=side)
    tip = curve.tip.derivatives(u, 2, side=side)
    speed2 = np.sum(tip[1] ** 2, axis=-1)[..., None]
    bend = np.sum(tip[1] * tip[2], axis=-1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        axis_velocity = (limits.velocity / np.abs(axes[1] / np.sqrt(speed2))).min(axis=-1)
        # d2q/ds2, s the arc length of the tip: q''/v^2 - q' (p'.p'')/v^4
        second = (axes[2] - axes[1] * (bend / speed2)) / speed2
        normal = np.sqrt((factor * limits.acceleration / np.abs(second)).min(axis=-1))
    moving = speed2[..., 0] > 0.0
    return FeedrateLimits(
        command=commanded_feed(curve, limits, np.asarray(u, dtype=np.float64), side == "left"),
        axis_velocity=np.where(moving, axis_velocity, np.inf),
        chord_error=chord_feed_limit(curve.tip.curvature(u, side=side), limits),
        normal_acceleration=np.where(moving, normal, np.inf),
    )


def commanded_feed(curve: Curve, limits: Limits, u: FloatArray, left: NDArray[np.bool_] | bool = False) -> FloatArray:
    """Feed limit at parameters u, mm/s: the lower of that of the limits and of the curve's own caps; of rapids their own."""
    if curve.feed_caps is None:
        return np.full(u.shape, limits.feed)
    cap = curve.feed_caps.at(u, left)
    return np.where(np.isinf(cap), limits.rapid, np.minimum(limits.feed, cap))


COMMANDS = ("feed", "programmed feed", "rapid")


def command_kind(
    curve: Curve, limits: Limits, u: FloatArray, left: NDArray[np.bool_] | bool = False
) -> NDArray[np.int8]:
    """Which of ``COMMANDS`` sets the feed limit at parameters u: that of the limits, a cap of the curve, that of rapids."""
    if curve.feed_caps is None:
        return np.zeros(u.shape, dtype=np.int8)
    cap = curve.feed_caps.at(u, left)
    return np.where(np.isinf(cap), 2, np.where(cap < limits.feed, 1, 0)).astype(np.int8)


def largest_command(curve: Curve, limits: Limits) -> float:
    """Largest feed commanded anywhere on a curve, mm/s."""
    if curve.feed_caps is None:
        return limits.feed
    return float(commanded_feed(curve, limits, curve.feed_caps.edges[:-1]).max())


def chord_feed_limit(curvature: FloatArray, limits: Limits) -> FloatArray:
    """Feed at which the chord of one period leaves the osculating circle by the chord error, mm/s.

    (2/T) sqrt(2 rho e - e^2); where the tolerance e exceeds the radius rho, it takes the radius.
    """
    if np.isinf(limits.chord_error):
        return np.full(curvature.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = 1.0 / curvature
        error = np.minimum(limits.chord_error, radius)
        limit = 2.0 / limits.period * np.sqrt(error * (2.0 * radius - error))
    return np.where(curvature > 0.0, limit, np.inf)


def load_limits(path: str | Path) -> Limits:
    """Load a machine file (TOML, or the INI of a LinuxCNC machine), or one of the example machines by name.

    Keys: ``feed_mm_s``, ``rapid_mm_s``, ``chord_error_mm``, ``period_s``, ``tangential_acceleration_mm_s2``,
    ``tangential_jerk_mm_s3``, and one ``[[axis]]`` each with ``name``, ``velocity_mm_s``, ``acceleration_mm_s2``,
    ``jerk_mm_s3`` (``_rad_s``, ``_rad_s2``, ``_rad_s3`` for the rotary axes A, B, C).  ``inf`` means no limit.
    For what is read of an INI file see :mod:`planner.machine.linuxcnc_ini`.

    Parameters
    ----------
    path : str or Path
        A ``.toml`` or ``.ini`` file, or one of :data:`EXAMPLE_MACHINES`.

    Returns
    -------
    Limits

    Raises
    ------
    InputError
        Naming the file, the key, its value and what is allowed.
    """
    if path == "":
        raise InputError(
            f"machine '' must be a file, .toml or .ini, or an example machine: {', '.join(EXAMPLE_MACHINES)}"
        )
    if isinstance(path, str) and path in EXAMPLE_MACHINES:
        text = resources.files("planner").joinpath(f"data/machines/{path}.toml").read_text(encoding="utf-8")
        return _limits_from_toml(text, path)
    try:
        text = read_text(path, InputError)
    except InputError as error:
        if isinstance(path, str) and not Path(path).suffix:
            raise InputError(f"{error}; the example machines are {', '.join(EXAMPLE_MACHINES)}") from None
        raise
    if Path(path).suffix.lower() == ".ini":
        return _limits_from_table(machine_table(text, str(path)), str(path))
    return _limits_from_toml(text, str(path))


def _limits_from_toml(text: str, where: str) -> Limits:
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not a valid TOML file ({error})") from None
    return _limits_from_table(table, where)


def _limits_from_table(table: dict[str, Any], where: str) -> Limits:
    machine, linear, rotary = _file_models()
    axes = table.pop("axis", [])
    head = _validated(machine, table, where, "")
    if not isinstance(axes, list) or not axes or not all(isinstance(axis, dict) for axis in axes):
        raise InputError(
            f'{where}: one "[[axis]]" table for each axis is needed, with name, velocity, acceleration and jerk'
        )
    rows: list[dict[str, Any]] = []
    for i, axis in enumerate(axes):
        name = axis.get("name")
        known = isinstance(name, str) and name in AXES
        model = rotary if known and name in ROTARY_AXES else linear
        rows.append(_validated(model, axis, where, f"axis[{i}] ({name})" if known else f"axis[{i}]"))
    names = [row.pop("name") for row in rows]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f'{where}: axis "{twice[0]}" is given twice')
    velocity, acceleration, jerk = zip(*(row.values() for row in rows), strict=True)
    try:
        return Limits(
            head["feed_mm_s"],
            velocity,
            acceleration,
            jerk,
            chord_error=head["chord_error_mm"],
            period=head["period_s"],
            tangential_acceleration=head["tangential_acceleration_mm_s2"],
            tangential_jerk=head["tangential_jerk_mm_s3"],
            rapid=head["rapid_mm_s"],
            axes=names,
        )
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _validated(model: type[BaseModel], table: Mapping[str, Any], where: str, place: str) -> dict[str, Any]:
    """Values of a table of a machine file, in the order of the model's keys."""
    from pydantic import ValidationError

    try:
        return model.model_validate(table).model_dump()
    except ValidationError as error:
        findings, keys = error.errors(), list(model.model_fields)
    # A misspelt key is both unknown and missing; the unknown one is what the person wrote.
    first = next((finding for finding in findings if finding["type"] == "extra_forbidden"), findings[0])
    key = ".".join(str(part) for part in first["loc"])
    label = f"{place}.{key}" if place else key
    match first["type"]:
        case "missing":
            raise InputError(f'{where}: "{label}" is missing; the keys are {", ".join(keys)}')
        case "extra_forbidden":
            raise InputError(f'{where}: unknown key "{label}"; the keys are {", ".join(keys)}')
        case "literal_error":
            raise InputError(f"{where}: {label} = {shorten(repr(first['input']))} must be one of {', '.join(AXES)}")
    allowed = "a finite number > 0" if key == "period_s" else "a number > 0; use inf for no limit"
    raise InputError(f"{where}: {label} = {shorten(repr(first['input']))} must be {allowed}")


@cache
def _file_models() -> tuple[type[BaseModel], type[BaseModel], type[BaseModel]]:
    """Pydantic models of the head of a machine file, of a linear axis and of a rotary one."""
    from typing import Annotated, Literal

    from pydantic import BaseModel, ConfigDict, Field

    positive = Annotated[float, Field(gt=0.0)]
    finite = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]

    class Strict(BaseModel):
        model_config = ConfigDict(extra="forbid", strict=True)

    class Machine(Strict):
        feed_mm_s: positive
        rapid_mm_s: positive = float("inf")
        chord_error_mm: positive = float("inf")
        period_s: finite = 1e-3
        tangential_acceleration_mm_s2: positive = float("inf")
        tangential_jerk_mm_s3: positive = float("inf")

    class LinearAxis(Strict):
        name: Literal["X", "Y", "Z", "U", "V", "W"]
        velocity_mm_s: positive
        acceleration_mm_s2: positive
        jerk_mm_s3: positive

    class RotaryAxis(Strict):
        name: Literal["A", "B", "C"]
        velocity_rad_s: positive
        acceleration_rad_s2: positive
        jerk_rad_s3: positive

    return Machine, LinearAxis, RotaryAxis


def _positive_row(values: ArrayLike, name: str) -> FloatArray:
    row = numbers(values, name, InputError)
    if row.ndim != 1 or row.size == 0:
        raise InputError(f"{name} must be a sequence of numbers > 0, one for each axis")
    bad = np.flatnonzero(~(row > 0.0))
    if bad.size:
        raise InputError(f"{name}[{bad[0]}] = {float(row[bad[0]])!r} must be > 0; use inf for no limit")
    row.setflags(write=False)
    return row

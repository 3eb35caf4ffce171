"""Arguments of a greedy run, checked and packed as its compiled loop wants them."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np

from interp.literature import greedy_layout as k
from interp.literature.greedy_published import DEFECTS, scale_of
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import positive_number
from planner.machine.limits import Limits
from planner.quantity import JERK
from planner.types import FloatArray

GreedyMode = Literal["compat", "physical"]
ErrorCurve = Literal["teardrop", "own"]
Variant = Literal["theta", "root"]
StepFeed = Literal["command", "planned"]
Formula = Literal["published", "exact"]
Braking = Literal["strict", "soft"]
# A path as compiled code takes it: breaks in [0, 1], coefficients, numbers of pieces and of powers, rational, axes.
UnitPieces = tuple[FloatArray, FloatArray, int, int, bool, int]

_SCAN_POINTS = 1000
_SINGULAR = 1e-12  # of the largest |C'|


@dataclass(frozen=True, eq=False)
class GreedySetup:
    """A run as compiled code wants it."""

    curve: Curve
    limits: Limits
    algorithm: int
    mode: GreedyMode
    variant: Variant
    repaired: Mapping[str, str]  # value of each argument of DEFECTS
    max_steps: int
    settings: FloatArray
    own: UnitPieces
    error: UnitPieces
    top_speed: float

    @property
    def physical(self) -> bool:
        """Whether the run does what the text of the thesis describes."""
        return self.mode == "physical"

    def setting(self, index: int) -> float:
        """One of ``settings``, by its index in ``greedy_layout``."""
        return float(self.settings[index])


def set_up(
    curve: Curve,
    limits: Limits,
    algorithm: int,
    mode: GreedyMode,
    variant: Variant,
    switches: Mapping[str, str | None],
    braking: Braking,
    shape: tuple[float, float, float, float],
    max_steps: int,
) -> GreedySetup:
    """Check the arguments of :func:`~interp.literature.greedy.greedy` and pack them.

    ``switches`` are the arguments of DEFECTS by name, None where left out; ``shape`` is safety, u_rise, u_fall, min_feed.
    """
    if algorithm not in (1, 2, 3, 4) or isinstance(algorithm, bool):
        raise InputError(f"algorithm = {algorithm!r} must be 1, 2, 3 or 4")
    _require_choice("mode", mode, ("compat", "physical"))
    _require_choice("variant", variant, ("theta", "root"))
    _require_choice("braking", braking, ("strict", "soft"))
    physical = mode == "physical"
    chosen = _switches(switches, physical)
    safety, u_rise, u_fall, min_feed = _shape(*shape)
    count = _step_count(max_steps)
    if not isfinite(limits.feed):
        raise InputError("feed = inf must be finite: these algorithms start from a commanded feedrate")
    if not physical and algorithm >= 2 and not isfinite(limits.chord_error):
        raise InputError(f"chord_error = inf must be finite for Algorithm {algorithm}, which holds the chord error")
    first = np.linalg.norm(curve.derivatives(np.linspace(*curve.domain, _SCAN_POINTS), 1)[1], axis=-1)
    top_speed = float(first.max()) * (curve.domain[1] - curve.domain[0])
    settings = np.zeros(k.SETTINGS)
    settings[k.PERIOD], settings[k.FEED], settings[k.TOLERANCE] = limits.period, limits.feed, limits.chord_error
    settings[k.SAFETY], settings[k.RISE], settings[k.FALL], settings[k.FLOOR] = safety, u_rise, u_fall, min_feed
    settings[k.JERK] = float(limits.of_motions(JERK.order).min())
    settings[k.ALGORITHM], settings[k.ROOT] = algorithm, variant == "root"
    settings[k.EXACT_TAYLOR], settings[k.PLANNED_FEED] = chosen["taylor"] == "exact", chosen["step_feed"] == "planned"
    if chosen["second_derivatives"] == "published":
        settings[k.WRONG_BEND] = scale_of(curve, "butterfly")
    settings[k.SOFT], settings[k.SINGULAR_SPEED] = braking == "soft", _SINGULAR * top_speed
    own = _path(curve)
    error = own if chosen["error_curve"] == "own" else _teardrop()
    return GreedySetup(curve, limits, algorithm, mode, variant, chosen, count, settings, own, error, top_speed)


def _require_choice(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"{name} = {value!r} must be {' or '.join(repr(choice) for choice in allowed)}")


def _switches(given: Mapping[str, str | None], physical: bool) -> dict[str, str]:
    """Fill in what a mode means; mode physical has no defects to switch on."""
    chosen = {}
    for name, published, repaired in DEFECTS.values():
        value = given[name]
        if value is not None:
            _require_choice(name, value, (published, repaired))
        if physical and value == published:
            raise InputError(f'{name} = {value!r} is a defect of mode "compat"; mode "physical" has {repaired!r}')
        chosen[name] = value or (repaired if physical else published)
    return chosen


def _shape(safety: float, u_rise: float, u_fall: float, min_feed: float) -> tuple[float, float, float, float]:
    factor, rise = positive_number(safety, "safety"), positive_number(u_rise, "u_rise")
    fall, floor = positive_number(u_fall, "u_fall"), positive_number(min_feed, "min_feed")
    if factor > 1.0:
        raise InputError(f"safety = {factor!r} must lie in (0, 1]")
    if rise >= 1.0 or fall >= 1.0:
        raise InputError(f"u_rise = {rise!r} and u_fall = {fall!r} must lie in (0, 1), shares of the range of u")
    if not isfinite(floor):
        raise InputError("min_feed = inf must be finite, a feedrate in mm/s")
    return factor, rise, fall, floor


def _step_count(max_steps: int) -> int:
    try:
        count = operator.index(max_steps)
    except TypeError:
        count = 0
    if count < 1:
        raise InputError(f"max_steps = {max_steps!r} must be a whole number > 0")
    return count


def _path(curve: Curve) -> UnitPieces:
    """The curve's pieces over [0, 1]."""
    pieces = curve.pieces
    u0, u1 = curve.domain
    breaks = (pieces.breaks - u0) / (u1 - u0)
    breaks[0], breaks[-1] = 0.0, 1.0
    return _unit_pieces(breaks, pieces.powers, pieces.rational)


def _teardrop() -> UnitPieces:
    """The teardrop as its own polynomials, which is exact, and fast where a back-off takes thousands of trials."""
    x, y, one = [0.0, -150.0, 450.0, -300.0], [0.0, -150.0, 150.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    return _unit_pieces(np.array([0.0, 1.0]), np.array([[x, y, one]]), False)


def _unit_pieces(breaks: FloatArray, coefficients: FloatArray, rational: bool) -> UnitPieces:
    pieces, rows, powers = coefficients.shape
    return breaks, coefficients, pieces, powers, rational, rows - 1

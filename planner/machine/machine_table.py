"""What a machine file says, whatever its format: limits in mm, rad and s, with what is lacking; and the machine of it.

Every format is read into a :class:`MachineTable`.  What a file lacks can be completed by the caller; a velocity or an
acceleration that is still lacking is asked for by its name in the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from planner.errors import InputError
from planner.geometry.curve import ROTARY_AXES
from planner.inputs import positive_number, shorten
from planner.machine.limits import Limits
from planner.machine.program_setup import ProgramSetup
from planner.quantity import AXIS, JERK, Quantity

COMPLETIONS = tuple(q.file_key(length) for length in ("mm", "rad") for q in AXIS)
"""What can be given for the axes that a machine file lacks it for."""


@dataclass(frozen=True)
class Machine:
    """A machine as its file says it.

    Attributes
    ----------
    limits : Limits
        Of all its axes.
    setup : ProgramSetup
        What its programs count on.
    notes : tuple of str
        What a person should know of the limits: what was given beside the file, what has no limit.
    """

    limits: Limits
    setup: ProgramSetup = field(default_factory=ProgramSetup)
    notes: tuple[str, ...] = ()


@dataclass
class AxisTable:
    """Limits of an axis by the key of the quantity, mm or rad and s; of what is lacking, how the file would say it."""

    name: str
    values: dict[str, float]
    lacking: dict[str, str] = field(default_factory=dict)

    @property
    def length(self) -> str:
        """Unit of its positions: "mm" or "rad"."""
        return "rad" if self.name in ROTARY_AXES else "mm"


@dataclass
class MachineTable:
    """A machine file: ``head`` are the arguments of :class:`Limits` that are one number."""

    where: str
    head: dict[str, float]
    axes: list[AxisTable]
    setup: ProgramSetup = field(default_factory=ProgramSetup)
    notes: tuple[str, ...] = ()

    def machine(self, complete: Mapping[str, float] | None = None) -> Machine:
        """Make the machine; ``complete`` are limits of the axes that lack them, by the keys of :data:`COMPLETIONS`.

        Raises
        ------
        InputError
            If a limit is lacking and not given, or what is given completes nothing.
        """
        given = required_completions(complete)
        notes = [*self.notes, *(self._completed(key, value) for key, value in given.items())]
        for axis in self.axes:
            self._require(axis)
        unlimited = [axis.name for axis in self.axes if math.isinf(axis.values[JERK.key])]
        if unlimited:
            notes.append(f"no jerk limit on {' '.join(unlimited)}")
        rows: dict[str, Any] = {q.key: [axis.values[q.key] for axis in self.axes] for q in AXIS}
        try:
            limits = Limits(**self.head, **rows, axes=[axis.name for axis in self.axes])
        except InputError as error:
            raise InputError(f"{self.where}: {error}") from None
        return Machine(limits, self.setup, tuple(notes))

    def _completed(self, key: str, value: float) -> str:
        """Give a limit to the axes that have none; says to which."""
        quantity, length = _quantity_of(key)
        own = [axis for axis in self.axes if axis.length == length]
        open_ = [axis for axis in own if math.isinf(axis.values.get(quantity.key, math.inf))]
        if not open_:
            said = ", ".join(f"{axis.name} {axis.values[quantity.key]:.6g}" for axis in own) or "no such axis"
            raise InputError(
                f"{self.where}: {key} = {value:.6g} completes what the file lacks, but it has {quantity.label} of every "
                f"axis in {length} ({said}); change it there, or leave {key} out"
            )
        for axis in open_:
            axis.values[quantity.key] = value
        return f"{quantity.label} {value:.6g} {quantity.unit(length)} given for {' '.join(axis.name for axis in open_)}"

    def _require(self, axis: AxisTable) -> None:
        for quantity in AXIS:
            if quantity.key in axis.values:
                continue
            key = quantity.file_key(axis.length)
            raise InputError(
                f"{self.where}: {axis.lacking[quantity.key]} is missing, {quantity.label} of axis {axis.name}; write it "
                f"there, or give {key} (--{key.replace('_', '-')})"
            )


def required_completions(complete: Mapping[str, float] | None) -> dict[str, float]:
    """What is given to complete a machine file: numbers > 0 by known keys."""
    if complete is None:
        return {}
    if not isinstance(complete, Mapping):
        raise InputError(f"complete = {shorten(repr(complete))} must map keys to numbers, such as jerk_mm_s3 to 20000")
    for key in complete:
        if key not in COMPLETIONS:
            raise InputError(f"complete: unknown key {shorten(repr(key))}; the keys are {', '.join(COMPLETIONS)}")
    return {key: positive_number(value, key) for key, value in complete.items()}


def _quantity_of(key: str) -> tuple[Quantity, str]:
    """The quantity of a key, and the unit of the positions it is of."""
    return next((q, length) for length in ("mm", "rad") for q in AXIS if q.file_key(length) == key)

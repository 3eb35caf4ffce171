"""The interpolator of a controller, ``interp/step.c``, from Python: the very source that the controller compiles.

    step = PlanStep("part.fpr")
    while not step.step(override=0.8):
        send(step.position)

The positions are those that the machine will be sent, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from planner.compiled import core
from planner.errors import InputError
from planner.samples import Samples
from planner.types import FloatArray

_COUNTS_AT, _NUMBERS_AT = 32, 64
_ERRORS = {
    1: "its bytes must begin at a multiple of 8",
    2: "it is no plan file",
    3: "it is a plan file of another version",
    4: "it is cut off, or its sizes contradict one another",
    5: "its checksum is another: bytes were changed on the way",
    6: "a number in it is not finite, or not in its range",
    7: "times, parameters or bounds in it are out of order",
    8: "it numbers a curve piece or a line that is none",
}
_CHUNK = 1 << 16
_MAX_SAMPLES = 1 << 33  # of a plan, as in step.c


class PlanStep:
    """A plan that is stepped through, one sample a period, with feed override and feed hold.

    Parameters
    ----------
    source : str, Path or bytes
        A plan file, or what stands in one.
    period : float, optional
        Time between two samples, s; that of the plan if left out.

    Attributes
    ----------
    content : bytes
        The plan file.
    dim : int
        Number of machine axes.
    period, duration : float
        s.
    governed : bool
        Whether override and hold are obeyed: only a plan that was made with a reserve can.
    position : (dim,) array
        The sample, mm (rad for rotary axes); each step changes it.

    Raises
    ------
    InputError
        If the file cannot be read or the interpolator refuses it, or the period is not positive and finite.
    """

    def __init__(self, source: str | Path | bytes, period: float | None = None) -> None:
        self.content, name = (source, "these bytes") if isinstance(source, bytes) else (_read(source), str(source))
        sizes = np.zeros(2, dtype=np.int64)
        core.step_sizes(sizes)
        # float64 for the alignment: the file's numbers are read where they stand
        self._bytes = np.zeros(-(-len(self.content) // 8) or 1).view(np.uint8)
        self._bytes[: len(self.content)] = np.frombuffer(self.content, dtype=np.uint8)
        self._plan, self._state = (np.zeros(-(-int(size) // 8)).view(np.uint8) for size in sizes)
        wrong = core.step_open(self._bytes, len(self.content), self._plan)
        if wrong:
            raise InputError(f"{name}: {_ERRORS[wrong]}")
        counts = np.frombuffer(self.content, dtype="<u4", count=7, offset=_COUNTS_AT)
        numbers = np.frombuffer(self.content, dtype="<f8", count=4, offset=_NUMBERS_AT)
        self.dim, self.governed = int(counts[0]), bool(counts[6])
        self.duration = float(numbers[0])
        self.period = float(numbers[3] if period is None else period)
        if not (isfinite(self.period) and self.period > 0.0) or core.step_start(self._plan, self._state, self.period):
            raise InputError(
                f"period = {self.period!r} s must be > 0 and finite, and make fewer than 2^33 samples of the plan"
            )
        self.position = np.zeros(self.dim)
        self._place = np.zeros(7)
        self._command = np.array([1.0, 0.0])
        self._override, self._hold = 1.0, False
        self._held = (self._plan, self._state, self._command, self.position)  # alive as long as their addresses
        self._addresses = np.array([array.ctypes.data for array in self._held], dtype=np.int64)
        self._call: Callable[[], int] = core.step_once.bind(self._addresses)
        self._look()

    def step(self, override: float = 1.0, hold: bool = False) -> bool:
        """Go to the next sample; True once it is the end, which is then held.

        Parameters
        ----------
        override : float
            Rate that is asked for, 0 to 1; what lies outside counts as the nearer end.
        hold : bool
            Ask for a stop on the path.

        Raises
        ------
        InputError
            If the plan is not governed and is asked for another rate than 1.
        """
        if override != self._override or hold != self._hold:
            if not self.governed:
                raise InputError(_NOT_GOVERNED)
            self._command[0], self._command[1] = override, hold
            self._override, self._hold = override, hold
        return self._call() != 0

    def run(self, count: int, override: ArrayLike = 1.0, hold: ArrayLike = False) -> tuple[FloatArray, FloatArray]:
        """Take many steps, at most to the end.

        Parameters
        ----------
        count : int
        override, hold : float and bool, or (count,) arrays
            For each period.

        Returns
        -------
        positions : (n, dim) array
            n <= count: the last is the end where there are fewer.
        course : (n, 4) array
            Plan time, s, rate, the slope of the rate, 1/s, and curve parameter after each step.

        Raises
        ------
        InputError
            If override or hold are of another shape, or ask a plan that is not governed for another rate than 1.
        """
        asked, held = np.asarray(override, dtype=np.float64), np.asarray(hold, dtype=bool)
        if count < 0 or any(of.shape not in ((), (count,)) for of in (asked, held)):
            raise InputError(
                f"count = {count!r} must be >= 0, and override and hold, of the shapes {asked.shape} and {held.shape}, one "
                "number or one for each step"
            )
        asked, held = (np.ascontiguousarray(np.broadcast_to(of, (count,))) for of in (asked, held))
        if not self.governed and (held.any() or (asked != 1.0).any()):
            raise InputError(_NOT_GOVERNED)
        positions, course = np.empty((count, self.dim)), np.empty((count, 4))
        taken = core.step_run(self._plan, self._state, count, asked, held, positions.reshape(-1), course.reshape(-1))
        if taken:
            self.position[:] = positions[taken - 1]
        return positions[:taken], course[:taken]

    def seek(self, time: float | None = None, *, sample: int | None = None, rate: float = 0.0) -> None:
        """Go to a plan time, s, or to a sample of the plan.

        ``rate`` is what the plan runs at there: 0 where the machine stands at that point, 1 where it comes along the plan.

        Raises
        ------
        InputError
            If neither or both are given, or the place does not lie within the plan; a sample is a whole number.
        """
        if (time is None) == (sample is None):
            raise InputError("give either a time or a sample")
        # The number goes to C as 64 bits: what has no place there, or is no whole number, must not become another.
        whole = sample is None or (0 <= sample < _MAX_SAMPLES and sample == int(sample))
        at, number = (
            (float(time), -1) if time is not None else (inf, int(sample) if sample is not None and whole else -1)
        )
        if not whole or core.step_seek(self._plan, self._state, at, number, rate):
            place = f"time = {time!r} s" if sample is None else f"sample = {sample!r}"
            rates = "from 0 to 1" if self.governed else "1, since it is not governed"
            raise InputError(
                f"{place}, rate = {rate!r}: must lie within the plan of {self.duration!r} s, the rate {rates}"
            )
        self._look()

    @property
    def time(self) -> float:
        """Plan time, s."""
        return self._looked(0)

    @property
    def u(self) -> float:
        """Curve parameter."""
        return self._looked(1)

    @property
    def rate(self) -> float:
        """What the plan runs at; 1 is as it was made."""
        return self._looked(2)

    @property
    def rate_slope(self) -> float:
        """Time derivative of the rate, 1/s."""
        return self._looked(3)

    @property
    def progress(self) -> float:
        """Share of the plan time that is done, 0 to 1."""
        return self._looked(4)

    @property
    def line(self) -> int:
        """Number of the program line that is run; 0 where the plan is of no program."""
        return int(self._looked(5))

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self._looked(6) != 0.0

    @property
    def stop_room(self) -> float:
        """Plan time, s, within which a governed plan stops from any state of its rate: see ``interp/stream.h``."""
        return float(core.stop_room(self._plan, self.period))

    def snapshot(self) -> bytes:
        """What :meth:`restore` continues from, identically."""
        return self._state.tobytes()

    def restore(self, snapshot: bytes) -> None:
        """Continue from a snapshot of this plan at this period."""
        if len(snapshot) != self._state.size:
            raise InputError(f"a snapshot has {self._state.size} bytes, not {len(snapshot)}")
        self._state[:] = np.frombuffer(snapshot, dtype=np.uint8)
        self._look()

    def samples(self, axes: tuple[str, ...] = (), override: ArrayLike = 1.0, hold: ArrayLike = False) -> Samples:
        """Run to the end, and return the samples from where the plan is.

        Arrays ``override`` and ``hold`` are one value a period; after their last the rate asked for is 1.
        """
        size = max(np.size(override), np.size(hold)) if np.ndim(override) or np.ndim(hold) else 0
        parts = [self.position[None].copy()]
        courses = [np.array([[self.time, self.rate, self.rate_slope, self.u]])]
        if size:
            positions, course = self.run(size, override, hold)
            parts.append(positions)
            courses.append(course)
            override, hold = 1.0, False
        while not self.done:
            positions, course = self.run(_CHUNK, override, hold)
            parts.append(positions)
            courses.append(course)
            if course.size and not self.done and not (course[:, 1] > 0.0).any():
                raise InputError("the plan is held for ever: override or hold must let it run")
        position = np.concatenate(parts)
        t = self.period * np.arange(position.shape[0], dtype=np.float64)
        return Samples(self.period, t, np.concatenate(courses)[:, 3], position, axes=axes)

    def _looked(self, which: int) -> float:
        scratch = np.empty(self.dim)
        core.step_place(self._plan, self._state, self._place, scratch)
        return float(self._place[which])

    def _look(self) -> None:
        core.step_place(self._plan, self._state, self._place, self.position)


_NOT_GOVERNED = (
    "the plan was made without a reserve: it cannot be slowed down or held within the limits; plan it with an "
    "override reserve"
)


def _read(source: str | Path) -> bytes:
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror})") from None

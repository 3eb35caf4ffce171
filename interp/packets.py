"""A long plan in packets, each with a stop tail, and the ring from which a controller runs them (``interp/stream.h``).

    packets = PlanPackets("part.fpr")
    stream = PacketStream(packets.period, packets.dim, packets.largest)
    while stream.put_count < len(packets) and stream.put(packets[stream.put_count]):
        pass                                   # the producer: False is "the ring is full, later"
    status = stream.step(override, hold)       # the consumer, once a period

A packet is a plan file of a stretch of the plan, from a sample of it to another, and the stop tail: as much of what follows
as the governor needs to stop from any state.  Each is made of the plan and its number alone; a producer that died is
replaced by one that goes on with packet ``put_count``.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from math import ceil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from interp import plan_file
from interp.plan_file import PlanFile, read_plan_file
from interp.step import PlanStep
from interp.taylor import expanded, last_sample
from planner.compiled import core
from planner.errors import InputError
from planner.types import FloatArray

SECONDS = 2.0  # of a packet's own stretch
_FULL = 100
_REFUSED = {
    101: "the plan was made without a reserve: it cannot be stopped where packets come late",
    102: "it is larger than a slot",
    103: "it does not begin where the packet before it ends, or is of another plan",
    104: "its tail is too short to stop in",
    105: "its first samples are not those of the tail before it",
}
_SHORTEST = 4  # samples of a packet's own stretch: so many are compared with the tail before it


class StreamStatus(IntEnum):
    """How a step of a stream went; the numbers are those of ``interp/stream.h``."""

    RUNNING = 0
    DONE = 1
    LATE = 2
    EMPTY = 3


@dataclass(frozen=True)
class Packet:
    """A stretch of a plan with its stop tail.

    Attributes
    ----------
    content : bytes
        A plan file.
    first, next : int
        Samples of the whole plan at which its own stretch begins and ends; the tail is what the file holds beyond.
    is_last : bool
        It holds the end of the plan, and no tail.
    """

    content: bytes
    first: int
    next: int
    is_last: bool


class PlanPackets:
    """The packets of a plan.

    Parameters
    ----------
    source : str, Path or bytes
        A plan file of a plan that was made with a reserve, or its bytes.
    period : float, optional
        Of the controller, s; that of the plan if left out.
    seconds : float
        Of plan time in a packet's own stretch.

    Raises
    ------
    InputError
        If the plan has no reserve, or the seconds are too few to make a packet.
    """

    def __init__(self, source: str | Path | bytes, period: float | None = None, seconds: float = SECONDS) -> None:
        self.plan: PlanFile = read_plan_file(source)
        step = PlanStep(self.plan.content, period)
        if not step.governed:
            raise InputError(_REFUSED[101])
        self.period, self.dim = step.period, step.dim
        self.room = step.stop_room
        self._last = last_sample(self.plan.table.duration, self.period)
        own = round(seconds / self.period) if 0.0 < seconds < np.inf else 0
        if own < _SHORTEST:
            raise InputError(f"seconds = {seconds!r} must be at least {_SHORTEST} periods of {self.period!r} s")
        # What is left behind the last of these is no shorter than a tail.
        count = ceil(max(self._last - (self.room / self.period + 2.0), 0.0) / own)
        self._starts = own * np.arange(max(count, 1))

    def __len__(self) -> int:
        return self._starts.size

    def __getitem__(self, number: int) -> Packet:
        """Cut packet ``number``."""
        first, is_last = int(self._starts[number]), number == len(self) - 1
        following = self._last if is_last else int(self._starts[number + 1])
        whole = self.plan.table.duration
        end = whole if is_last else min(following * self.period + self.room + self.period, whole)
        return Packet(_cut(self.plan, first * self.period, end), first, following, is_last)

    def __iter__(self) -> Iterator[Packet]:
        return (self[number] for number in range(len(self)))

    @property
    def largest(self) -> int:
        """Size of the largest packet, bytes."""
        return max(len(packet.content) for packet in self)


class PacketStream:
    """The ring of packets, with its producer's and its consumer's side.

    Parameters
    ----------
    period : float
        Of the controller, s.
    dim : int
        Number of machine axes.
    packet_size : int
        Bytes of the largest packet.
    slots : int
        Packets in the ring, the one that is run among them.
    memory : (n,) uint8 array, optional
        Where the stream stands, n as :meth:`memory_size` says, the first byte at a multiple of 8; for processes that
        share memory at one address.

    Attributes
    ----------
    position : (dim,) array
        The sample; each step changes it.
    """

    def __init__(
        self, period: float, dim: int, packet_size: int, slots: int = 3, memory: NDArray[np.uint8] | None = None
    ) -> None:
        size = self.memory_size(packet_size, slots)
        self._memory = np.zeros(size // 8 + 1).view(np.uint8)[:size] if memory is None else memory
        if self._memory.size < size or core.stream_open(self._memory, self._memory.size, slots, period):
            raise InputError(
                f"period = {period!r} s must be > 0 and finite, slots = {slots!r} at least 2, and memory of "
                f"{self._memory.size} bytes at least {size}, at a multiple of 8"
            )
        self.position, self._course, self._command = np.zeros(dim), np.zeros(3), np.array([1.0, 0.0])
        self._step = core.stream_step.bind(self._memory, self._command, self.position, self._course)

    @classmethod
    def attach(cls, memory: NDArray[np.uint8]) -> PacketStream:
        """The producer's side of a stream that stands in memory; it does not step."""
        stream = cls.__new__(cls)
        stream._memory = memory
        return stream

    @staticmethod
    def memory_size(packet_size: int, slots: int = 3) -> int:
        """Bytes that a stream takes."""
        return int(core.stream_size(slots, packet_size))

    @property
    def put_count(self) -> int:
        """Number of packets that were put: that of the next one."""
        return int(core.stream_put_count(self._memory))

    def put(self, packet: Packet) -> bool:
        """Hand a packet over; False where the ring is full.

        Raises
        ------
        InputError
            If the interpolator refuses it; the ring is then as it was.
        """
        place = np.array([packet.first, packet.next, packet.is_last], dtype=np.int64)
        content = np.frombuffer(packet.content, dtype=np.uint8)
        wrong = core.stream_put(self._memory, place, content, content.size)
        if wrong and wrong != _FULL:
            why = _REFUSED.get(wrong, "its bytes are no plan file of this period")
            raise InputError(f"packet {self.put_count} of samples {packet.first} to {packet.next}: {why}")
        return wrong == 0

    def step(self, override: float = 1.0, hold: bool = False) -> StreamStatus:
        """Go to the next sample; LATE: it holds on the path, since the next packet is not there."""
        self._command[0], self._command[1] = override, hold
        return StreamStatus(self._step())

    @property
    def time(self) -> float:
        """Time of the whole plan, s."""
        return float(self._course[0])

    @property
    def u(self) -> float:
        """Curve parameter."""
        return float(self._course[1])

    @property
    def rate(self) -> float:
        """What the plan runs at; 1 is as it was made."""
        return float(self._course[2])


def _cut(plan: PlanFile, start: float, end: float) -> bytes:
    """A plan file of a plan from one time, s, to another."""
    table = plan.table
    rows, begin = table.segments[:-1], table.segments[:-1, 0]
    first = int(np.searchsorted(begin, start, side="right")) - 1
    last = max(int(np.searchsorted(begin, end, side="left")) - 1, first)
    law = rows[first : last + 1].copy()
    law[0, 1:7] = expanded(law[0, 1:7, None], np.array([start - law[0, 0]]))[:, 0]
    law[:, 0] = np.maximum(law[:, 0] - start, 0.0)
    pieces = slice(int(law[0, 7]), int(law[-1, 7]) + 1)
    ends = [_point(plan, row, time) for row, time in ((rows[first], start), (rows[last], end))]
    u, position = zip(*ends, strict=True)
    if start == 0.0:
        u, position = (table.u_range[0], u[1]), (table.ends[0], position[1])
    if end == table.duration:
        u, position = (u[0], table.u_range[1]), (position[0], table.ends[1])
    law[:, 7] -= pieces.start
    closing = np.array([[np.inf, *[0.0] * 7]])
    curve = np.concatenate([table.pieces[pieces], table.pieces[-1:]])
    return _packed(plan, (end - start, *u), np.array(position), curve, np.concatenate([law, closing]), start)


def _point(plan: PlanFile, row: FloatArray, time: float) -> tuple[float, FloatArray]:
    """Curve parameter and position of a time within a row of the law."""
    w = float(np.clip(np.polynomial.polynomial.polyval(time - row[0], row[1:7]), 0.0, 1.0))
    piece, dim = plan.table.pieces[int(row[7])], plan.table.dim
    values = np.array([np.polyval(line, w) for line in piece[1:]])
    position = values[:dim] / values[dim] if values.size > dim else values
    return float(piece[0, 0] + piece[0, 1] * w), position


def _packed(
    plan: PlanFile,
    numbers: tuple[float, float, float],
    ends: FloatArray,
    curve: FloatArray,
    law: FloatArray,
    start: float,
) -> bytes:
    """The bytes of a plan file with the limits, the governor and the names of another; numbers: duration and both u."""
    content = bytearray(plan.content)
    counts_at = plan_file.FRAME.size
    numbers_at = counts_at + plan_file.COUNTS.size
    counts = list(plan_file.COUNTS.unpack_from(content, counts_at))
    values = list(plan_file.NUMBERS.unpack_from(content, numbers_at))
    begin = plan.lines[:, 0]
    running = max(int(np.searchsorted(begin, start, side="right")) - 1, 0)
    lines = plan.lines[running:][plan.lines[running:, 0] < start + numbers[0]].copy()
    lines[:, 0] = np.maximum(lines[:, 0] - start, 0.0)
    counts[3:6] = curve.shape[0] - 1, law.shape[0] - 1, lines.shape[0]
    values[:3] = numbers
    if start > 0.0:
        values[-2] = plan.limits.feed  # it does not begin at rest
    dim = plan.table.dim
    limits_at = plan_file.HEADER_SIZE + plan_file.AXIS.size * dim
    arrays = (ends, curve, law, np.concatenate([lines, [[np.inf, 0.0]]]))
    body = b"".join(
        [
            plan_file.COUNTS.pack(*counts),
            plan_file.NUMBERS.pack(*values),
            content[numbers_at + plan_file.NUMBERS.size : limits_at + 24 * dim],
            *(np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays),
        ]
    )
    frame = plan_file.FRAME.pack(
        plan_file.MAGIC, plan_file.VERSION, plan_file.ORDER, counts_at + len(body), zlib.crc32(body), 0
    )
    return frame + body

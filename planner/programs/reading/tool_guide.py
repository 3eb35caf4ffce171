"""The tool beside one programmed path in its plane, move by move: see ``compensation`` for the rules.

A point of the plane is a complex number, and so is a tangent, of length 1; the normal on the tool's side is the tangent
times i or -i.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

from planner.programs.reading.program import ARC, LINE, ZERO_LENGTH_MM

_SMALL_TURN = 0.05  # rad
_TURN_TOLERANCE = 0.0254  # rad, by which an inside corner may make an arc longer
_SMALL_COSINE = 1e-6
_TINY_TURN = 1e-9  # of a full one


class GougeError(Exception):
    """The tool would cut into what it shall leave: the index of the move, and why."""

    def __init__(self, row: int, reason: str) -> None:
        super().__init__(reason)
        self.row, self.reason = row, reason


@dataclass(slots=True)
class ToolMove:
    """A move of the tool in the plane.

    Attributes
    ----------
    row : int
        Index of the programmed move that it belongs to.
    kind : int
        RAPID, LINE or ARC.
    end, centre : complex
        mm; the centre counts for an arc.
    turns : int
        Of an arc the full turns that it begins, < 0 clockwise.
    direction : complex
        Of the programmed line; 0 where the move cannot come to lead back.
    swept : float
        Angle of the programmed arc, rad; 0 where the move cannot come to be too long.
    level : bool
        False where the height stays that of the move before.
    sweep : float
        Of an arc the angle, as in Program.
    """

    row: int
    kind: int
    end: complex
    centre: complex = 0j
    turns: int = 0
    direction: complex = 0j
    swept: float = 0.0
    level: bool = True
    sweep: float = 0.0


class ToolGuide:
    """Leads a tool along moves from ``start``; ``radius`` in mm is > 0 for a tool to the left of the path."""

    def __init__(self, radius: float, start: complex) -> None:
        self.side = math.copysign(1.0, radius)
        self.left = 1j * self.side  # from a tangent to the normal on the tool's side
        self.radius = abs(radius)
        self.moves: list[ToolMove] = []
        self._entered = False
        self._programmed = self._tool = self._at = start  # the tool: where the last move would end, uncut
        self._begin: complex | None = None  # of the moves that wait; None where they cannot be too short
        self._waiting: list[ToolMove] = []

    def line(self, row: int, kind: int, end: complex) -> None:
        """Follow a line or a rapid."""
        step = end - self._programmed
        if not self._entered:
            self._enter_by_line(row, kind, end)
            return
        if abs(step) < ZERO_LENGTH_MM:
            self._waiting.append(ToolMove(row, kind, self._tool))
            return
        tangent = step / abs(step)
        beside = self._programmed + self.radius * self.left * tangent
        turn = self._turn(tangent)
        front = self._waiting[0]
        over_arc = turn > math.pi - _SMALL_TURN and front.kind == ARC and not self._is_inside(front.turns)
        if turn < -_SMALL_TURN or turn > math.pi + _SMALL_TURN or over_arc:
            self._cut(row, self._line_crossing(row, beside, tangent, turn))
        elif turn > _SMALL_TURN:
            self._cut(row, self._tool)
            self._round_corner(row, kind, beside)
        else:
            self._release()
        self._wait(ToolMove(row, kind, end + self.radius * self.left * tangent, direction=step), end)

    def arc(self, row: int, end: complex, centre: complex, sweep: float) -> None:
        """Follow an arc."""
        turns = int(math.copysign(max(math.ceil(abs(sweep) / math.tau - _TINY_TURN), 1), sweep))
        if not self._entered:
            self._enter_by_arc(row, end, centre, turns)
            return
        inside = self._is_inside(turns)
        radius = abs(end - centre)
        if inside and radius <= self.radius:
            raise GougeError(
                row, f"the tool of radius {self.radius:.6g} mm does not fit into the arc of {radius:.6g} mm"
            )
        inwards = 1.0 if inside else -1.0
        normal = inwards * (centre - self._programmed) / abs(centre - self._programmed)
        turn = self._turn(normal / self.left)
        reversal = abs(turn - math.pi) < _SMALL_TURN and not inside
        if turn < -_SMALL_TURN or turn > math.pi + _SMALL_TURN or reversal:
            self._cut(row, self._arc_crossing(row, centre, radius, turns))
        else:
            self._release()
            if turn > _SMALL_TURN:
                self._round_corner(row, LINE, self._programmed + self.radius * normal)
        out = end + inwards * self.radius * (centre - end) / radius
        self._wait(ToolMove(row, ARC, out, centre, turns, swept=abs(sweep)), end)

    def finish(self) -> list[ToolMove]:
        """Let the moves that wait end where they would; returns all."""
        if self._waiting:
            self._cut(self._waiting[-1].row, self._tool)
        return self.moves

    def _enter_by_line(self, row: int, kind: int, end: complex) -> None:
        step = end - self._programmed
        if abs(step) <= self.radius:
            raise GougeError(
                row,
                f"the first move beside which the tool goes has {abs(step):.6g} mm in the plane; it must be longer than "
                f"the radius of the tool, {self.radius:.6g} mm",
            )
        self._wait(ToolMove(row, kind, end + self.radius * self.left * step / abs(step)), end)

    def _enter_by_arc(self, row: int, end: complex, centre: complex, turns: int) -> None:
        """The arc from where the machine stands that ends beside the programmed one, in its direction."""
        start, inside = self._programmed, self._is_inside(turns)
        if abs(end - start) <= self.radius or (inside and abs(centre - start) <= self.radius):
            raise GougeError(
                row,
                "the first move beside which the tool goes is an arc; its radius, and the way to its end, must be larger "
                f"than the radius of the tool, {self.radius:.6g} mm",
            )
        axis = (centre - end) / abs(centre - end)
        out = end + (self.radius if inside else -self.radius) * axis
        axis = (centre - out) / abs(centre - out)
        cosine = ((start - out) / axis).real / abs(start - out)
        if (
            cosine < _SMALL_COSINE
        ):  # below 0 LinuxCNC takes an arc whose centre is on the other side, and that leads back
            raise GougeError(row, "no arc leads from here to the side of the programmed one; begin with a line")
        middle = out + 0.5 * abs(start - out) / cosine * axis
        self._wait(ToolMove(row, ARC, out, middle, turns), end)

    def _is_inside(self, turns: int) -> bool:
        """Whether the tool is inside of an arc with these turns."""
        return self.side * turns > 0.0

    def _turn(self, tangent: complex) -> float:
        """The angle by which the path turns away from the tool, in [-pi/2, 3 pi/2)."""
        before = (self._tool - self._programmed) / self.left
        turn = -self.side * cmath.phase(tangent / before)
        return turn + math.tau if turn < -0.5 * math.pi else turn

    def _line_crossing(self, row: int, beside: complex, tangent: complex, turn: float) -> complex:
        """Where the path that waits crosses that of a line, which goes through ``beside``."""
        front = self._waiting[0]
        if front.kind != ARC:
            before = (self._tool - self._programmed) / self.left / self.radius
            return self._tool - self.radius / math.tan(0.5 * (turn + math.pi)) * before
        along = ((front.centre - beside) / tangent).real
        half = _half_chord(row, abs(front.centre - front.end), ((front.centre - beside) / tangent).imag)
        return beside + (along - half if self._is_inside(front.turns) else along + half) * tangent

    def _arc_crossing(self, row: int, centre: complex, radius: float, turns: int) -> complex:
        """Where the path that waits crosses that of an arc."""
        front = self._waiting[0]
        inside = self._is_inside(turns)
        beside = radius - self.radius if inside else radius + self.radius
        if front.kind != ARC:
            normal = (self._tool - self._programmed) / self.radius
            towards = (centre - self._programmed) / abs(centre - self._programmed)
            # The radius at the end counts, as LinuxCNC has it; that at the start may differ by its digits.
            apart = radius * (towards / normal).real - self.radius
            half = _half_chord(row, beside, apart)
            return centre - apart * normal + (half if inside else -half) * normal / self.left
        between = centre - front.centre
        before = abs(front.centre - front.end)
        if before == 0.0 or between == 0j:
            raise GougeError(row, "an inside corner of two arcs with one centre")
        cosine = (before**2 + abs(between) ** 2 - beside**2) / (2.0 * before * abs(between))
        if abs(cosine) > 1.0:
            raise GougeError(row, "the tool does not fit into the inside corner with the arc before")
        ahead = 1.0 if self._is_inside(front.turns) == (turns > 0) else -1.0
        return front.centre + cmath.rect(before, cmath.phase(between) + ahead * math.acos(cosine))

    def _cut(self, row: int, end: complex) -> None:
        """Let the moves that wait end at a point, and release them."""
        for move in self._waiting:
            if self._begin is not None and move.kind == ARC:
                sweep = _swept(self._begin, end, move)
                if move.swept and abs(sweep) > move.swept + _TURN_TOLERANCE:
                    raise GougeError(row, "the inside corner cuts more from the arc before than there is of it")
            elif self._begin is not None and (move.direction.conjugate() * (end - self._begin)).real < 0.0:
                raise GougeError(row, "the inside corner cuts more from the line before than there is of it")
            move.end = end
        self._release()
        self._begin = end

    def _release(self) -> None:
        """Let the moves that wait go as they are."""
        for move in self._waiting:
            if move.kind == ARC:
                move.sweep = _swept(self._at, move.end, move)
            self._at = move.end
        self.moves += self._waiting
        self._waiting = []
        self._begin = self._tool

    def _round_corner(self, row: int, kind: int, end: complex) -> None:
        """The arc about an outside corner, of a rapid the line."""
        corner = ToolMove(row, kind, end, level=False)
        if kind == LINE:
            corner.kind, corner.centre, corner.turns = ARC, self._programmed, -int(self.side)
        self._waiting = [corner]
        self._release()
        self._begin = end

    def _wait(self, move: ToolMove, programmed: complex) -> None:
        self._waiting.append(move)
        self._tool, self._programmed, self._entered = move.end, programmed, True


def _half_chord(row: int, radius: float, apart: float) -> float:
    if abs(apart) > radius:
        raise GougeError(row, "the tool does not fit into the inside corner of arc and line")
    return math.sqrt(radius**2 - apart**2)


def _swept(start: complex, end: complex, arc: ToolMove) -> float:
    """The angle of an arc between two points, < 0 clockwise; of one point none, or where it is programmed so a full turn."""
    sense = math.copysign(1.0, arc.turns)
    whole = math.tau * (abs(arc.turns) - 1)
    if abs(end - start) < ZERO_LENGTH_MM:
        return sense * (whole + (math.tau if arc.swept - whole > math.pi else 0.0))
    angle = sense * cmath.phase((end - arc.centre) / (start - arc.centre))
    return sense * (whole + (angle if angle > 0.0 else angle + math.tau))

"""Polar coordinates, @ the radius and ^ the angle in degrees about the origin of the program, as words X and Y.

In absolute distances a word that is missing is that of where the tool stands; in relative ones both add to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from planner.programs.reading.expressions import LineError, ParameterKey

EvaluatedWord = tuple[str, float, int, int]  # letter, number, from where to where it stands


def without_polar(
    text: str, words: list[EvaluatedWord], machine: Callable[[ParameterKey], float | None]
) -> list[list[EvaluatedWord]]:
    """Blocks in which X and Y stand in place of @ and ^; of a repeated cycle in relative distances one for each hole.

    ``machine`` tells where the tool stands.
    """
    polar = {word[0]: word for word in words if word[0] in "@^"}
    if not polar:
        return [words]
    place = next(iter(polar.values()))[2:]
    said = text[place[0] : place[1]]
    codes = {value for letter, value, _, _ in words if letter == "G"}
    if not ((machine("_plane") == 170.0 and not codes & {18.0, 19.0}) or 17.0 in codes):
        raise LineError(said, "polar coordinates are in the plane G17, which is not in force")
    if any(word[0] in "XY" for word in words):
        raise LineError(said, "polar coordinates stand in place of X and Y, not beside them")
    if codes & {20.0, 21.0, 53.0}:
        raise LineError(said, "polar coordinates beside G20, G21 or G53; write that word in a block before")
    x, y = (float(machine(key) or 0.0) for key in (5420, 5421))
    relative = machine("_incremental") == 1.0 if not codes & {90.0, 91.0} else 91.0 in codes
    if math.hypot(x, y) == 0.0 and (relative or "^" not in polar):
        raise LineError(said, "at the origin no angle is known; give both @ and ^ in absolute distances")
    others = [word for word in words if word[0] not in "@^"]
    if not relative:
        radius = polar["@"][1] if "@" in polar else math.hypot(x, y)
        angle = math.radians(polar["^"][1]) if "^" in polar else math.atan2(y, x)
        return [[*others, ("X", radius * math.cos(angle), *place), ("Y", radius * math.sin(angle), *place)]]
    repeats = next((int(value) for letter, value, _, _ in words if letter == "L"), 1)
    others = [word for word in others if word[0] != "L"]
    blocks: list[list[EvaluatedWord]] = []
    for _ in range(max(repeats, 1)):
        radius = math.hypot(x, y) + (polar["@"][1] if "@" in polar else 0.0)
        angle = math.atan2(y, x) + (math.radians(polar["^"][1]) if "^" in polar else 0.0)
        before, x, y = (x, y), radius * math.cos(angle), radius * math.sin(angle)
        blocks.append([*others, ("X", x - before[0], *place), ("Y", y - before[1], *place)])
        others = []
    return blocks

"""Machine files in TOML: keys that name their units, one table an axis, and what programs count on.

A key is that of a quantity with its unit behind it.  The units below serve as well as mm, rad and s: ``feed_mm_min``,
``velocity_deg_s``, ``acceleration_m_s2``, ``period_ms``.
"""

from __future__ import annotations

import math
import re
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import shorten
from planner.machine.limits import DEFAULT_PERIOD, PERIOD, RAPID, SCALARS
from planner.machine.machine_table import AxisTable, MachineTable
from planner.machine.program_setup import SYSTEMS, ProgramSetup, RestTimes
from planner.quantity import AXIS, FEED, QUANTITIES

LENGTHS = {
    "mm": {"mm": 1.0, "m": 1000.0, "inch": 25.4},
    "rad": {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi},
}
"""Units of length in mm, and of angle in rad."""
_IN_PROGRAMS = LENGTHS["mm"] | {"deg": 1.0, "rad": 180.0 / math.pi, "rev": 360.0}
"""The same in the units of programs: mm and degrees."""
_MINUTE = 60.0  # s
_NAME, _AXIS, _PROGRAM = "name", "axis", "program"
_HOMES = ("home", "second_home", "tool_change")
_OFFSETS, _TOOLS = "offsets", "tools"
_RESTS = {"tool_change_s": "tool_change", "spindle_start_s": "spindle_start"}


def file_key(name: str) -> str:
    """Key in a machine file of what is one number, which names its unit: ``feed_mm_s``, ``period_s``."""
    keys = {q.key: q.file_key() for q in QUANTITIES} | {PERIOD: f"{PERIOD}_s", RAPID: f"{RAPID}_{FEED.suffix()}"}
    return keys[name]


def axis_keys(length: str) -> dict[str, float]:
    """Keys of an axis in mm or rad, all of them required."""
    return dict.fromkeys((_NAME, *(q.file_key(length) for q in AXIS)), math.nan)


HEAD_KEYS = {
    file_key(name): math.nan if name in {q.key for q in QUANTITIES if q.required} else math.inf
    for name in (FEED.key, RAPID, *SCALARS)
} | {file_key(PERIOD): DEFAULT_PERIOD}
"""Keys of the head of a machine file, each with its default; nan for what is required."""


def unit_keys(key: str) -> dict[str, float]:
    """Every key that says the same as one in mm, rad and s, with the factor to its unit: ``feed_mm_min`` has 1/60."""
    if key == file_key(PERIOD):
        return {key: 1.0, f"{PERIOD}_ms": 1e-3}
    found = re.fullmatch(r"(\w+?)_(mm|rad)(_s\d?)?", key)
    if found is None:
        return {key: 1.0}
    base, length, time = found[1], found[2], found[3] or ""
    keys = {f"{base}_{name}{time}": size for name, size in LENGTHS[length].items()}
    if time == "_s":
        keys |= {f"{base}_{name}_min": size / _MINUTE for name, size in LENGTHS[length].items()}
    return keys


PROGRAM_KEYS = (
    _TOOLS,
    *(f"{name}_{unit}" for name in (*_HOMES, _OFFSETS) for units in LENGTHS.values() for unit in units),
    *_RESTS,
)
"""Keys of the table ``program``."""


def toml_machine(text: str, where: str) -> MachineTable:
    """Read a machine file.

    Raises
    ------
    InputError
        Naming the file, the line where it is known, the key, its value and what is allowed.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        line = re.search(r"\(at line (\d+)", str(error))
        raise InputError(f"{where}{f':{line[1]}' if line else ''}: not a valid TOML file ({error})") from None
    page = _Page(where, _key_lines(text))
    axes = table.pop(_AXIS, [])
    setup = _program(table.pop(_PROGRAM, None), page)
    head = _checked(table, HEAD_KEYS, page, "")
    _require_all(HEAD_KEYS, head, page)
    if not isinstance(axes, list) or not axes or not all(isinstance(axis, dict) for axis in axes):
        raise InputError(
            f'{page.at("axis")}: one "[[axis]]" table for each axis is needed, with name, velocity, acceleration and jerk'
        )
    rows = [_axis_table(axis, i, page) for i, axis in enumerate(axes)]
    names = [row.name for row in rows]
    twice = [i for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise InputError(f'{page.at(f"axis[{twice[0]}].name")}: axis "{names[twice[0]]}" is given twice')
    return MachineTable(where, {name: head[file_key(name)] for name in SCALARS}, rows, setup)


@dataclass(frozen=True)
class _Page:
    """A file, and the lines of its keys."""

    where: str
    lines: Mapping[str, int]

    def at(self, key: str) -> str:
        """``file:line`` of a key, or the file where it is not known."""
        return f"{self.where}:{self.lines[key]}" if key in self.lines else self.where


def _key_lines(text: str) -> dict[str, int]:
    """Lines of keys written as ``key = value`` under ``[table]`` and ``[[axis]]``, as ``axis[1].name``."""
    lines: dict[str, int] = {}
    prefix, count = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        head = re.match(r"\s*(\[\[?)\s*([\w.]+)\s*\]", line)
        if head is not None:
            many = head[1] == "[["
            prefix = f"{head[2]}[{count}]." if many else f"{head[2]}."
            count += many
            lines.setdefault(prefix[:-1], number)
            continue
        key = re.match(r"\s*\"?([\w.-]+)\"?\s*=", line)
        if key is not None:
            lines.setdefault(prefix + key[1], number)
    return lines


def _axis_table(axis: dict[str, Any], i: int, page: _Page) -> AxisTable:
    name = axis.get(_NAME)
    known = isinstance(name, str) and name in AXES
    length = "rad" if known and name in ROTARY_AXES else "mm"
    place = f"axis[{i}]"
    label = f"{place} ({name})" if known else place
    found = _checked(axis, axis_keys(length), page, place, label)
    if _NAME not in found:
        keys = ", ".join(axis_keys(length))
        raise InputError(f'{page.at(place)}: "{label}.{_NAME}" is missing; the keys are {keys}')
    row = AxisTable(found[_NAME], {})
    for q in AXIS:
        key = q.file_key(length)
        if key in found:
            row.values[q.key] = found[key]
        else:
            row.lacking[q.key] = f'"{label}.{key}"'
    return row


def _checked(
    table: Mapping[str, Any], keys: Mapping[str, float], page: _Page, place: str, label: str = ""
) -> dict[str, Any]:
    """Values of a table of a machine file in mm, rad and s; ``keys`` are those it may have, each with its default."""
    own = {other: (key, factor) for key in keys for other, factor in unit_keys(key).items()}
    prefix, shown = f"{place}." if place else "", f"{label}." if label else ""
    found: dict[str, Any] = {}
    for written, value in table.items():
        at, said = page.at(prefix + written), shown + written
        # A misspelt key is both unknown and missing; the unknown one is what the person wrote.
        if written not in own:
            raise InputError(f'{at}: unknown key "{said}"; the keys are {", ".join(keys)}, or the like in other units')
        key, factor = own[written]
        if key in found:
            raise InputError(f'{at}: "{said}" says again what is given in another unit; leave one')
        if key == _NAME:
            if not isinstance(value, str) or value not in AXES:
                raise InputError(f"{at}: {said} = {shorten(repr(value))} must be one of {', '.join(AXES)}")
            found[key] = value
            continue
        if not _is_positive(value, finite=key == file_key(PERIOD)):
            allowed = "a finite number > 0" if key == file_key(PERIOD) else "a number > 0; use inf for no limit"
            raise InputError(f"{at}: {said} = {shorten(repr(value))} must be {allowed}")
        found[key] = factor * float(value)
    return found


def _require_all(keys: Mapping[str, float], found: dict[str, Any], page: _Page) -> None:
    """Put the defaults in, and ask for what has none."""
    for key, default in keys.items():
        if key not in found and math.isnan(default):
            raise InputError(f'{page.where}: "{key}" is missing; the keys are {", ".join(keys)}')
        found.setdefault(key, default)


def _is_positive(value: Any, *, finite: bool) -> bool:
    """Whether a value of a file is a number above zero: no text, no truth value, nothing that a double cannot hold."""
    if not _is_number(value) or not value > 0:
        return False
    return not (finite and math.isinf(value))


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return not isinstance(value, int) or abs(value) <= sys.float_info.max


def _program(table: Any, page: _Page) -> ProgramSetup:
    """What programs count on, out of the table ``program``."""
    if table is None:
        return ProgramSetup()
    if not isinstance(table, dict):
        raise InputError(f"{page.at(_PROGRAM)}: {_PROGRAM} must be a table, with the keys {', '.join(PROGRAM_KEYS)}")
    tools: Path | None = None
    points: dict[str, dict[str, float]] = {}
    offsets: dict[str, dict[str, float]] = {}
    rests: dict[str, float] = {}
    for key, value in table.items():
        at, said = page.at(f"{_PROGRAM}.{key}"), f"{_PROGRAM}.{key}"
        if key not in PROGRAM_KEYS:
            raise InputError(f'{at}: unknown key "{said}"; the keys are {", ".join(PROGRAM_KEYS)}')
        if key == _TOOLS:
            if not isinstance(value, str) or not value:
                raise InputError(f"{at}: {said} = {shorten(repr(value))} must be the name of a tool table, .tbl")
            tools = Path(page.where).parent / value
            continue
        if key in _RESTS:
            if not _is_number(value) or not 0.0 <= value < math.inf:
                raise InputError(f"{at}: {said} = {shorten(repr(value))} must be a finite number of at least 0, in s")
            rests[_RESTS[key]] = float(value)
            continue
        name, _, unit = key.rpartition("_")
        if name != _OFFSETS:
            points.setdefault(name, {}).update(_point(value, unit, at, said))
            continue
        if not isinstance(value, dict) or any(system not in SYSTEMS for system in value):
            raise InputError(f"{at}: {said} must be a table with a point for each of {', '.join(SYSTEMS)} that has one")
        for system, point in value.items():
            offsets.setdefault(system, {}).update(_point(point, unit, at, f"{said}.{system}"))
    homes: dict[str, Any] = {name: points.get(name) for name in _HOMES}
    return ProgramSetup(tools, **homes, offsets=offsets, rests=RestTimes(**rests))


def _point(value: Any, unit: str, at: str, said: str) -> dict[str, float]:
    """A point as ``{ X = 10, Z = 50 }`` in mm, or degrees for axes that turn."""
    length = next(length for length, units in LENGTHS.items() if unit in units)
    axes = [axis for axis in AXES if (axis in ROTARY_AXES) == (length == "rad")]
    if not isinstance(value, dict) or not value:
        raise InputError(f"{at}: {said} = {shorten(repr(value))} must be a table such as {{ {axes[0]} = 10 }}")
    for axis, number in value.items():
        if axis not in axes:
            raise InputError(f'{at}: {said} has "{shorten(axis)}"; in {unit} there may be {", ".join(axes)}')
        if not _is_number(number) or not math.isfinite(number):
            raise InputError(f"{at}: {said}.{axis} = {shorten(repr(number))} must be a finite number")
    return {axis: _IN_PROGRAMS[unit] * float(number) for axis, number in value.items()}

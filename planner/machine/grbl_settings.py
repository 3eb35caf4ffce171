"""Limits out of what a GRBL controller answers to ``$$``: GRBL 0.9 and 1.1, grblHAL.

======================  ======================================================================================
$110 to $117            velocity of X Y Z A B C U V, mm/min (A, B and C in deg/min); the rapids too
$120 to $127            acceleration, mm/s^2 (deg/s^2)
$800 to $807            jerk of a grblHAL built with it, mm/s^3 (deg/s^3); absent: no limit
$11                     junction deviation, mm: no limit here; ``notes`` say what stands for it
$12, $100 to $102       arc tolerance, mm, and steps a mm of X Y Z: as $11 for the model of the controller alone
======================  ======================================================================================

Values are in mm whatever $13 reports.  Text after a value is a remark.  What controllers and senders say beside the settings
(``ok``, a greeting, ``[...]``, ``<...>``, remarks) is passed over; any other line is noise, and what it has garbled is not
known: the dump is refused.  So is one that ends in the middle.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from planner.errors import InputError
from planner.geometry.curve import ROTARY_AXES
from planner.inputs import plain_number, shorten
from planner.machine.controller_words import ControllerWords
from planner.machine.limits import RAPID
from planner.machine.machine_table import AxisTable, MachineTable
from planner.machine.program_setup import ProgramSetup
from planner.quantity import ACCELERATION, FEED, JERK, VELOCITY

_LETTERS = "XYZABCUV"
_BASES = {VELOCITY: 110, ACCELERATION: 120, JERK: 800}
_PER_MINUTE = {VELOCITY: 1.0 / 60.0, ACCELERATION: 1.0, JERK: 1.0}
_DEVIATION, _ARC_TOLERANCE = 11, 12
_STEPS = (100, 101, 102)  # of X Y Z
_SETTING = re.compile(r"(?:\[?\$(\d{1,6})\s*=)\s*([^\s(;/\]]*)(.*)", re.ASCII)
_BESIDE = re.compile(r"(ok$|>|\$\$|\$[A-Za-z][\w/]*=|\$N\d+=|[Gg]rbl|\[.*\]$|<.*>$|[;#(]|//)", re.ASCII)
_AGAIN = "send $$ to the controller again"


@dataclass(frozen=True)
class _Setting:
    value: str
    place: str


def is_settings_dump(text: str) -> bool:
    """Whether a text holds a setting of such a controller."""
    return re.search(r"^\s*\[?\$\d+\s*=", text, re.MULTILINE | re.ASCII) is not None


def grbl_machine(text: str, where: str) -> MachineTable:
    """Read the limits out of a dump.

    Raises
    ------
    InputError
        ``file:line: setting = value`` and what is allowed; or what is missing.
    """
    settings = _settings(text, where)
    count = max(
        (k + 1 for k in range(len(_LETTERS)) if any(base + k in settings for base in _BASES.values())), default=0
    )
    if count == 0:
        raise InputError(f"{where}: $110 is missing, the velocity of X in mm/min; {_AGAIN}")
    axes = [_axis(letter, k, settings) for k, letter in enumerate(_LETTERS[:count])]
    notes: tuple[str, ...] = ()
    deviation = tolerance = None
    if _ARC_TOLERANCE in settings:
        tolerance = _positive(settings[_ARC_TOLERANCE], "arc tolerance, $12")
    if _DEVIATION in settings:
        deviation = _positive(settings[_DEVIATION], "junction deviation, $11", allow_zero=True)
        notes = (f"its junction deviation of {deviation:g} mm is no limit: the tolerance of the path stands for it",)
    steps = [_positive(settings[key], f"steps a mm, ${key}") for key in _STEPS if key in settings]
    words = ControllerWords(
        junction_deviation=deviation,
        arc_tolerance=tolerance,
        steps_per_mm=tuple(steps) if len(steps) == len(_STEPS) else None,
    )
    setup = ProgramSetup(controller=words)
    return MachineTable(where, {FEED.key: math.inf, RAPID: math.inf}, axes, setup, notes)


def _settings(text: str, where: str) -> dict[int, _Setting]:
    """The settings by their numbers."""
    settings: dict[int, _Setting] = {}
    last = ""
    lines = text.splitlines()
    for number, raw in enumerate(lines, 1):
        line, place = raw.strip(), f"{where}:{number}"
        if not line:
            continue
        last = line
        found = _SETTING.match(line)
        if found is None:
            if _BESIDE.match(line) is None:
                raise InputError(
                    f'{place}: {shorten(line)}: is neither a setting such as "$110=5000" nor what a controller says beside '
                    f"them; the dump is cut or garbled: {_AGAIN}"
                )
            continue
        key, setting = int(found[1]), _Setting(found[2], place)
        _require_one(line[found.start(2) :], place, line)
        if key in settings and settings[key].value != setting.value:
            first = settings[key].place.rpartition(":")[2]
            raise InputError(f"{place}: ${key}: is given twice, first in line {first}; leave one")
        settings[key] = setting
    if settings and not text.endswith("\n") and _SETTING.match(last) and _is_needed(last):
        raise InputError(
            f"{where}:{len(lines)}: {shorten(last)}: the dump ends in this line, which may be cut; {_AGAIN}, or end the line"
        )
    return settings


def _require_one(rest: str, place: str, line: str) -> None:
    """Refuse a second setting in a line: where the end of a line is lost, more may be."""
    if re.search(r"\$\d+\s*=", rest, re.ASCII):
        raise InputError(f"{place}: {shorten(line)}: has more than one setting; each needs a line of its own: {_AGAIN}")


def _is_needed(line: str) -> bool:
    """Whether a line is of a setting that is read."""
    found = _SETTING.match(line)
    return found is not None and any(0 <= int(found[1]) - base < len(_LETTERS) for base in _BASES.values())


def _axis(letter: str, k: int, settings: dict[int, _Setting]) -> AxisTable:
    unit = math.pi / 180.0 if letter in ROTARY_AXES else 1.0
    axis = AxisTable(letter, {})
    for quantity, base in _BASES.items():
        setting = settings.get(base + k)
        if setting is not None:
            value = _positive(setting, f"{quantity.label} of {letter}, ${base + k}")
            axis.values[quantity.key] = unit * _PER_MINUTE[quantity] * value
        elif quantity is JERK:
            axis.values[quantity.key] = math.inf
        else:
            axis.lacking[quantity.key] = f"${base + k}"
    return axis


def _positive(setting: _Setting, what: str, *, allow_zero: bool = False) -> float:
    number = plain_number(setting.value)
    if number is None or not 0.0 <= number < math.inf or (number == 0.0 and not allow_zero):
        least = ">= 0" if allow_zero else "> 0"
        raise InputError(f"{setting.place}: {what} = {shorten(setting.value) or 'nothing'} must be a number {least}")
    return number

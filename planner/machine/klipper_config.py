"""Limits out of the section [printer] of a Klipper configuration, and what its own planner goes by.

======================  ======================================================================================
max_velocity            feed of all moves, rapids too, and velocity of X and Y, mm/s
max_accel               tangential acceleration, and acceleration of X and Y, mm/s^2
max_z_velocity          velocity of Z; max_velocity if left out
max_z_accel             acceleration of Z; max_accel if left out
square_corner_velocity  no limit here: ``notes`` say what stands for it
minimum_cruise_ratio    as square_corner_velocity for the model of the controller alone
[gcode_arcs]
resolution              the same: length of the chords of arcs, mm
======================  ======================================================================================

Klipper limits acceleration along the path and, in corners, the change of the velocity; here max_accel holds for each axis
too, so that curves keep it across the path.  It knows no jerk limit.  Of a key that is given twice the last counts, and
[include FILE] puts the lines of a file in its place: both as Klipper has it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from planner.errors import InputError
from planner.inputs import plain_number, shorten
from planner.machine.controller_words import ControllerWords
from planner.machine.included_lines import IncludedLines
from planner.machine.limits import RAPID
from planner.machine.machine_table import AxisTable, MachineTable
from planner.machine.program_setup import ProgramSetup
from planner.quantity import ACCELERATION, FEED, JERK, TANGENTIAL_ACCELERATION, VELOCITY

_INCLUDE = re.compile(r"\[include\s+([^\]]*)\]")
_SECTION = re.compile(r"\[([^\]]*)\]")
_OPTION = re.compile(r"([^:=\s][^:=]*?)\s*[:=]\s*(.*)")
_PRINTER, _ARCS = "printer", "gcode_arcs"
_SQUARE_CORNER, _CRUISE, _RESOLUTION = "square_corner_velocity", "minimum_cruise_ratio", "resolution"
_KEYS = ("max_velocity", "max_accel", "max_z_velocity", "max_z_accel", _SQUARE_CORNER, _CRUISE)
_FROM_ZERO = (_SQUARE_CORNER, _CRUISE)

Options = dict[str, tuple[str, str]]  # key: value and place


def is_printer_config(text: str) -> bool:
    """Whether a text is a configuration of Klipper: it has its section [printer], or includes files."""
    return re.search(r"^\[(printer\]|include\s)", text, re.MULTILINE) is not None


def klipper_machine(text: str, path: Path) -> MachineTable:
    """Read the limits out of the text of a configuration.

    Raises
    ------
    InputError
        ``file:line: [printer] key: value`` and what is allowed; or what is missing.
    """
    sections = _options(text, path)
    options = sections[_PRINTER]
    found = {key: _positive(key, *options[key]) for key in _KEYS if key in options}
    if found.get(_CRUISE, 0.0) >= 1.0:
        value, place = options[_CRUISE]
        raise InputError(f"{place}: [printer] {_CRUISE} = {shorten(value)} must be < 1")
    arcs = sections.get(_ARCS, {})
    words = ControllerWords(
        square_corner_velocity=found.get(_SQUARE_CORNER),
        minimum_cruise_ratio=found.get(_CRUISE),
        arc_resolution=_positive(_RESOLUTION, *arcs[_RESOLUTION], section=_ARCS) if _RESOLUTION in arcs else None,
    )
    x, y, z = (AxisTable(letter, {JERK.key: math.inf}) for letter in "XYZ")
    for quantity, key, slow in (
        (VELOCITY, "max_velocity", "max_z_velocity"),
        (ACCELERATION, "max_accel", "max_z_accel"),
    ):
        for axis, name in ((x, key), (y, key), (z, slow if slow in found else key)):
            if name in found:
                axis.values[quantity.key] = found[name]
            else:
                axis.lacking[quantity.key] = f"[printer] {key}"
        if key in found and found.get(slow, 0.0) > found[key]:
            value, place = options[slow]
            raise InputError(
                f"{place}: [printer] {slow} = {shorten(value)} must be at most {key}, which is {found[key]:g}"
            )
    feed = found.get("max_velocity", math.inf)
    head = {FEED.key: feed, RAPID: feed, TANGENTIAL_ACCELERATION.key: found.get("max_accel", math.inf)}
    notes: tuple[str, ...] = ()
    if _SQUARE_CORNER in found:
        speed = found[_SQUARE_CORNER]
        notes = (f"its square_corner_velocity of {speed:g} mm/s is no limit: the tolerance of the path stands for it",)
    return MachineTable(str(path), head, [x, y, z], ProgramSetup(controller=words), notes)


def _options(text: str, path: Path) -> dict[str, Options]:
    """The options of the sections [printer] and [gcode_arcs], the last of each."""
    sections: dict[str, Options] = {}
    section = ""
    for source in IncludedLines(_INCLUDE, patterns=True).of(text, path):
        line = re.split(r"#|(?:^|\s);", source.text)[0].rstrip()
        if not line or line[0].isspace():  # a line that continues the one before: of macros
            continue
        head = _SECTION.match(line)
        if head is not None:
            section = head[1].strip()
            if section in {_PRINTER, _ARCS}:
                sections.setdefault(section, {})
        elif section in sections:
            option = _OPTION.match(line)
            if option is None:
                raise InputError(
                    f'{source.place}: {shorten(line)}: is no option of [{section}], such as "max_velocity: 300"'
                )
            sections[section][option[1].lower()] = option[2].strip(), source.place
        elif line[0] == "[":
            raise InputError(f'{source.place}: {shorten(line)}: a section must have its name in "[ ]"')
    if _PRINTER not in sections:
        raise InputError(f"{path}: [printer] is missing, the section with max_velocity and max_accel")
    return sections


def _positive(key: str, value: str, place: str, section: str = _PRINTER) -> float:
    number = plain_number(value)
    least_is_zero = key in _FROM_ZERO
    if number is None or not 0.0 <= number < math.inf or (number == 0.0 and not least_is_zero):
        raise InputError(
            f"{place}: [{section}] {key} = {shorten(value)} must be a number {'>=' if least_is_zero else '>'} 0"
        )
    return number

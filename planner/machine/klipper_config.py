"""Limits out of the section [printer] of a Klipper configuration.

======================  ======================================================================================
max_velocity            feed of all moves, rapids too, and velocity of X and Y, mm/s
max_accel               tangential acceleration, and acceleration of X and Y, mm/s^2
max_z_velocity          velocity of Z; max_velocity if left out
max_z_accel             acceleration of Z; max_accel if left out
square_corner_velocity  no limit here: ``notes`` say what stands for it
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
from planner.machine.included_lines import IncludedLines
from planner.machine.limits import RAPID
from planner.machine.machine_table import AxisTable, MachineTable
from planner.quantity import ACCELERATION, FEED, JERK, TANGENTIAL_ACCELERATION, VELOCITY

_INCLUDE = re.compile(r"\[include\s+([^\]]*)\]")
_SECTION = re.compile(r"\[([^\]]*)\]")
_OPTION = re.compile(r"([^:=\s][^:=]*?)\s*[:=]\s*(.*)")
_PRINTER = "printer"
_KEYS = ("max_velocity", "max_accel", "max_z_velocity", "max_z_accel", "square_corner_velocity")

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
    options = _printer_options(text, path)
    found = {key: _positive(key, *options[key]) for key in _KEYS if key in options}
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
    if "square_corner_velocity" in found:
        speed = found["square_corner_velocity"]
        notes = (f"its square_corner_velocity of {speed:g} mm/s is no limit: the tolerance of the path stands for it",)
    return MachineTable(str(path), head, [x, y, z], notes=notes)


def _printer_options(text: str, path: Path) -> Options:
    """The options of the section [printer], the last of each."""
    options: Options = {}
    section, seen = "", False
    for source in IncludedLines(_INCLUDE, patterns=True).of(text, path):
        line = re.split(r"#|(?:^|\s);", source.text)[0].rstrip()
        if not line or line[0].isspace():  # a line that continues the one before: of macros
            continue
        head = _SECTION.match(line)
        if head is not None:
            section = head[1].strip()
            seen = seen or section == _PRINTER
        elif section == _PRINTER:
            option = _OPTION.match(line)
            if option is None:
                raise InputError(
                    f'{source.place}: {shorten(line)}: is no option of [printer], such as "max_velocity: 300"'
                )
            options[option[1].lower()] = option[2].strip(), source.place
        elif line[0] == "[":
            raise InputError(f'{source.place}: {shorten(line)}: a section must have its name in "[ ]"')
    if not seen:
        raise InputError(f"{path}: [printer] is missing, the section with max_velocity and max_accel")
    return options


def _positive(key: str, value: str, place: str) -> float:
    number = plain_number(value)
    least_is_zero = key == "square_corner_velocity"
    if number is None or not 0.0 <= number < math.inf or (number == 0.0 and not least_is_zero):
        raise InputError(
            f"{place}: [printer] {key} = {shorten(value)} must be a number {'>=' if least_is_zero else '>'} 0"
        )
    return number

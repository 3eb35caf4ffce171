"""Limits out of a LinuxCNC INI file.

What is taken (LinuxCNC, Getting Started, chapter "INI Configuration"):

===========================================  ==================================================================
[TRAJ] COORDINATES                           the axes; a letter twice is one axis moved by two joints
[TRAJ] LINEAR_UNITS, ANGULAR_UNITS           mm or inch; degree, radian or grad; or how many of them are a mm, a degree
[TRAJ] MAX_LINEAR_VELOCITY, -ACCELERATION,   feed of all moves, rapids too, tangential acceleration and jerk (before
-JERK                                        version 2.8 the names had no LINEAR); absent: no limit
[AXIS_X] and [JOINT_n] MAX_VELOCITY,         limits of an axis: the lowest of its own and those of its joints.  Without
MAX_ACCELERATION, MAX_JERK                   MAX_JERK, which LinuxCNC knows from 2.10 on, the jerk has no limit.  Before
                                             version 2.8 axes had numbers: [AXIS_0] is X
[EMCMOT] SERVO_PERIOD                        period, in ns
[TRAJ] ARC_BLEND_..., [DISPLAY]              for the model of LinuxCNC's own planner; no limits
MAX_FEED_OVERRIDE
#INCLUDE file                                the lines of the file, from the folder of the one it stands in
===========================================  ==================================================================

Joints count where the kinematics is trivkins, so that each moves one axis.  The controller's own defaults for a missing
velocity or acceleration are placeholders, so both are required.  Of a key that is given twice with the same value the
second counts for nothing; with another value it is refused (LinuxCNC takes the first).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import plain_number, shorten
from planner.machine.controller_words import ControllerWords
from planner.machine.included_lines import IncludedLines
from planner.machine.limits import PERIOD, RAPID
from planner.machine.machine_table import AxisTable, MachineTable
from planner.machine.program_setup import ProgramSetup
from planner.quantity import ACCELERATION, FEED, JERK, TANGENTIAL_ACCELERATION, TANGENTIAL_JERK, VELOCITY

_LINEAR_UNITS = {"mm": 1.0, "metric": 1.0, "in": 25.4, "inch": 25.4, "imperial": 25.4}
_ANGULAR_UNITS = {
    **dict.fromkeys(("deg", "degree"), math.pi / 180.0),
    **dict.fromkeys(("grad", "gon"), math.pi / 200.0),
    **dict.fromkeys(("rad", "radian"), 1.0),
}
_TRAJECTORY = {
    FEED.key: ("MAX_LINEAR_VELOCITY", "MAX_VELOCITY"),
    TANGENTIAL_ACCELERATION.key: ("MAX_LINEAR_ACCELERATION", "MAX_ACCELERATION"),
    TANGENTIAL_JERK.key: ("MAX_LINEAR_JERK",),
}
_AXIS = {VELOCITY: "MAX_VELOCITY", ACCELERATION: "MAX_ACCELERATION", JERK: "MAX_JERK"}
_PLANNER = {
    "max_feed_override": ("DISPLAY", "MAX_FEED_OVERRIDE"),
    "arc_blend": ("TRAJ", "ARC_BLEND_ENABLE"),
    "optimization_depth": ("TRAJ", "ARC_BLEND_OPTIMIZATION_DEPTH"),
    "gap_cycles": ("TRAJ", "ARC_BLEND_GAP_CYCLES"),
    "ramp_frequency": ("TRAJ", "ARC_BLEND_RAMP_FREQ"),
    "kink_ratio": ("TRAJ", "ARC_BLEND_KINK_RATIO"),
}
_MAY_BE_ZERO = ("arc_blend", "optimization_depth", "gap_cycles")
_READ_SECTIONS = r"TRAJ|KINS|EMCMOT|AXIS_\w|JOINT_\d+"
_READ_KEYS = r"MAX_(LINEAR_)?(VELOCITY|ACCELERATION|JERK)|COORDINATES|(LINEAR|ANGULAR)_UNITS|SERVO_PERIOD|KINEMATICS"
_INCLUDE = re.compile(r"\s*#INCLUDE\b(.*)$")

Sections = dict[str, dict[str, tuple[str, str]]]  # section, key: value and place


def ini_machine(text: str, path: Path) -> MachineTable:
    """Read the limits out of the text of an INI file.

    Parameters
    ----------
    text : str
    path : Path
        Of the file, for messages and for what it includes.

    Raises
    ------
    InputError
        ``file:line: [SECTION]KEY = value`` and what is allowed; or what is missing.
    """
    sections = _sections(text, path)
    where = str(path)
    trajectory = sections.get("TRAJ", {})
    linear = _unit(trajectory, "LINEAR_UNITS", "mm", _LINEAR_UNITS)
    angular = _unit(trajectory, "ANGULAR_UNITS", "degree", _ANGULAR_UNITS)
    head: dict[str, float] = {FEED.key: math.inf}
    for name, keys in _TRAJECTORY.items():
        key = next((key for key in keys if key in trajectory), None)
        if key is not None:
            head[name] = linear * _positive(trajectory[key], f"[TRAJ]{key}")
    head[RAPID] = head[FEED.key]
    period = sections.get("EMCMOT", {}).get("SERVO_PERIOD")
    if period is not None:
        head[PERIOD] = 1e-9 * _positive(period, "[EMCMOT]SERVO_PERIOD")
    joints = _joints(sections)
    axes = [
        _axis(sections, letter, joints, angular if letter in ROTARY_AXES else linear)
        for letter in _letters(trajectory, where)
    ]
    return MachineTable(where, head, axes, ProgramSetup(controller=_words(sections)))


def _words(sections: Sections) -> ControllerWords:
    """What the planner of LinuxCNC goes by beside the limits."""
    found: dict[str, Any] = {}
    for name, (section, key) in _PLANNER.items():
        if key not in sections.get(section, {}):
            continue
        value, place = sections[section][key]
        number = plain_number(value)
        if number is None or number < 0.0 or (number == 0.0 and name not in _MAY_BE_ZERO):
            least = ">= 0" if name in _MAY_BE_ZERO else "> 0"
            raise InputError(f"{place}: [{section}]{key} = {shorten(value)} must be a number {least}")
        found[name] = number
    return ControllerWords(**found)


def _sections(text: str, path: Path) -> Sections:
    sections: Sections = {}
    current: dict[str, tuple[str, str]] = {}
    section = ""
    continued = False
    for source in IncludedLines(_INCLUDE).of(text, path):
        line, place = source.text.strip(), source.place
        inside, continued = continued, line.endswith("\\")
        if inside or not line or line[0] in "#;":
            continue
        if line[0] == "[":
            head = re.match(r"\[\s*(\w+)\s*\]", line)
            if head is None:
                raise InputError(f'{place}: {shorten(line)}: a section must have its name in "[ ]"')
            section = head[1]
            current = sections.setdefault(section, {})
            continue
        key, equals, value = (part.strip() for part in line.partition("="))
        ours = re.fullmatch(_READ_SECTIONS, section) is not None
        if not equals and (ours or not section):
            raise InputError(f'{place}: {shorten(line)}: neither "[SECTION]" nor "KEY = value" within one')
        value = re.split(r"\s[#;]", value)[0].strip()
        if key in current and ours and re.fullmatch(_READ_KEYS, key) and value != current[key][0]:
            raise InputError(
                f"{place}: [{section}]{key}: is given twice, first in line {_line(current[key][1], place)}; leave one"
            )
        current.setdefault(key, (value, place))
    return sections


def _line(first: str, place: str) -> str:
    """The number of a line, with its file where that is another one than that of the place."""
    file, _, number = first.rpartition(":")
    return number if file == place.rpartition(":")[0] else f"{number} of {file}"


def _letters(trajectory: Mapping[str, tuple[str, str]], where: str) -> list[str]:
    if "COORDINATES" not in trajectory:
        raise InputError(f"{where}: [TRAJ]COORDINATES is missing; it names the axes, for example X Y Z")
    value, place = trajectory["COORDINATES"]
    letters = list(dict.fromkeys("".join(value.upper().split())))
    if not letters or any(letter not in AXES for letter in letters):
        raise InputError(f"{place}: [TRAJ]COORDINATES = {shorten(value)} must be letters out of {' '.join(AXES)}")
    return letters


def _joints(sections: Sections) -> dict[str, list[int]]:
    """Joints that move each axis; none unless the kinematics is that of Cartesian machines."""
    kinematics = sections.get("KINS", {}).get("KINEMATICS", ("trivkins", ""))[0].split()
    if not kinematics or kinematics[0] != "trivkins":
        return {}
    given = [word.partition("=")[2] for word in kinematics if word.lower().startswith("coordinates=")]
    value = given[0] if given else sections.get("TRAJ", {}).get("COORDINATES", ("", ""))[0]
    joints: dict[str, list[int]] = {}
    for number, letter in enumerate("".join(value.upper().split())):
        joints.setdefault(letter, []).append(number)
    return joints


def _axis(sections: Sections, letter: str, joints: dict[str, list[int]], unit: float) -> AxisTable:
    """Limits of one axis."""
    numbered = f"AXIS_{AXES.index(letter)}"  # before version 2.8
    names = [f"AXIS_{letter}", *(f"JOINT_{number}" for number in joints.get(letter, []))]
    names += [numbered] if numbered in sections else []
    axis = AxisTable(letter, {})
    for quantity, key in _AXIS.items():
        given = [_positive(sections[name][key], f"[{name}]{key}") for name in names if key in sections.get(name, {})]
        if given or quantity is JERK:
            axis.values[quantity.key] = unit * min(given, default=math.inf)
        else:
            axis.lacking[quantity.key] = " or ".join(f"[{name}]{key}" for name in names)
    return axis


def _unit(trajectory: Mapping[str, tuple[str, str]], key: str, default: str, units: Mapping[str, float]) -> float:
    """Size of a unit in mm or rad: of a word, or of a number, which says how many are a mm or a degree."""
    value, place = trajectory.get(key, (default, ""))
    if value.lower() in units:
        return units[value.lower()]
    number = plain_number(value)
    if number is None or not 0.0 < number < math.inf:
        one = "mm" if "mm" in units else "degree"
        raise InputError(
            f"{place}: [TRAJ]{key} = {shorten(value)} must be one of {', '.join(units)}, or how many are a {one}"
        )
    return units["mm" if "mm" in units else "degree"] / number


def _positive(entry: tuple[str, str], what: str) -> float:
    value, place = entry
    number = plain_number(value)
    if number is None or not 0.0 < number < math.inf:
        raise InputError(f"{place}: {what} = {shorten(value)} must be a number > 0; leave the line out for no limit")
    return number

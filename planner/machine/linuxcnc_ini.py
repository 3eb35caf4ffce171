"""Machine limits out of a LinuxCNC INI file, as the table that a machine TOML file would hold.

What is taken (LinuxCNC, Getting Started, chapter "INI Configuration"):

===========================================  ==================================================================
[TRAJ] COORDINATES                           the axes; a letter twice is one axis moved by two joints
[TRAJ] LINEAR_UNITS, ANGULAR_UNITS           mm or inch; degree, radian or grad
[TRAJ] MAX_LINEAR_VELOCITY, -ACCELERATION,   feed of all moves, rapids too, tangential acceleration and jerk (before
-JERK                                        version 2.8 the names had no LINEAR); absent: no limit
[AXIS_X] and [JOINT_n] MAX_VELOCITY,         limits of an axis: the lowest of its own and those of its joints.  Without
MAX_ACCELERATION, MAX_JERK                   MAX_JERK, which LinuxCNC knows from 2.10 on, the jerk has no limit
[EMCMOT] SERVO_PERIOD                        period, in ns
===========================================  ==================================================================

Joints count where the kinematics is trivkins, so that each moves one axis.  The controller's own defaults for a missing
velocity or acceleration are placeholders, so both are required.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import plain_number, shorten
from planner.quantity import ACCELERATION, FEED, JERK, TANGENTIAL_ACCELERATION, TANGENTIAL_JERK, VELOCITY

_LINEAR_UNITS = {"mm": 1.0, "metric": 1.0, "in": 25.4, "inch": 25.4, "imperial": 25.4}
_ANGULAR_UNITS = {
    **dict.fromkeys(("deg", "degree"), math.pi / 180.0),
    **dict.fromkeys(("grad", "gon"), math.pi / 200.0),
    **dict.fromkeys(("rad", "radian"), 1.0),
}
_TRAJECTORY = {
    FEED.file_key(): ("MAX_LINEAR_VELOCITY", "MAX_VELOCITY"),
    TANGENTIAL_ACCELERATION.file_key(): ("MAX_LINEAR_ACCELERATION", "MAX_ACCELERATION"),
    TANGENTIAL_JERK.file_key(): ("MAX_LINEAR_JERK",),
}
_AXIS = {VELOCITY: "MAX_VELOCITY", ACCELERATION: "MAX_ACCELERATION", JERK: "MAX_JERK"}
_READ_SECTIONS = r"TRAJ|KINS|EMCMOT|AXIS_\w|JOINT_\d+"
_READ_KEYS = r"MAX_(LINEAR_)?(VELOCITY|ACCELERATION|JERK)|COORDINATES|(LINEAR|ANGULAR)_UNITS|SERVO_PERIOD|KINEMATICS"

Sections = dict[str, dict[str, tuple[str, int]]]  # section, key: value and line


def machine_table(text: str, where: str) -> dict[str, Any]:
    """Read the limits out of the text of an INI file.

    Parameters
    ----------
    text : str
    where : str
        Name of the file, for messages.

    Returns
    -------
    dict
        Keys as in a machine TOML file; units mm, rad and s.

    Raises
    ------
    InputError
        ``file:line: [SECTION]KEY = value`` and what is allowed; or what is missing.
    """
    sections = _sections(text, where)
    trajectory = sections.get("TRAJ", {})
    linear = _unit(trajectory, "LINEAR_UNITS", "mm", _LINEAR_UNITS, where)
    angular = _unit(trajectory, "ANGULAR_UNITS", "degree", _ANGULAR_UNITS, where)
    table: dict[str, Any] = {"feed_mm_s": math.inf}
    for name, keys in _TRAJECTORY.items():
        key = next((key for key in keys if key in trajectory), None)
        if key is not None:
            table[name] = linear * _positive(trajectory[key], f"[TRAJ]{key}", where)
    table["rapid_mm_s"] = table["feed_mm_s"]
    period = sections.get("EMCMOT", {}).get("SERVO_PERIOD")
    if period is not None:
        table["period_s"] = 1e-9 * _positive(period, "[EMCMOT]SERVO_PERIOD", where)
    joints = _joints(sections)
    table["axis"] = [
        _axis(sections, letter, joints, angular if letter in ROTARY_AXES else linear, where)
        for letter in _letters(trajectory, where)
    ]
    return table


def _sections(text: str, where: str) -> Sections:
    sections: Sections = {}
    current: dict[str, tuple[str, int]] = {}
    section = ""
    continued = False
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        inside, continued = continued, line.endswith("\\")
        if inside or not line or line[0] in "#;":
            continue
        if line[0] == "[":
            head = re.match(r"\[\s*(\w+)\s*\]", line)
            if head is None:
                raise InputError(f'{where}:{number}: {shorten(line)}: a section must have its name in "[ ]"')
            section = head[1]
            current = sections.setdefault(section, {})
            continue
        key, equals, value = (part.strip() for part in line.partition("="))
        ours = re.fullmatch(_READ_SECTIONS, section) is not None
        if not equals and (ours or not section):
            raise InputError(f'{where}:{number}: {shorten(line)}: neither "[SECTION]" nor "KEY = value" within one')
        if key in current and ours and re.fullmatch(_READ_KEYS, key):
            raise InputError(
                f"{where}:{number}: [{section}]{key}: is given twice, first in line {current[key][1]}; leave one"
            )
        current.setdefault(key, (re.split(r"\s[#;]", value)[0].strip(), number))
    return sections


def _letters(trajectory: Mapping[str, tuple[str, int]], where: str) -> list[str]:
    if "COORDINATES" not in trajectory:
        raise InputError(
            f"{where}: [TRAJ]COORDINATES is missing; it names the axes, for example X Y Z (#INCLUDE is not followed)"
        )
    value, line = trajectory["COORDINATES"]
    letters = list(dict.fromkeys("".join(value.upper().split())))
    if not letters or any(letter not in AXES for letter in letters):
        raise InputError(
            f"{where}:{line}: [TRAJ]COORDINATES = {shorten(value)} must be letters out of {' '.join(AXES)}"
        )
    return letters


def _joints(sections: Sections) -> dict[str, list[int]]:
    """Joints that move each axis; none unless the kinematics is that of Cartesian machines."""
    kinematics = sections.get("KINS", {}).get("KINEMATICS", ("trivkins", 0))[0].split()
    if not kinematics or kinematics[0] != "trivkins":
        return {}
    given = [word.partition("=")[2] for word in kinematics if word.lower().startswith("coordinates=")]
    value = given[0] if given else sections.get("TRAJ", {}).get("COORDINATES", ("", 0))[0]
    joints: dict[str, list[int]] = {}
    for number, letter in enumerate("".join(value.upper().split())):
        joints.setdefault(letter, []).append(number)
    return joints


def _axis(sections: Sections, letter: str, joints: dict[str, list[int]], unit: float, where: str) -> dict[str, Any]:
    """One axis as in a machine TOML file."""
    names = [f"AXIS_{letter}", *(f"JOINT_{number}" for number in joints.get(letter, []))]
    suffix = "rad" if letter in ROTARY_AXES else "mm"
    row: dict[str, Any] = {"name": letter}
    for quantity, key in _AXIS.items():
        given = [
            _positive(sections[name][key], f"[{name}]{key}", where) for name in names if key in sections.get(name, {})
        ]
        if not given and quantity is not JERK:
            places = " or ".join(f"[{name}]{key}" for name in names)
            raise InputError(f"{where}: {places} is missing; axis {letter} needs it (#INCLUDE is not followed)")
        row[quantity.file_key(suffix)] = unit * min(given, default=math.inf)
    return row


def _unit(
    trajectory: Mapping[str, tuple[str, int]], key: str, default: str, units: Mapping[str, float], where: str
) -> float:
    value, line = trajectory.get(key, (default, 0))
    if value.lower() not in units:
        raise InputError(f"{where}:{line}: [TRAJ]{key} = {shorten(value)} must be one of {', '.join(units)}")
    return units[value.lower()]


def _positive(entry: tuple[str, int], what: str, where: str) -> float:
    value, line = entry
    number = plain_number(value)
    if number is None or not 0.0 < number < math.inf:
        raise InputError(
            f"{where}:{line}: {what} = {shorten(value)} must be a number > 0; leave the line out for no limit"
        )
    return number

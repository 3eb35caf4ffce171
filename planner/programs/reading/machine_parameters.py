"""Parameters that tell where the machine stands and what is in force, as LinuxCNC numbers and names them; read only."""

from __future__ import annotations

import re
from math import isnan

from planner.geometry.curve import AXES, ROTARY_AXES
from planner.programs.reading.expressions import ParameterKey
from planner.programs.reading.language import DISTANCE, FEED_MODE, MOTION, PLANE, UNITS
from planner.programs.reading.modal import INCH_MM, ReadingState
from planner.programs.reading.offsets import SYSTEM_CODES, origin

_NAMES = (
    *(f"_{axis.lower()}" for axis in AXES),
    *("_metric", "_imperial", "_absolute", "_incremental", "_inverse_time", "_coord_system", "_current_tool"),
    *("_selected_tool", "_plane", "_motion_mode", "_feed", "_rpm"),
)
# A line that asks for one of them, for a number that is computed, for where the tool stands, or for what is in force.
ASKS = re.compile(rf"#(?:5[1-4]\d\d|50[67]\d|\[|#|<(?:{'|'.join(_NAMES)})>)|[@^]|M7[0-3](?!\d)", re.IGNORECASE)
_SYSTEM_STEP = 20
PROBE_PARAMETERS = range(5061, 5071)  # where the last probe ended, and in the last whether it was seen
_TRIPPED = PROBE_PARAMETERS[-1]


def machine_parameter(key: ParameterKey, state: ReadingState) -> float | None:
    """The value of a parameter of the machine, in the units in force; None for any other."""
    unit = INCH_MM if state.modal[UNITS] == 200 else 1.0
    units = [1.0 if axis in ROTARY_AXES else unit for axis in AXES]
    offsets = state.offsets
    position = state.programmed - offsets.total
    if isinstance(key, str):
        named = {
            **{f"_{name.lower()}": float(position[axis]) / units[axis] for axis, name in enumerate(AXES)},
            "_metric": float(unit == 1.0),
            "_imperial": float(unit != 1.0),
            "_absolute": float(state.modal[DISTANCE] == 900),
            "_incremental": float(state.modal[DISTANCE] == 910),
            "_inverse_time": float(state.modal[FEED_MODE] == 930),
            "_coord_system": float(SYSTEM_CODES[offsets.active]),
            "_current_tool": float(state.loaded),
            "_selected_tool": float(state.selected),
            "_plane": float(state.modal[PLANE]),
            "_motion_mode": float(state.modal[MOTION]),
            "_feed": state.feed * 60.0 / unit,
            "_rpm": 0.0 if isnan(state.spindle) else state.spindle,
        }
        value = named.get(key)
        return None if value is None or isnan(value) else value
    if key == _TRIPPED:
        return None if state.probed is None else 0.0  # no probe was seen, as where LinuxCNC previews a program
    if key == 5220:
        return float(offsets.active + 1)
    if key == 5400:
        return float(state.loaded)
    loaded = offsets.of_tool(state.loaded)
    loaded = origin() if loaded is None else loaded
    points = {
        5161: offsets.home[280], 5181: offsets.home[300], 5211: offsets.shift, 5401: loaded, 5420: position,
        **{5221 + _SYSTEM_STEP * k: offsets.systems[k] for k in range(len(SYSTEM_CODES))},
    }  # fmt: skip
    if state.probed is not None:
        points[PROBE_PARAMETERS[0]] = state.probed
    for first, point in points.items():
        if first <= key < first + len(AXES):
            # Where the program is, and was at a probe, is told in its own units; what the machine keeps, in mm.
            return float(point[key - first]) / (units[key - first] if first in (5420, PROBE_PARAMETERS[0]) else 1.0)
    return None

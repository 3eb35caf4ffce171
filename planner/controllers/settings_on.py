"""The settings of a model: from the limits and words of a machine file, from what is given, or the controller's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from planner.controllers.known import Controller, known_controller
from planner.errors import InputError
from planner.inputs import shorten
from planner.machine.controller_words import ControllerWords
from planner.machine.limits import Limits

Said = tuple[str, float | tuple[float, ...], str]
GIVEN, FILE, DEFAULT = "given", "of the machine file", "the controller's default"


@dataclass(frozen=True, eq=False)
class SettingsOn:
    """Settings of a controller on a machine.

    Attributes
    ----------
    controller : Controller
    settings : object
        Of the type that the controller has.
    said : tuple of (str, float or tuple of float, str)
        Of every setting that is no limit of an axis its key, its value, of axes that differ one each, and where that is
        from; what is inf is left out.
    """

    controller: Controller
    settings: Any
    said: tuple[Said, ...]


def settings_on(name: str, limits: Limits, words: ControllerWords, given: Mapping[str, float]) -> SettingsOn:
    """Make the settings of a controller.

    Parameters
    ----------
    name : str
        Of the controller.
    limits : Limits
        Of the machine, with named axes.
    words : ControllerWords
        What the machine's file says of its planner.
    given : mapping of str to float
        Settings in place of these, by the controller's keys.

    Raises
    ------
    InputError
        If there is no such controller or key, or a value is not one.
    """
    controller = known_controller(name)
    for key in given:
        if key not in controller.keys:
            raise InputError(
                f"controller setting {shorten(repr(key))}: {name} has {', '.join(controller.keys)}; its limits are the "
                "machine's"
            )
    found = {item.name: getattr(words, item.name) for item in fields(words)}
    own = set(controller.keys.values())
    of_file = {field: value for field, value in found.items() if field in own and value is not None}
    of_caller = {controller.keys[key]: value for key, value in given.items()}
    settings = replace(controller.on_limits(limits), **(of_file | of_caller))
    said: list[Said] = []
    for key, field in controller.keys.items():
        values = np.atleast_1d(getattr(settings, field)).astype(np.float64).tolist()
        place = GIVEN if field in of_caller else FILE if field in of_file else DEFAULT
        if np.isfinite(values).all():
            said.append((key, values[0] if len(set(values)) == 1 else tuple(values), place))
    return SettingsOn(controller, settings, tuple(said))

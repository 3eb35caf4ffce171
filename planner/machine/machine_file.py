"""Machine files (TOML, or the INI of a LinuxCNC machine) and the example machines by name."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import read_text, shorten
from planner.machine.limits import DEFAULT_PERIOD, PERIOD, RAPID, SCALARS, Limits
from planner.machine.linuxcnc_ini import machine_table
from planner.quantity import AXIS, FEED, QUANTITIES

if TYPE_CHECKING:
    from pydantic import BaseModel

EXAMPLE_MACHINES = ("mill", "five-axis")


def load_limits(path: str | Path) -> Limits:
    """Load a machine file (TOML, or the INI of a LinuxCNC machine), or one of the example machines by name.

    Keys: ``feed_mm_s``, ``rapid_mm_s``, ``chord_error_mm``, ``period_s``, ``tangential_acceleration_mm_s2``,
    ``tangential_jerk_mm_s3``, and one ``[[axis]]`` each with ``name``, ``velocity_mm_s``, ``acceleration_mm_s2``,
    ``jerk_mm_s3`` (``_rad_s``, ``_rad_s2``, ``_rad_s3`` for the rotary axes A, B, C).  ``inf`` means no limit.
    For what is read of an INI file see :mod:`planner.machine.linuxcnc_ini`.

    Parameters
    ----------
    path : str or Path
        A ``.toml`` or ``.ini`` file, or one of :data:`EXAMPLE_MACHINES`.

    Returns
    -------
    Limits

    Raises
    ------
    InputError
        Naming the file, the key, its value and what is allowed.
    """
    if path == "":
        raise InputError(
            f"machine '' must be a file, .toml or .ini, or an example machine: {', '.join(EXAMPLE_MACHINES)}"
        )
    if isinstance(path, str) and path in EXAMPLE_MACHINES:
        text = resources.files("planner").joinpath(f"data/machines/{path}.toml").read_text(encoding="utf-8")
        return _limits_from_toml(text, path)
    try:
        text = read_text(path, InputError)
    except InputError as error:
        if isinstance(path, str) and not Path(path).suffix:
            raise InputError(f"{error}; the example machines are {', '.join(EXAMPLE_MACHINES)}") from None
        raise
    if Path(path).suffix.lower() == ".ini":
        return _limits_from_table(machine_table(text, str(path)), str(path))
    return _limits_from_toml(text, str(path))


def _limits_from_toml(text: str, where: str) -> Limits:
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not a valid TOML file ({error})") from None
    return _limits_from_table(table, where)


def _limits_from_table(table: dict[str, Any], where: str) -> Limits:
    machine, linear, rotary = _file_models()
    axes = table.pop("axis", [])
    head = _validated(machine, table, where, "")
    if not isinstance(axes, list) or not axes or not all(isinstance(axis, dict) for axis in axes):
        raise InputError(
            f'{where}: one "[[axis]]" table for each axis is needed, with name, velocity, acceleration and jerk'
        )
    rows: list[dict[str, Any]] = []
    for i, axis in enumerate(axes):
        name = axis.get("name")
        known = isinstance(name, str) and name in AXES
        turns = known and name in ROTARY_AXES
        found = _validated(rotary if turns else linear, axis, where, f"axis[{i}] ({name})" if known else f"axis[{i}]")
        rows.append({"name": name} | {q.key: found[q.file_key("rad" if turns else "mm")] for q in AXIS})
    names = [row["name"] for row in rows]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f'{where}: axis "{twice[0]}" is given twice')
    single = {name: head[file_key(name)] for name in SCALARS}
    of_axes: dict[str, Any] = {q.key: [row[q.key] for row in rows] for q in AXIS}
    try:
        return Limits(**single, **of_axes, axes=names)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _validated(model: type[BaseModel], table: Mapping[str, Any], where: str, place: str) -> dict[str, Any]:
    """Values of a table of a machine file, in the order of the model's keys."""
    from pydantic import ValidationError

    try:
        return model.model_validate(table).model_dump()
    except ValidationError as error:
        findings, keys = error.errors(), list(model.model_fields)
    # A misspelt key is both unknown and missing; the unknown one is what the person wrote.
    first = next((finding for finding in findings if finding["type"] == "extra_forbidden"), findings[0])
    key = ".".join(str(part) for part in first["loc"])
    label = f"{place}.{key}" if place else key
    match first["type"]:
        case "missing":
            raise InputError(f'{where}: "{label}" is missing; the keys are {", ".join(keys)}')
        case "extra_forbidden":
            raise InputError(f'{where}: unknown key "{label}"; the keys are {", ".join(keys)}')
        case "literal_error":
            raise InputError(f"{where}: {label} = {shorten(repr(first['input']))} must be one of {', '.join(AXES)}")
    allowed = "a finite number > 0" if key == "period_s" else "a number > 0; use inf for no limit"
    raise InputError(f"{where}: {label} = {shorten(repr(first['input']))} must be {allowed}")


@cache
def _file_models() -> tuple[type[BaseModel], type[BaseModel], type[BaseModel]]:
    """Pydantic models of the head of a machine file, of a linear axis and of a rotary one."""
    from typing import Annotated, Literal

    from pydantic import ConfigDict, Field, create_model

    positive = Annotated[float, Field(gt=0.0)]
    finite = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    strict = ConfigDict(extra="forbid", strict=True)
    required = {q.key for q in QUANTITIES if q.required}

    def of_axis(length: str, names: object) -> Any:
        keys: dict[str, Any] = {"name": (names, ...)} | {q.file_key(length): (positive, ...) for q in AXIS}
        return create_model("Axis", __config__=strict, **keys)

    head: dict[str, Any] = {
        file_key(name): (positive, ... if name in required else math.inf) for name in (FEED.key, RAPID, *SCALARS)
    }
    head[file_key(PERIOD)] = (finite, DEFAULT_PERIOD)
    machine: Any = create_model("Machine", __config__=strict, **head)
    linear = of_axis("mm", Literal["X", "Y", "Z", "U", "V", "W"])
    return machine, linear, of_axis("rad", Literal["A", "B", "C"])


def file_key(name: str) -> str:
    """Key in a machine file of what is one number, which names its unit: ``feed_mm_s``, ``period_s``."""
    keys = {q.key: q.file_key() for q in QUANTITIES} | {PERIOD: f"{PERIOD}_s", RAPID: f"{RAPID}_{FEED.suffix()}"}
    return keys[name]

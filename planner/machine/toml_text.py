"""The text of a machine file in TOML, whatever format the machine was read from: every key, in mm, rad and s."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from planner.geometry.curve import ROTARY_AXES
from planner.machine.limits import PERIOD, RAPID, SCALARS, Limits
from planner.machine.machine_toml import file_key
from planner.machine.program_setup import Point, ProgramSetup
from planner.quantity import AXIS, FEED

Remarks = Mapping[tuple[str, str], str]
"""What is said behind a limit of an axis, by the axis and the key of the quantity."""


def toml_text(
    limits: Limits, setup: ProgramSetup, folder: Path, head: Sequence[str] = (), remarks: Remarks | None = None
) -> str:
    """Write a machine as :func:`~planner.machine.machine_toml.toml_machine` reads it.

    Parameters
    ----------
    limits : Limits
        With the names of its axes.
    setup : ProgramSetup
    folder : Path
        Of the file, from which the tool table is named.
    head : sequence of str
        Lines of remarks at the beginning.
    remarks : mapping, optional
        Behind limits of axes.
    """
    said = {} if remarks is None else remarks
    lines = [f"# {line}" for line in head]
    for name in (FEED.key, RAPID, *(name for name in SCALARS if name not in (FEED.key, RAPID, PERIOD)), PERIOD):
        lines.append(f"{file_key(name)} = {getattr(limits, name)!r}")
    for j, axis in enumerate(limits.axes):
        lines += ["", "[[axis]]", f"name = {json.dumps(axis)}"]
        for quantity in AXIS:
            remark = said.get((axis, quantity.key), "")
            key = quantity.file_key("rad" if axis in ROTARY_AXES else "mm")
            value = float(getattr(limits, quantity.key)[j])
            lines.append(f"{key} = {value!r}{'  # ' + remark if remark else ''}")
    return "\n".join([*lines, *_program(setup, folder), ""])


def _program(setup: ProgramSetup, folder: Path) -> Iterator[str]:
    """The table of what programs count on, if anything is said there."""
    homes = {"home": setup.home, "second_home": setup.second_home, "tool_change": setup.tool_change}
    found = [f"{name}_{unit} = {text}" for name, point in homes.items() if point for unit, text in _points(point)]
    if setup.tools is not None:
        found.insert(0, f"tools = {json.dumps(os.path.relpath(setup.tools, folder), ensure_ascii=False)}")
    offsets: dict[str, list[str]] = {}
    for system, point in setup.offsets.items():
        for unit, text in _points(point):
            offsets.setdefault(unit, []).append(f"{json.dumps(system)} = {text}")
    if found or offsets:
        yield from ("", "[program]", *found)
    for unit, rows in offsets.items():
        yield from ("", f"[program.offsets_{unit}]", *rows)


def _points(point: Point) -> Iterator[tuple[str, str]]:
    """A point as tables in mm and in degrees, as far as it has such axes."""
    for unit, turns in (("mm", False), ("deg", True)):
        own = [f"{axis} = {float(value)!r}" for axis, value in point.items() if (axis in ROTARY_AXES) == turns]
        if own:
            yield unit, f"{{ {', '.join(own)} }}"

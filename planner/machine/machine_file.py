"""Machine files of every format, and the example machines by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from planner.data import data_text
from planner.errors import InputError
from planner.inputs import read_text
from planner.machine.grbl_settings import grbl_machine, is_settings_dump
from planner.machine.klipper_config import is_printer_config, klipper_machine
from planner.machine.limits import Limits
from planner.machine.linuxcnc_ini import ini_machine
from planner.machine.machine_table import Machine, MachineTable
from planner.machine.machine_toml import toml_machine

EXAMPLE_MACHINES = ("mill", "four-axis", "five-axis")
FORMATS = ".toml, the .ini of LinuxCNC, the .cfg of Klipper, or what a GRBL controller answers to $$ (.txt)"


def load_limits(path: str | Path, *, complete: Mapping[str, float] | None = None) -> Limits:
    """Load the limits of a machine from its file, or of one of the example machines by name.

    A TOML file has the keys ``feed_mm_s``, ``rapid_mm_s``, ``chord_error_mm``, ``period_s``,
    ``tangential_acceleration_mm_s2``, ``tangential_jerk_mm_s3``, and one ``[[axis]]`` each with ``name``, ``velocity_mm_s``,
    ``acceleration_mm_s2``, ``jerk_mm_s3`` (``_rad_s``, ``_rad_s2``, ``_rad_s3`` for the rotary axes A, B, C), in these units
    or others (:mod:`planner.machine.machine_toml`).  ``inf`` means no limit.  For what is read of the files of controllers
    see :mod:`planner.machine.linuxcnc_ini`, :mod:`planner.machine.grbl_settings` and
    :mod:`planner.machine.klipper_config`.

    Parameters
    ----------
    path : str or Path
        A ``.toml``, ``.ini`` or ``.cfg`` file, a dump of ``$$``, or one of :data:`EXAMPLE_MACHINES`.
    complete : mapping of str to float, optional
        Limits for the axes that the file has none for: ``velocity_mm_s``, ``acceleration_mm_s2``, ``jerk_mm_s3``, and
        ``velocity_rad_s``, ``acceleration_rad_s2``, ``jerk_rad_s3`` for axes that turn.

    Returns
    -------
    Limits

    Raises
    ------
    InputError
        Naming the file, the line, the key, its value and what is allowed; or what is lacking.
    """
    return read_machine(path, complete).limits


def read_machine(path: str | Path, complete: Mapping[str, float] | None = None) -> Machine:
    """Read a machine from its file: its limits, what its programs count on, and what a person should know of them.

    Arguments and errors as for :func:`load_limits`.
    """
    return _table(path).machine(complete)


def _table(path: str | Path) -> MachineTable:
    if path == "":
        raise InputError(f"machine '' must be a file, {FORMATS}, or an example machine: {', '.join(EXAMPLE_MACHINES)}")
    if isinstance(path, str) and path in EXAMPLE_MACHINES:
        return toml_machine(data_text(f"machines/{path}.toml"), path)
    try:
        text = read_text(path, InputError)
    except InputError as error:
        if isinstance(path, str) and not Path(path).suffix:
            raise InputError(f"{error}; the example machines are {', '.join(EXAMPLE_MACHINES)}") from None
        raise
    file = Path(path)
    kind = file.suffix.lower()
    if kind == ".toml":
        return toml_machine(text, str(path))
    if kind == ".ini":
        return ini_machine(text, file)
    if is_settings_dump(text):
        return grbl_machine(text, str(path))
    if kind == ".cfg" or is_printer_config(text):
        return klipper_machine(text, file)
    if re.search(r"^\s*feed_\w+\s*=", text, re.MULTILINE):
        return toml_machine(text, str(path))
    raise InputError(f"{path}: is no machine file; it must be {FORMATS}")

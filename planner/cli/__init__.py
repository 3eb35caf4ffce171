"""The ``feedplan`` command; each module adds the commands it is named after."""

from planner.cli import compare as _compare  # noqa: F401  registers its command
from planner.cli import plan as _plan  # noqa: F401  registers its commands
from planner.cli import programs as _programs  # noqa: F401
from planner.cli import report as _report  # noqa: F401
from planner.cli import windows as _windows  # noqa: F401
from planner.cli.app import app, main

__all__ = ["app", "main"]

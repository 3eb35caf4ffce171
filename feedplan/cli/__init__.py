"""The ``feedplan`` command; each module adds the commands it is named after."""

from feedplan.cli import compare as _compare  # noqa: F401  registers its command
from feedplan.cli import plan as _plan  # noqa: F401  registers its commands
from feedplan.cli import programs as _programs  # noqa: F401
from feedplan.cli import report as _report  # noqa: F401
from feedplan.cli import windows as _windows  # noqa: F401
from feedplan.cli.app import app, main

__all__ = ["app", "main"]

"""The ``feedplan`` command; each module adds the commands it is named after."""

from planner.cli import plan as _plan  # noqa: F401  registers its commands
from planner.cli.app import app, main

__all__ = ["app", "main"]

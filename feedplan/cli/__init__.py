"""The ``feedplan`` command; each module is the command it is named after."""

from feedplan.cli.app import app, main

__all__ = ["app", "main"]

"""The ``feedplan`` command; each module adds the command it is named after, in the order in which help lists them."""

from feedplan.cli import plan as _plan  # noqa: F401, I001  registers its command
from feedplan.cli import check as _check  # noqa: F401
from feedplan.cli import replay as _replay  # noqa: F401
from feedplan.cli import compare as _compare  # noqa: F401
from feedplan.cli import report as _report  # noqa: F401
from feedplan.cli import time as _time  # noqa: F401
from feedplan.cli import ngc as _ngc  # noqa: F401
from feedplan.cli import windows as _windows  # noqa: F401
from feedplan.cli import curves as _curves  # noqa: F401
from feedplan.cli.app import app, main

__all__ = ["app", "main"]

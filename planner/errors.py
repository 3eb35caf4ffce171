"""The exceptions of feedplan: one root, so that a caller can catch everything we raise on purpose."""

from __future__ import annotations


class FeedrateError(Exception):
    """Root of every error that feedplan raises on purpose."""


class InputError(FeedrateError, ValueError):
    """A value from outside is not allowed; the message names quantity, place, value and what is allowed."""


class CurveError(InputError):
    """A curve cannot be planned: its definition is malformed or it has a singular point."""


class InfeasibleError(FeedrateError):
    """No feedrate profile satisfies the limits (for example an entry feed above a limit)."""


class BrokenLimitError(FeedrateError):
    """A plan breaks a limit, and what was asked for must not be made of such a plan."""


class SolverError(FeedrateError):
    """A solver gave up; the message says at which residual and why."""


class StalledError(FeedrateError):
    """A step-by-step algorithm stopped advancing; the message names the parameter, the cause and a remedy."""


class CoreError(FeedrateError, ImportError):
    """The compiled core is missing, or was made from other source than stands beside it; the message says what to type."""

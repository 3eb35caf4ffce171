"""Values and files that come from outside: checked once, with errors that name quantity, place and what is allowed.

The command line checks names of files before anything else: numpy loads only where numbers are checked.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from planner.types import FloatArray, Side

_MAX_BYTES = 256 * 1024**2
_MAX_QUOTATION = 60
_HOW_TO_MAKE = {
    "Curve": ", as load_curve returns",
    "Limits": ", as load_limits returns or Limits(feed, velocity, acceleration, jerk) makes",
    "FeedrateProfile": ", as plan_feedrate returns",
    "Samples": ", as replay returns",
    "Certificate": ", as certify(...).certificate or read_certificate returns",
    "Figure": ", as plot_plan returns",
}
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def require_path(value: Any, error: type[InputError] = InputError, name: str = "path") -> Path:
    """Return the path of a file; a number would be one of the open files of the process, anything else a TypeError.

    Raises
    ------
    InputError, of the type ``error``
    """
    if isinstance(value, str | os.PathLike):
        return Path(value)
    raise error(f"{name} is {_a(value)}; it must be the path of a file")


def require_flag(value: Any, name: str) -> bool:
    """Refuse what is neither true nor false, but would pass for true: a place, a list of them, a text."""
    import numpy as np

    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise InputError(f"{name} = {shorten(repr(value))} must be True or False")


def read_text(source: Any, error: type[InputError]) -> str:
    """Read a text file (UTF-8, with or without a byte order mark).

    Raises
    ------
    InputError, of the type ``error``
        If the source is no path, or the file is missing, no ordinary file, too large, or not text.
    """
    path = require_path(source, error)
    try:
        # A pipe or a device would be waited for, or never end.
        if path.exists() and not path.is_file():
            raise error(f"{path}: is not a file")
        if path.stat().st_size > _MAX_BYTES:
            raise error(f"{path}: is larger than {_MAX_BYTES // 1024**2} MiB; the file must be smaller")
        return path.read_text(encoding="utf-8-sig")
    except InputError:
        raise
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is not text in UTF-8") from None
    except ValueError as problem:  # a null byte
        raise error(f"{str(source)!r}: is not a path ({problem})") from None


def numbers(values: ArrayLike, what: str, error: type[InputError]) -> FloatArray:
    """Convert to a new float array; no text, truth value or null passes for a number.

    Raises
    ------
    InputError, of the type ``error``
        Naming ``what`` and the offending entry.
    """
    import numpy as np

    try:
        # As objects first: numpy would turn "1", true and null into numbers without a word.
        raw = values if isinstance(values, np.ndarray) else np.array(values, dtype=object)
        if raw.dtype == object:
            odd = [x for x in raw.flat if isinstance(x, bool | np.bool_) or not isinstance(x, int | float | np.number)]
            if odd:
                ragged = isinstance(odd[0], list | tuple)
                raise TypeError("rows differ in length" if ragged else f"{shorten(repr(odd[0]))} is not a number")
        elif raw.dtype.kind not in "iuf":
            raise TypeError(f"values of type {raw.dtype} are not numbers")
        return raw.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise error(f"{what} must be an array of numbers ({problem})") from None


def coordinates(values: ArrayLike, what: str) -> FloatArray:
    """Take an array of parameters, lengths or times as it is, or convert a sequence; any shape, text is refused."""
    import numpy as np

    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray(None)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{what} = {shorten(repr(values))} must be a number or an array of numbers")
    return array.astype(np.float64, copy=False)


def plain_number(text: str, *, other: tuple[str, ...] = ()) -> float | None:
    """Read a number as files hold it, in ASCII digits; None where the text is none.

    Python itself also takes ``1_0``, digits of every script, and ``Infinity``.  ``other`` are words that pass, such as
    ``inf`` or ``nan``.
    """
    return float(text) if text in other or _NUMBER.fullmatch(text) else None


def require_instance(value: Any, wanted: type | tuple[type, ...], name: str) -> None:
    """Raise InputError naming a parameter that is none of the wanted classes, as where two arguments are swapped."""
    if isinstance(value, wanted):
        return
    classes = wanted if isinstance(wanted, tuple) else (wanted,)
    said = " or a ".join(cls.__name__ + _HOW_TO_MAKE.get(cls.__name__, "") for cls in classes)
    raise InputError(f"{name} is {_a(value)}; it must be a {said}")


def _a(value: Any) -> str:
    if isinstance(value, type):
        return f"the class {value.__name__}"
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def positive_number(value: Any, what: str, hint: str = "") -> float:
    """Check one number > 0; inf passes.  The hint ends the message."""
    import numpy as np

    try:
        number = float(value) if isinstance(value, int | float | np.number) and not isinstance(value, bool) else np.nan
    except (TypeError, OverflowError):
        number = np.nan
    if not number > 0.0:
        raise InputError(f"{what} = {shorten(repr(value))} must be a number > 0{hint}")
    return number


def shorten(text: str) -> str:
    """Cut a quotation that would fill the screen, and spell out what cannot be printed."""
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[: _MAX_QUOTATION + 1])
    return text if len(text) <= _MAX_QUOTATION else text[: _MAX_QUOTATION - 3] + "..."


def require_side(side: Side) -> None:
    """Raise InputError for a side that is neither left nor right."""
    if side not in ("left", "right"):
        raise InputError(f'side = {side!r} must be "left" or "right"')

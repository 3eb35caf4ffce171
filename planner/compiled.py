"""The compiled core: one shared library of plain C, loaded once, and its functions as the headers declare them.

``core.NAME(...)`` calls the function NAME.  Arrays are numpy arrays of the declared type, contiguous in C order and
writable unless declared ``const``; None is NULL.  Sizes are not checked here: the Python function around a call knows them.

    from planner.compiled import core
    core.interior_factor(h, h.size, hessian, gains, root)
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from planner.core_source import core_file, source_hash, source_texts
from planner.errors import CoreError

_ROOT = Path(__file__).resolve().parents[1]
_REBUILD = "install feedplan again (python -m pip install .; in a checkout: python -m pip install --editable .)"
_TYPES: dict[str, tuple[Any, tuple[np.dtype[Any], ...]]] = {
    "double": (ctypes.c_double, (np.dtype(np.float64),)),
    "float": (ctypes.c_float, (np.dtype(np.float32),)),
    "int64_t": (ctypes.c_int64, (np.dtype(np.int64),)),
    "int32_t": (ctypes.c_int32, (np.dtype(np.int32),)),
    "uint8_t": (ctypes.c_uint8, (np.dtype(np.uint8), np.dtype(np.bool_))),
}
_NOTHING = ctypes.c_char * 0
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|^[ \t]*#[^\n]*", re.DOTALL | re.MULTILINE)
_PROTOTYPE = re.compile(r"(\w+)\s+(\w+)\s*\(([^()]*)\)\s*;")
_PARAMETER = re.compile(r"(const\s+)?(\w+)\s*(\*)?\s*(?:restrict\s+)?(\w+)\Z")


def prototypes(header: str) -> dict[str, tuple[str, list[str]]]:
    """Every function that a header declares: what it returns, and its parameters, as they stand there."""
    found = {}
    for returned, name, inside in _PROTOTYPE.findall(_COMMENT.sub(" ", header)):
        parameters = [] if inside.strip() == "void" else [" ".join(part.split()) for part in inside.split(",")]
        found[name] = (returned, parameters)
    return found


class _Prepared(partial[Any]):
    """A call with its arguments converted; it keeps the arrays alive of which it has the addresses."""

    held: tuple[Any, ...]


_Array = tuple[str, tuple[np.dtype[Any], ...], bool]


class Function:
    """A function of the core.  Calling it checks and converts the arguments; see :meth:`bind` for calls without that."""

    def __init__(self, library: ctypes.CDLL, name: str, returned: str, parameters: list[str]) -> None:
        self.name = name
        self._call = getattr(library, name)
        self._call.restype = None if returned == "void" else _TYPES[returned][0]
        types, self._arrays = [], list[_Array | None]()
        for parameter in parameters:
            match = _PARAMETER.match(parameter)
            if match is None or match[2] not in _TYPES:
                raise CoreError(
                    f"{name}: the declaration {parameter!r} has another form than the core's headers may have"
                )
            ctype, dtypes = _TYPES[match[2]]
            types.append(ctypes.c_void_p if match[3] else ctype)
            self._arrays.append((match[4], dtypes, not match[1]) if match[3] else None)
        self._call.argtypes = types

    def __call__(self, *arguments: Any) -> Any:
        """What the function returns; TypeError where an argument is none that it declares."""
        return self._call(*self._converted(arguments, self._arrays))

    def bind(self, *arguments: Any) -> Callable[..., Any]:
        """The call with these arguments, converted once: what changes from call to call stands in the arrays.

        What is left out, at the end, is given with each call.
        """
        first, others = self._arrays[: len(arguments)], self._arrays[len(arguments) :]
        types = self._call.argtypes[: len(arguments)]
        converted = [c_type(value) for c_type, value in zip(types, self._converted(arguments, first), strict=True)]
        prepared = _Prepared(self._call, *converted)
        prepared.held = arguments
        if not others:
            return prepared
        return lambda *rest: prepared(*self._converted(rest, others))

    def _converted(self, arguments: tuple[Any, ...], arrays: list[_Array | None]) -> list[Any]:
        if len(arguments) != len(arrays):
            raise TypeError(f"{self.name} takes {len(self._arrays)} arguments, not {len(arguments)}")
        return [
            argument if array is None or argument is None else self._address(argument, *array)
            for argument, array in zip(arguments, arrays, strict=True)
        ]

    def _address(self, array: Any, name: str, dtypes: tuple[np.dtype[Any], ...], written: bool) -> int:
        # Most arrays are writable and contiguous, which their buffer tells by itself, in a third of the time.
        if type(array) is np.ndarray and array.dtype in dtypes:
            try:
                return ctypes.addressof(_NOTHING.from_buffer(array))  # type: ignore[arg-type]  # it has a buffer
            except TypeError:  # it is not
                pass
        if not isinstance(array, np.ndarray) or array.dtype not in dtypes:
            found = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
            raise TypeError(f"{self.name}: {name} must be an array of {dtypes[0]}, not {found}")
        flags = array.flags
        if not flags.c_contiguous or (written and not flags.writeable):
            raise TypeError(f"{self.name}: {name} must be contiguous{' and writable' * written}")
        return int(array.__array_interface__["data"][0])


class Core:
    """The functions of the library, each made when it is first used."""

    @cached_property
    def _source(self) -> dict[str, bytes]:
        return source_texts(_ROOT)

    @cached_property
    def _library(self) -> ctypes.CDLL:
        file = core_file(_ROOT)
        if not file.exists():
            raise CoreError(f"the compiled core {file.name} is missing from {file.parent}; {_REBUILD}")
        try:
            library = ctypes.CDLL(str(file))
            library.core_source.restype = ctypes.c_char_p
        except (OSError, AttributeError) as error:  # no library of this machine, or another one
            raise CoreError(f"the compiled core {file} cannot be loaded ({error}); {_REBUILD}") from None
        if library.core_source() != source_hash(self._source).encode():
            raise CoreError(f"the compiled core {file} was made from other source than stands beside it; {_REBUILD}")
        return library

    @cached_property
    def _declared(self) -> dict[str, tuple[str, list[str]]]:
        found: dict[str, tuple[str, list[str]]] = {}
        for name, text in self._source.items():
            if name.endswith(".h") and not name.endswith(("_inline.h", "/core.h", "/step.h", "/stream.h")):
                found |= prototypes(text.decode())
        return found

    def __getattr__(self, name: str) -> Function:
        if name.startswith("_") or name not in self._declared:
            raise AttributeError(f"the core declares no function {name!r}")
        function = Function(self._library, name, *self._declared[name])
        setattr(self, name, function)
        return function


core = Core()

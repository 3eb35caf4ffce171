"""NPZ archives from outside: nothing that the bytes say is believed before there is memory for it.

Members must be stored as they are, as ``numpy.savez`` does; so none can be larger than the file.  An array's type and shape
are read from the text in front of its numbers, and must account for every byte that follows.
"""

from __future__ import annotations

import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.inputs import shorten

# How numpy, of any version, begins an array: its magic, the length of the line, and the line.
_MAGIC = re.compile(rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)", re.DOTALL)
_DESCRIPTION = re.compile(
    rb"\{'descr': '([^']{2,20})', 'fortran_order': False, 'shape': \(((?:\d{1,15},? ?){0,8})\), \} *\n"
)
_TYPES = re.compile(r"<f8|<i8|<i4|\|i1|\|b1|<U\d{1,9}")
# What zipfile raises for an archive that is none.
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    ValueError,
    EOFError,
    KeyError,
    NotImplementedError,
    OverflowError,
    RuntimeError,
)


_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest a zip archive can say; the time of writing would change the bytes


def write_arrays(file: BinaryIO, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write what ``numpy.savez`` would, but with a fixed date: the same arrays give the same bytes."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, values in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _DATE), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(values, order="C"), allow_pickle=False)


def open_archive(file: BinaryIO, path: str | Path) -> zipfile.ZipFile:
    """Open an archive that holds every member once, as large as the file at most.

    Raises InputError, naming ``path``, if it is none.
    """
    try:
        archive = zipfile.ZipFile(file)
    except _DAMAGE:
        raise InputError(f"{path}: is not a whole NPZ file; it is cut off, damaged or of another kind") from None
    size = os.fstat(file.fileno()).st_size
    seen: set[str] = set()
    for info in archive.infolist():
        if info.compress_type != zipfile.ZIP_STORED or not 0 <= info.file_size <= size:
            raise InputError(
                f"{path}: {shorten(info.filename)} is compressed, or larger than the file; an array must be stored as it "
                "is, as numpy.savez does"
            )
        if info.filename in seen:
            raise InputError(f'{path}: "{shorten(info.filename.removesuffix(".npy"))}" is given twice; leave one')
        seen.add(info.filename)
    return archive


def read_array(archive: zipfile.ZipFile, name: str, path: str | Path) -> NDArray[Any]:
    """Read an array of floats, integers, truth values or text.

    Raises InputError, naming ``path`` and the array, if it cannot be read or its bytes are not those of its shape.
    """
    try:
        content = archive.read(f"{name}.npy")
    except _DAMAGE as error:
        raise InputError(f"{path}: {name} cannot be read ({shorten(str(error))}); the file is damaged") from None
    magic = _MAGIC.match(content)
    found = None if magic is None else _DESCRIPTION.match(content, magic.end())
    if found is None or _TYPES.fullmatch(found[1].decode("latin-1")) is None:
        raise InputError(
            f"{path}: {name} cannot be read (it is no plain array); the file is damaged or of another kind"
        )
    shape = tuple(int(number) for number in found[2].decode("ascii").replace(",", " ").split())
    kind = np.dtype(found[1].decode("ascii"))
    if math.prod(shape) * kind.itemsize != len(content) - found.end():
        raise InputError(
            f"{path}: {name} has {len(content) - found.end()} bytes, which are not those of {kind.str} of shape {shape}; "
            "the file is damaged"
        )
    if kind.itemsize == 0 or (kind.kind == "U" and not _is_text(content[found.end() :])):
        raise InputError(f"{path}: {name} cannot be read (it is no text); the file is damaged")
    if kind.kind == "b" and max(content[found.end() :], default=0) > 1:
        raise InputError(f"{path}: {name} cannot be read (it holds no truth values); the file is damaged")
    return np.frombuffer(content, dtype=kind, offset=found.end()).reshape(shape).copy()


def read_arrays(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read every array of an archive.

    Raises InputError if the file cannot be read or one of them cannot.
    """
    try:
        with open(path, "rb") as file, open_archive(file, path) as archive:
            return {name: read_array(archive, name, path) for name in array_names(archive)}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def array_names(archive: zipfile.ZipFile) -> list[str]:
    """Names of the arrays of an archive."""
    return [name.removesuffix(".npy") for name in archive.namelist()]


def _is_text(content: bytes) -> bool:
    try:
        content.decode("utf-32-le")
    except UnicodeDecodeError:
        return False
    return True

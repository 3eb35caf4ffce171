"""Certificates as NPZ files, written whole and read back bit by bit.

The sections stand one after another in each array; ``knots`` says how many each has.  Nothing read here is believed:
``planner.verify.certificate`` verifies what the multipliers prove.
"""

from __future__ import annotations

import json
import math
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.certificate import Certificate, CertificateSection
from planner.errors import InputError
from planner.files.archive import write_arrays
from planner.files.whole_file import whole_file
from planner.inputs import require_instance, require_path

FORMAT = "feedplan-certificate 1"
_MEMBERS = ("header", "knots", "ends", "sigma", "u", "jerk", "acceleration")
_TYPES = {"header": "u1", "knots": "i8"}
_MAX_HEADER = 10_000  # bytes; names of limits and a hash


def write_certificate(path: str | Path, certificate: Certificate) -> None:
    """Write a certificate as an ``.npz`` file.

    Raises InputError if the file cannot be written or the suffix is another; then no file is left behind.
    """
    require_npz(path)
    require_instance(certificate, Certificate, "certificate")
    sections = certificate.sections
    header = {
        "format": FORMAT,
        "curve_hash": certificate.fingerprint,
        "bound_s": certificate.bound,
        "periodic": certificate.periodic,
        "jerk_names": list(certificate.jerk_names),
        "acceleration_names": list(certificate.acceleration_names),
    }
    ends = [(s.start_feed, s.end_feed, s.start_acceleration) for s in sections]
    members: dict[str, NDArray[Any]] = {
        "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
        "knots": np.array([s.sigma.size for s in sections], dtype=np.int64),
        "ends": np.array(ends, dtype=np.float64),
        "sigma": np.concatenate([s.sigma for s in sections]),
        "u": np.concatenate([s.u for s in sections], axis=1),
        "jerk": np.concatenate([s.jerk for s in sections], axis=1),
        "acceleration": np.concatenate([s.acceleration for s in sections], axis=1),
    }
    with whole_file(path) as file:
        write_arrays(file, members)


def read_certificate(path: str | Path) -> Certificate:
    """Read a certificate.

    Raises
    ------
    InputError
        If the file cannot be read, is none of :func:`write_certificate`, or holds arrays of other types or shapes.
    """
    require_npz(path)
    try:
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            return _certificate(archive, path, os.fstat(file.fileno()).st_size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (zipfile.BadZipFile, NotImplementedError, EOFError, RuntimeError):
        raise InputError(f"{path}: is not a whole NPZ file; it is cut off, damaged or of another kind") from None


def require_npz(path: str | Path) -> None:
    """Raise InputError unless the name of a certificate's file ends in .npz."""
    suffix = require_path(path).suffix
    if suffix.lower() != ".npz":
        raise InputError(f'{path}: the suffix of a certificate must be .npz, not "{suffix}"')


def _certificate(archive: zipfile.ZipFile, path: str | Path, size: int) -> Certificate:
    names = [info.filename for info in archive.infolist()]
    if sorted(names) != sorted(f"{name}.npy" for name in _MEMBERS):
        raise InputError(f"{path}: is no certificate; one holds {', '.join(_MEMBERS)}")
    arrays = {name: _member(archive, name, path, size) for name in _MEMBERS}
    header = _header(arrays["header"], path)
    jerk_names, acceleration_names = (tuple(header[key]) for key in ("jerk_names", "acceleration_names"))
    knots = arrays["knots"]
    if knots.ndim != 1 or knots.size == 0 or (knots < 2).any() or (knots > arrays["sigma"].size).any():
        raise InputError(f"{path}: knots must give every section 2 knots at least, and no more than there are")
    count, total = knots.size, int(knots.sum())
    shapes = {
        "ends": (count, 3),
        "sigma": (total,),
        "u": (3, total),
        "jerk": (len(jerk_names), total + count),
        "acceleration": (len(acceleration_names), total),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise InputError(f"{path}: {name} has the shape {arrays[name].shape}; it must be {shape}")
    sections = []
    first = 0
    for k, n in enumerate(int(n) for n in knots):
        some, more = slice(first, first + n), slice(first + k, first + k + n + 1)
        start_feed, end_feed, acceleration = (float(value) for value in arrays["ends"][k])
        rows = (arrays["sigma"][some], arrays["u"][:, some], arrays["jerk"][:, more], arrays["acceleration"][:, some])
        sections.append(CertificateSection(*rows, start_feed, end_feed, acceleration))
        first += n
    return Certificate(
        tuple(sections),
        jerk_names,
        acceleration_names,
        float(header["bound_s"]),
        header["curve_hash"],
        header["periodic"],
    )


def _header(raw: NDArray[Any], path: str | Path) -> dict[str, Any]:
    """Parse and check the header."""
    if raw.ndim != 1 or raw.size > _MAX_HEADER:
        raise InputError(f"{path}: the header has the shape {raw.shape}; it must be (n,) with n <= {_MAX_HEADER}")
    try:
        header = json.loads(raw.tobytes().decode())
    except (ValueError, RecursionError):
        raise InputError(f"{path}: the header is no JSON; the file is damaged or of another kind") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        said = header.get("format") if isinstance(header, dict) else None
        raise InputError(f'{path}: the format is {said!r}; this program reads "{FORMAT}"')

    def texts(value: Any) -> bool:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)

    wanted: dict[str, tuple[str, Callable[[Any], bool]]] = {
        "curve_hash": ("a text", lambda v: isinstance(v, str)),
        "bound_s": ("a finite number", lambda v: type(v) in (int, float) and math.isfinite(v)),
        "periodic": ("true or false", lambda v: isinstance(v, bool)),
        "jerk_names": ("a list of texts", texts),
        "acceleration_names": ("a list of texts", texts),
    }
    for key, (what, holds) in wanted.items():
        if key not in header or not holds(header[key]):
            raise InputError(f"{path}: {key} = {header.get(key)!r} in the header must be {what}")
    return header


def _member(archive: zipfile.ZipFile, name: str, path: str | Path, size: int) -> NDArray[Any]:
    """Read one array, after its size has been compared with the bytes that are there: no promise is allocated."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED:
        raise InputError(f"{path}: {name} is compressed; a certificate is stored as it is")
    if not info.file_size == info.compress_size <= size:
        raise InputError(f"{path}: {name} says it has {info.file_size} bytes, more than the file; it is damaged")
    kind: np.dtype[Any] = np.dtype(_TYPES.get(name, "f8"))
    with archive.open(info) as entry:
        try:
            shape, order, dtype = _array_header(entry)
        except ValueError as error:
            raise InputError(f"{path}: {name} cannot be read ({error}); the file is damaged") from None
        if dtype != kind or order:
            raise InputError(f"{path}: {name} is {dtype}{' in columns' * order}; it must be {kind} in rows")
        data = entry.read()
        if math.prod(shape) * kind.itemsize != len(data):
            raise InputError(f"{path}: {name} has {len(data)} bytes, but its shape {shape} needs another number")
    return np.frombuffer(data, dtype=kind).reshape(shape)


def _array_header(entry: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether columns come first, and type, of an array in NumPy's format 1.0."""
    formats: Any = np.lib.format
    if formats.read_magic(entry) != (1, 0):
        raise ValueError("format version other than 1.0")
    shape, in_columns, dtype = formats.read_array_header_1_0(entry)
    return shape, in_columns, dtype

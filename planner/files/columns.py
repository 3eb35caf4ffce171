"""Files of a header and columns: CSV for people and controllers, NPZ for programs.

A CSV file starts with lines ``# key = value``, then come the names of the columns and the rows.  An NPZ file holds the
same lines as the text ``header`` and every column as an array.  Floats are written in their shortest exact form, so
both are read back bit by bit, and the same content gives the same bytes.

The last two lines of a header seal the file: the SHA-256 of the columns, one after the other as little-endian doubles (a
column of words as bytes, indices into their list; one of text as UTF-8, each text with a line end), and that of the lines
above.  A seal tells damage and stray edits, also
those too small to be seen in the numbers; it proves nothing about their truth.
"""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.files.archive import array_names, open_archive, read_array, write_arrays
from planner.files.formats import file_format
from planner.files.whole_file import whole_file
from planner.inputs import require_path, shorten

Columns = Mapping[str, NDArray[Any]]

_ROWS_AT_ONCE = 5000  # bounds the memory that text takes: a cell is ten times its eight bytes
_DIGITS = frozenset("0123456789+-.eE")
_WORDS = frozenset("nanif")  # of nan and inf, which get a message of their own
_SEALS = ("rows_sha256", "header_sha256")


def write_columns(
    path: str | Path, header: Mapping[str, str], columns: Columns, words: Mapping[str, Sequence[str]]
) -> None:
    """Write a file, or nothing.

    Parameters
    ----------
    path : str or Path
    header : mapping
        One line each; the last should tell the number of rows.
    columns : mapping of str to (n,) arrays
        Floats, or int8 where ``words`` has the column, or text as objects.
    words : mapping
        Columns that are indices into a list of words: CSV shows the word.

    Raises
    ------
    InputError
        If a float is not finite, or the file cannot be written.
    """
    suffix = file_format(path)
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values)) if values.dtype != object else np.empty(0, dtype=np.int64)
        if bad.size:
            raise InputError(f"{path}: not written: {name}[{bad[0]}] = {values[bad[0]]} must be finite")
    sealed = {key: _encode(value).decode("utf-8") for key, value in header.items()}
    sealed[_SEALS[0]] = digest_of_rows(columns.values())
    sealed[_SEALS[1]] = digest_of_lines(sealed)
    lines = "".join(f"# {key} = {value}\n" for key, value in sealed.items())
    with whole_file(path) as file:
        if suffix == ".npz":
            plain = {name: rows.astype(np.str_) if rows.dtype == object else rows for name, rows in columns.items()}
            write_arrays(file, {"header": np.array(_encode(lines).decode("utf-8"))} | plain)
        else:
            file.writelines(_encode(text) for text in _csv(lines, columns, words))


def _encode(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")  # a file name may hold bytes that are no text


def digest_of_rows(columns: Iterable[NDArray[Any]]) -> str:
    """The seal of columns, in the order they are written in."""
    digest = hashlib.sha256()
    for values in columns:
        if values.dtype == object:
            digest.update(_encode("".join(f"{text}\n" for text in values)))
            continue
        digest.update(np.ascontiguousarray(values, dtype="<f8" if values.dtype == np.float64 else values.dtype).data)
    return digest.hexdigest()


def digest_of_lines(header: Mapping[str, str]) -> str:
    """The seal of header lines; its own line does not count."""
    text = "".join(f"{key} = {value}\n" for key, value in header.items() if key != _SEALS[1])
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _csv(lines: str, columns: Columns, words: Mapping[str, Sequence[str]]) -> Iterator[str]:
    yield lines
    yield ",".join(columns) + "\n"
    for first in range(0, next(iter(columns.values())).size, _ROWS_AT_ONCE):
        cells: list[Iterable[str]] = []
        for name, values in columns.items():
            part = values[first : first + _ROWS_AT_ONCE].tolist()
            if values.dtype == object:
                cells.append([f'"{text.replace(chr(34), 2 * chr(34))}"' for text in part])
            else:
                cells.append([words[name][i] for i in part] if name in words else map(repr, part))
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"


@dataclass(frozen=True)
class ColumnFile:
    """A file open for reading: its header is read, its columns are not yet."""

    path: str | Path
    header: Mapping[str, str]
    names: Sequence[str]
    first_line: int  # of the rows
    source: TextIO | zipfile.ZipFile

    def place(self, row: int) -> str:
        """Where a row stands, for messages: file and line, or file and row."""
        in_lines = not isinstance(self.source, zipfile.ZipFile)
        return f"{self.path}:{self.first_line + row}" if in_lines else f"{self.path}: row {row + 1}"

    def require_only(self, keys: Sequence[str]) -> None:
        """Refuse a header with other lines than these, or one whose lines are not those that were written."""
        unknown = next((key for key in self.header if key not in keys and key not in _SEALS), None)
        if unknown is not None:
            raise InputError(f'{self.path}: the header line "# {shorten(unknown)} = ..." is unknown; remove it')
        if self.header[_SEALS[1]] != digest_of_lines(self.header):
            raise InputError(
                f"{self.path}: the header is not the one that was written ({_SEALS[1]} differs); the file is damaged or "
                "edited: write it again"
            )

    def require_rows(self, columns: Columns) -> None:
        """Refuse columns, in the order they are written in, that are not those that were written."""
        if self.header[_SEALS[0]] != digest_of_rows(columns.values()):
            raise InputError(
                f"{self.path}: the rows are not those that were written ({_SEALS[0]} differs); the file is damaged or "
                "edited: write it again"
            )

    def columns(self, wanted: Sequence[str], words: Mapping[str, Sequence[str]]) -> Columns:
        """Read columns: int8 where ``words`` has the column, else finite floats.

        Raises InputError, with the place, for what is missing, unknown, given twice, malformed, not finite, or of another
        number of rows than the header's ``rows`` says.
        """
        missing = [name for name in wanted if name not in self.names]
        if missing:
            raise InputError(f'{self.path}: the column "{missing[0]}" is missing; the columns are {", ".join(wanted)}')
        odd = [name for name in self.names if name not in wanted or self.names.count(name) > 1]
        if odd:
            what = "is given twice" if odd[0] in wanted else f"is unknown; the columns are {', '.join(wanted)}"
            raise InputError(f'{self.path}: the column "{shorten(odd[0])}" {what}')
        if isinstance(self.source, zipfile.ZipFile):
            columns: Columns = {name: self._array(self.source, name, words.get(name)) for name in wanted}
        else:
            columns = self._parse(self.source, wanted, words)
        for name, values in columns.items():
            if str(values.size) != self.header["rows"]:
                said = shorten(self.header["rows"])
                raise InputError(f"{self.path}: {values.size} rows, but the header says {said}; the table is cut off")
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(f"{self.place(int(bad[0]))}: {name} = {values[bad[0]]} must be finite")
        return columns

    def _array(self, archive: zipfile.ZipFile, name: str, words: Sequence[str] | None) -> NDArray[Any]:
        values = read_array(archive, name, self.path)
        kind: type[np.generic] = np.float64 if words is None else np.int8
        if values.ndim != 1 or values.dtype != kind:
            raise InputError(
                f"{self.path}: {name} is {values.dtype} of shape {values.shape}; must be {kind.__name__} of shape (n,)"
            )
        if words is not None:
            bad = np.flatnonzero((values < 0) | (values >= len(words)))
            if bad.size:
                raise InputError(
                    f"{self.place(int(bad[0]))}: {name} = {values[bad[0]]} must lie within 0..{len(words) - 1}, an "
                    f"index into {', '.join(words)}"
                )
        return values

    def _parse(self, text: TextIO, wanted: Sequence[str], words: Mapping[str, Sequence[str]]) -> Columns:
        index = {name: {word: i for i, word in enumerate(row)} for name, row in words.items()}
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in wanted}
        line, width = self.first_line, len(self.names)
        while lines := list(islice(text, _ROWS_AT_ONCE)):
            cells = self._cells(lines, line)
            for name in wanted:
                column = cells[self.names.index(name) :: width]
                try:
                    if name in index:
                        parts[name].append(np.array([index[name][cell] for cell in column], dtype=np.int8))
                    else:
                        if not frozenset("".join(column)) <= _DIGITS | _WORDS:
                            raise ValueError(name)
                        parts[name].append(np.array(list(map(float, column))))
                except (KeyError, ValueError):
                    raise self._bad_cell(column, name, index.get(name), line) from None
            line += len(lines)
        return {name: np.concatenate(part) if part else np.empty(0) for name, part in parts.items()}

    def _cells(self, lines: Sequence[str], first: int) -> list[str]:
        """Split rows into cells, one list for all: row i begins at i * width."""
        if not lines[-1].endswith("\n"):
            raise InputError(f"{self.path}:{first + len(lines) - 1}: the last line is incomplete; the table is cut off")
        width = len(self.names)
        for i, text in enumerate(lines):
            if text.count(",") != width - 1:
                raise InputError(f"{self.path}:{first + i}: {text.count(',') + 1} cells; a row must have {width}")
        return "".join(lines).replace("\n", ",").split(",")[:-1]

    def _bad_cell(self, column: Sequence[str], name: str, words: Mapping[str, int] | None, first: int) -> InputError:
        """Find the first cell that is refused."""
        for i, cell in enumerate(column):
            if words is not None and cell not in words:
                return InputError(
                    f'{self.path}:{first + i}: {name}: "{shorten(cell)}" must be one of {", ".join(words)}'
                )
            try:
                if words is None and frozenset(cell) <= _DIGITS | _WORDS:
                    float(cell)
                elif words is None:
                    raise ValueError(cell)
            except ValueError:
                return InputError(f'{self.path}:{first + i}: {name}: "{shorten(cell)}" must be a number')
        raise AssertionError("one of the cells was refused")


@contextmanager
def reading(path: str | Path, known: str, keys: Sequence[str]) -> Iterator[ColumnFile]:
    """Open a file and read its header.

    Parameters
    ----------
    path : str or Path
    known : str
        Name and version that the key ``format`` must have.
    keys : sequence of str
        Further keys that must be there.

    Raises
    ------
    InputError
        If the file cannot be read, is none of these, has another version, or lacks a key.
    """
    require_path(path)
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe or a device would be waited for, or never end
        raise InputError(f"{path}: is not a file")
    try:
        with open(path, "rb") as file:
            if file_format(path) == ".npz":
                with open_archive(file, path) as archive:
                    names = array_names(archive)
                    lines = str(read_array(archive, "header", path)).splitlines() if "header" in names else []
                    names = [name for name in names if name != "header"]
                    yield ColumnFile(path, _header(lines, known, keys, path), names, 0, archive)
            else:
                text = io.TextIOWrapper(file, encoding="utf-8-sig")
                lines = []
                while (line := text.readline()).startswith("#"):
                    lines.append(line)
                header = _header(lines, known, keys, path)
                yield ColumnFile(path, header, line.rstrip("\n").split(","), len(lines) + 2, text)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not text; the file is damaged or of another kind") from None


def _header(lines: Iterable[str], known: str, keys: Sequence[str], path: str | Path) -> dict[str, str]:
    header: dict[str, str] = {}
    for line in lines:
        key, _, value = (part.strip() for part in line[1:].partition("="))
        if key in header:
            raise InputError(f'{path}: the header line "# {shorten(key)} = ..." is given twice; leave one')
        header[key] = value
    kind, _, version = header.get("format", "").partition(" ")
    if kind != known.split(maxsplit=1)[0]:
        raise InputError(f'{path}: is no feedrate table; one starts with "# format = {known}"')
    if version != known.split()[1]:
        raise InputError(
            f'{path}: format version "{shorten(version)}" is not read; this program reads version {known.split()[1]}, which '
            "says more of the plan: plan again to write it"
        )
    missing = [key for key in (*keys, *_SEALS) if key not in header]
    if missing:
        raise InputError(f'{path}: the header line "# {missing[0]} = ..." is missing; the table is cut off or edited')
    return header

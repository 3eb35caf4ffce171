"""What a long plan leaves on disk while it is made: one file a window, and the state from which the next one begins.

A directory beside the output holds ``window-000000.npz``, ..., and ``state.npz``.  Each file is written whole; the state
comes after the window it follows, and names how many windows count.  So whatever ends a run, the next one goes on from
the last state, and windows beyond it are written again.  When all is done the columns are joined and the directory goes.
"""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.files.archive import read_arrays
from planner.files.whole_file import whole_file

_HEADER = "header"
FORMAT = "feedplan windows 2"


@dataclass(frozen=True)
class Journal:
    """The directory of a plan in the making, for one identity: program, tolerance and limits."""

    directory: Path
    identity: str

    @classmethod
    def beside(cls, output: Path, identity: str, *, resume: bool) -> Journal:
        """Open the directory of an output; one whose work is not wanted is emptied.

        Raises InputError if there is one of other inputs, of another version, or damaged: it may be hours of work.
        """
        journal = cls(output.with_name(output.name + ".windows"), identity)
        if journal.directory.exists():
            if not journal.directory.is_dir():
                raise InputError(
                    f"{journal.directory}: is not a directory; the work in progress needs one of this name"
                )
            if resume:
                journal.state()
            else:
                journal.remove()
        try:
            journal.directory.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{journal.directory}: cannot be made ({error.strerror or error})") from None
        return journal

    @property
    def state_path(self) -> Path:
        """File of the state."""
        return self.directory / "state.npz"

    def refusal(self, path: Path, reason: str) -> InputError:
        """What to say of a file of the journal that does not count."""
        return InputError(
            f"{path}: {reason}; to begin again, plan with --fresh, or delete the directory {self.directory}"
        )

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | None:
        """Header and arrays of the last state, if there is one.

        Raises InputError if it is damaged, of another version, or of other inputs.
        """
        path = self.state_path
        if not path.exists():
            return None
        arrays = self._arrays(path)
        try:
            header = json.loads(str(arrays.pop(_HEADER)))
        except (KeyError, ValueError, RecursionError):
            raise self.refusal(path, "is damaged (it has no header)") from None
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise self.refusal(path, f"is not of this version, which writes {FORMAT}")
        if header.get("identity") != self.identity:
            raise self.refusal(path, "belongs to another program, tolerance or machine")
        return header, arrays

    def _arrays(self, path: Path) -> dict[str, NDArray[Any]]:
        try:
            return read_arrays(path)
        except InputError as error:
            raise self.refusal(path, f"is damaged ({str(error).removeprefix(f'{path}: ')})") from None

    def window(self, index: int, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        """The columns of a window; raises InputError if the file is damaged or lacks one."""
        path = self.window_path(index)
        arrays = self._arrays(path)
        missing = next((name for name in names if name not in arrays), None)
        if missing is not None:
            raise self.refusal(path, f"is damaged (it has no {missing})")
        return arrays

    def save_state(self, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace the state; floats keep every digit."""
        words = np.array(json.dumps({**header, "format": FORMAT, "identity": self.identity}))
        with whole_file(self.directory / "state.npz") as file:
            np.savez(file, allow_pickle=False, **{_HEADER: words, **arrays})

    def save_window(self, index: int, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write the columns of a window."""
        with whole_file(self.window_path(index)) as file:
            np.savez(file, allow_pickle=False, **columns)

    def column(self, count: int, name: str) -> Iterator[NDArray[Any]]:
        """A column of the first ``count`` windows, one after the other."""
        for index in range(count):
            with np.load(self.window_path(index), allow_pickle=False) as file:
                yield file[name]

    def join(self, output: Path, count: int, names: tuple[str, ...], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write columns of all windows end to end, and further arrays, as one NPZ file, a window at a time."""
        sizes = [part.size for part in self.column(count, names[0])]
        first = np.concatenate([[0], np.cumsum(sizes)])
        with whole_file(output) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
            for name, array in {**arrays, "first": first}.items():
                with archive.open(f"{name}.npy", "w") as entry:
                    np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)
            for name in names:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    _write_column(entry, self.column(count, name), int(first[-1]))  # type: ignore[arg-type]

    def remove(self) -> None:
        """Delete the directory with the files of a journal; nothing else is expected in it."""
        for path in (self.state_path, *self.directory.glob("window-*.npz")):
            path.unlink(missing_ok=True)
        for path in self.directory.glob(".feedplan-*.part"):  # of a run that was killed while it wrote
            path.unlink(missing_ok=True)
        if not any(self.directory.iterdir()):
            shutil.rmtree(self.directory)

    def window_path(self, index: int) -> Path:
        """File of a window."""
        return self.directory / f"window-{index:06d}.npz"


def _write_column(entry: BinaryIO, parts: Iterator[NDArray[Any]], rows: int) -> None:
    """Write an array of ``rows`` rows in the NPY format, part after part."""
    for index, part in enumerate(parts):
        if index == 0:
            description = np.lib.format.dtype_to_descr(part.dtype)
            shape = (rows, *part.shape[1:])
            np.lib.format.write_array_header_1_0(entry, {"descr": description, "fortran_order": False, "shape": shape})
        entry.write(np.ascontiguousarray(part).tobytes())

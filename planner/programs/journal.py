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
from planner.output import whole_file

_HEADER = "header"


@dataclass(frozen=True)
class Journal:
    """The directory of a plan in the making, for one identity: program, tolerance and limits."""

    directory: Path
    identity: str

    @classmethod
    def beside(cls, output: Path, identity: str, *, resume: bool) -> Journal:
        """Open the directory of an output; one that belongs to other inputs, or is not wanted, is emptied."""
        journal = cls(output.with_name(output.name + ".windows"), identity)
        if journal.directory.exists() and not (resume and journal._belongs()):
            journal.remove()
        try:
            journal.directory.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{journal.directory}: cannot be made ({error.strerror or error})") from None
        return journal

    def _belongs(self) -> bool:
        state = self.state()
        return state is not None and state[0]["identity"] == self.identity

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | None:
        """Header and arrays of the last state, if there is one."""
        path = self.directory / "state.npz"
        if not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            return json.loads(str(arrays.pop(_HEADER))), arrays
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: is damaged ({error}); delete {self.directory.name} to begin again") from None

    def save_state(self, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace the state; floats keep every digit."""
        words = np.array(json.dumps({**header, "identity": self.identity}))
        with whole_file(self.directory / "state.npz") as file:
            np.savez(file, allow_pickle=False, **{_HEADER: words, **arrays})

    def save_window(self, index: int, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write the columns of a window."""
        with whole_file(self._path(index)) as file:
            np.savez(file, allow_pickle=False, **columns)

    def column(self, count: int, name: str) -> Iterator[NDArray[Any]]:
        """A column of the first ``count`` windows, one after the other."""
        for index in range(count):
            with np.load(self._path(index), allow_pickle=False) as file:
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
        for path in self.directory.glob("*.npz"):
            path.unlink(missing_ok=True)
        for path in self.directory.glob(".feedplan-*.part"):  # of a run that was killed while it wrote
            path.unlink(missing_ok=True)
        if not any(self.directory.iterdir()):
            shutil.rmtree(self.directory)

    def _path(self, index: int) -> Path:
        return self.directory / f"window-{index:06d}.npz"


def _write_column(entry: BinaryIO, parts: Iterator[NDArray[Any]], rows: int) -> None:
    """Write an array of ``rows`` rows in the NPY format, part after part."""
    for index, part in enumerate(parts):
        if index == 0:
            description = np.lib.format.dtype_to_descr(part.dtype)
            shape = (rows, *part.shape[1:])
            np.lib.format.write_array_header_1_0(entry, {"descr": description, "fortran_order": False, "shape": shape})
        entry.write(np.ascontiguousarray(part).tobytes())

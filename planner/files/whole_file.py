"""Output files: written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from planner.errors import InputError
from planner.inputs import require_path


def require_writable(path: str | Path) -> None:
    """Raise InputError unless a file can be written under this name: to be asked before the work, not after it."""
    temporary = _temporary(_target(path))
    try:
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise _refusal(path, error) from None
    temporary.unlink(missing_ok=True)


@contextmanager
def whole_file(path: str | Path) -> Iterator[BinaryIO]:
    """Open a file that takes its name only when the block has ended without an error.

    The bytes go to a temporary file in the same directory, which then replaces the target in one step: whatever goes
    wrong, an older file of that name stays as it was and nothing else is left behind.

    Raises
    ------
    InputError
        If the file cannot be written (no such directory, no permission, disk full).
    """
    target = _target(path)
    temporary = _temporary(target)
    try:
        with open(temporary, "xb") as file:
            yield file
        os.replace(temporary, target)
    except OSError as error:
        raise _refusal(path, error) from None
    finally:
        temporary.unlink(missing_ok=True)


def _target(path: str | Path) -> Path:
    """The file behind the name (a link stays a link); refuses what no file can replace."""
    target = Path(os.path.realpath(require_path(path)))
    if target.is_dir():
        raise InputError(f"{path}: cannot be written (it is a directory); give the name of a file")
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: cannot be written (it is not an ordinary file)")
    if not target.parent.is_dir():
        raise InputError(f"{path}: cannot be written (there is no directory {target.parent})")
    return target


def _temporary(target: Path) -> Path:
    return target.with_name(f".feedplan-{os.urandom(6).hex()}.part")


def _refusal(path: str | Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error})")

"""Output files: written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from planner.errors import InputError


def require_writable(path: str | Path) -> None:
    """Raise InputError unless a file could be written under this name: to be asked before the work, not after it."""
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: cannot be written (it is a directory); give the name of a file")
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: cannot be written (it is not an ordinary file)")
    if not target.parent.is_dir():
        raise InputError(f"{path}: cannot be written (there is no directory {target.parent})")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written (no permission to write into {target.parent})")


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
    require_writable(path)
    target = Path(os.path.realpath(path))  # a link stays a link: the file behind it is replaced
    temporary = target.with_name(f".feedplan-{secrets.token_hex(6)}.part")
    try:
        with open(temporary, "xb") as file:
            yield file
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        temporary.unlink(missing_ok=True)

"""The C source of the compiled core, and the library that it becomes; needs nothing but Python, for builds import it too.

Every ``.c`` and ``.h`` file below ``planner/`` and ``interp/`` belongs to the core.  A hash of them all is compiled into
the library, so that a library can be told from one of other source.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

ROOMS = ("planner", "interp")
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def library_file(root: Path) -> Path:
    """Where the compiled core stands, below the folder that holds the packages."""
    return root / "planner" / f"_core{_SUFFIX}"


def source_files(root: Path) -> list[Path]:
    """All C files and headers of the core, in one order on every machine."""
    found = [Path(file) for room in ROOMS for file in _below(root / room)]
    return sorted(found, key=lambda file: file.relative_to(root).as_posix())


def _below(folder: Path | str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir() and not entry.name.startswith((".", "__")):
                yield from _below(entry.path)
            elif entry.name.endswith((".c", ".h")):
                yield entry.path


def source_hash(root: Path) -> str:
    """SHA-256 of the names and contents of all source files, hexadecimal; the line ends of a checkout do not count."""
    found = hashlib.sha256()
    for file in source_files(root):
        found.update(file.relative_to(root).as_posix().encode())
        found.update(b"\0")
        found.update(file.read_bytes().replace(b"\r\n", b"\n"))
        found.update(b"\0")
    return found.hexdigest()

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


def core_file(root: Path) -> Path:
    """Where the compiled core stands, below the folder that holds the packages."""
    return root / "planner" / f"_core{_SUFFIX}"


def source_files(root: Path) -> list[Path]:
    """All C files and headers of the core, in one order on every machine."""
    return [root / name for name in _names(root)]


def source_texts(root: Path) -> dict[str, bytes]:
    """What stands in each of them, by its name below the root; the line ends of a checkout do not count."""
    # Read at each start of a command: paths as texts take a third of the time of Path.
    texts = {}
    for name in _names(root):
        with open(f"{root}/{name}", "rb") as file:
            texts[name] = file.read().replace(b"\r\n", b"\n")
    return texts


def source_hash(texts: dict[str, bytes]) -> str:
    """SHA-256 of the names and contents of all source files, hexadecimal."""
    found = hashlib.sha256()
    for name, text in texts.items():
        found.update(b"%s\0%s\0" % (name.encode(), text))
    return found.hexdigest()


def _names(root: Path) -> list[str]:
    return sorted(name for room in ROOMS for name in _below(f"{root}/", room))


def _below(root: str, folder: str) -> Iterator[str]:
    with os.scandir(root + folder) as entries:
        for entry in entries:
            name = entry.name
            if name.endswith((".c", ".h")):
                yield f"{folder}/{name}"
            elif "." not in name and name != "__pycache__" and entry.is_dir():
                yield from _below(root, f"{folder}/{name}")

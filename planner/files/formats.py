"""Which kinds of files of a header and columns there are, by their suffix; ``columns.py`` writes and reads them."""

from __future__ import annotations

from pathlib import Path

from planner.errors import InputError
from planner.inputs import require_path

COLUMN_FORMATS = (".csv", ".npz")
"""The first is meant where a name has no suffix."""
ANY_COLUMN_FORMAT = " or ".join((", ".join(COLUMN_FORMATS[:-1]), COLUMN_FORMATS[-1]))


def file_format(path: str | Path) -> str:
    """Return ``.csv`` (also without a suffix) or ``.npz``; raise InputError for another suffix."""
    suffix = require_path(path).suffix.lower() or COLUMN_FORMATS[0]
    if suffix not in COLUMN_FORMATS:
        raise InputError(f'{path}: the suffix "{suffix}" must be {ANY_COLUMN_FORMAT}')
    return suffix

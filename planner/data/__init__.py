"""What comes with the package: named curves, their facts, and example machines."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def data_text(name: str) -> str:
    """Read a file of the package, named below its folder of data: ``curves/circle.json``."""
    return (FOLDER / name).read_text(encoding="utf-8")

"""Reading figures that were written."""

from __future__ import annotations

import re
from pathlib import Path

from PIL import Image

_MM_PER_INCH, _POINTS_PER_INCH = 25.4, 72.0


def width_of(path: Path) -> float:
    """Width of a figure, mm, as its PNG, PDF or SVG file says it."""
    if path.suffix == ".png":
        with Image.open(path) as image:
            return float(image.width / image.info["dpi"][0] * _MM_PER_INCH)
    content = path.read_bytes()
    pattern = rb"/MediaBox \[ ?0 0 ([0-9.]+)" if path.suffix == ".pdf" else rb'<svg [^>]*width="([0-9.]+)pt"'
    found = re.search(pattern, content)
    assert found, path
    return float(found[1]) / _POINTS_PER_INCH * _MM_PER_INCH

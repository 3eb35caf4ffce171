"""Reading what a command prints."""

from __future__ import annotations

import json
from typing import Any


def strict_json(text: str) -> Any:
    """JSON without the NaN and Infinity that only Python reads."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def flat(text: str) -> str:
    """Text without the line breaks of a terminal."""
    return " ".join(text.split())

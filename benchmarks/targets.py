"""A target and what was measured for it, and a table of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.comparison import markdown

_REACHED = {True: "yes", False: "**no**", None: "-"}


@dataclass(frozen=True)
class Row:
    """One target, and what was measured, by case; where nothing was, ``missing`` says why."""

    what: str
    target: float
    measured: Mapping[str, float]
    missing: str = ""

    @property
    def worst(self) -> float:
        """The largest value: what must keep the target."""
        return max(self.measured.values())

    @property
    def reached(self) -> bool | None:
        """Whether every value keeps the target; None where nothing was measured."""
        return self.worst <= self.target if self.measured else None

    @property
    def text(self) -> str:
        """What was measured, in a cell: the value, or the range and the worst case."""
        if not self.measured:
            return self.missing or "not measured"
        if len(self.measured) == 1:
            return number(self.worst)
        name = next(name for name, value in self.measured.items() if value == self.worst)
        return f"{number(min(self.measured.values()))} to {number(self.worst)} ({name})"


def number(value: float) -> str:
    """Three digits."""
    return f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.3g}"


def table(rows: Sequence[Row], earlier: Mapping[str, str]) -> str:
    """All rows in Markdown; what an earlier run measured, by ``what``, beside them where there is any."""
    heads = ["what", "target", "measured", "reached", *(["earlier"] if earlier else [])]
    cells = [
        [row.what, f"<= {row.target:g}", row.text, _REACHED[row.reached]]
        + ([earlier.get(row.what, "-")] if earlier else [])
        for row in rows
    ]
    return markdown(heads, cells)

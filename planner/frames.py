"""Results as tables: columns for a program, rows for a loop, a data frame where pandas is installed, HTML for a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import namedtuple
from collections.abc import Iterator, Mapping
from typing import Any

from numpy.typing import NDArray

_SHOWN = 5  # rows of a long table at either end, in HTML


class Tabular(ABC):
    """A result that is a table: of nodes, samples, lines, limits or methods.

    Iterated, it gives rows with a name for each column, which is also what makes ``pandas.DataFrame(result)`` work.
    """

    @abstractmethod
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Return every column by name, (n,) arrays: numbers or texts."""

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame``; where pandas is not installed, a dict of the columns."""
        columns = dict(self.columns())
        try:
            import pandas
        except ImportError:
            return columns
        return pandas.DataFrame(columns)

    def __iter__(self) -> Iterator[Any]:
        columns = self.columns()
        row = namedtuple("Row", list(columns))  # type: ignore[misc]  # known here only
        return map(row._make, zip(*(values.tolist() for values in columns.values()), strict=True))

    def __len__(self) -> int:
        """Number of rows."""
        return int(next(iter(self.columns().values())).size)

    def _repr_html_(self) -> str:
        return f"<p>{escaped(repr(self))}</p>{html_table(self.columns())}"


def html_table(columns: Mapping[str, NDArray[Any]]) -> str:
    """Lay columns out for a notebook; of many rows the first and the last."""
    count = int(next(iter(columns.values())).size)
    shown = list(range(count))
    if count > 2 * _SHOWN + 1:
        shown = [*range(_SHOWN), -1, *range(count - _SHOWN, count)]
    head = "".join(f"<th>{escaped(name)}</th>" for name in columns)
    rows = [
        "".join(f"<td>{_cell(values, k)}</td>" for values in columns.values())
        if k >= 0
        else "<td>...</td>" * len(columns)
        for k in shown
    ]
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"


def escaped(text: str) -> str:
    """Text as HTML shows it."""
    from html import escape  # on demand: no command but a page or a notebook needs it

    return escape(text)


def _cell(values: NDArray[Any], row: int) -> str:
    value = values[row]
    return escaped(f"{value:.6g}" if values.dtype.kind == "f" else str(value))

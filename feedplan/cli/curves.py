"""The named curves: ``feedplan curves``.

What is listed stands as data in the package, so that the list is there before a curve could be loaded; a test computes it
again.
"""

from __future__ import annotations

import json
import textwrap
from typing import Any

import click

from planner.data import data_text

_WIDTH = 80  # columns of a terminal
_HEADS = ("name", "axes", "length mm", "u from", "to", "breaks by order")
_NUMBERS = ("length mm", "u from", "to")


@click.command(epilog="\b\nExample:\n  feedplan curves")
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON and nothing else.")
def curves(*, as_json: bool) -> None:
    """List the named curves.

    Breaks are counted by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature, G3 its rate.
    """
    found = curve_facts()
    click.echo(json.dumps(found, indent=2) if as_json else _text(found))


def curve_facts() -> dict[str, dict[str, Any]]:
    """Axes, length, domain, breaks by order and source of every named curve."""
    facts = json.loads(data_text("curve_facts.json"))
    return {name: {**row, "source": _source(name)} for name, row in facts.items()}


def _source(name: str) -> str:
    """Where the definition of a named curve was published."""
    source = json.loads(data_text(f"curves/{name}.json"))["source"]
    if "control_points_from" in source:
        return str(source["control_points_from"])
    return f"{source['authors']}: {source['title']} ({source['year']})"


def _text(found: dict[str, dict[str, Any]]) -> str:
    rows = [
        (
            name,
            " ".join(row["axes"]),
            f"{row['length_mm']:.3f}",
            *(f"{end:.6g}" for end in row["domain"]),
            ", ".join(f"{count} {order}" for order, count in row["breaks"].items()) or "none",
        )
        for name, row in found.items()
    ]
    widths = [max(map(len, column)) for column in zip(_HEADS, *rows, strict=True)]
    lines = [_line(row, widths) for row in (_HEADS, *rows)]
    names: dict[str, list[str]] = {}
    for name, row in found.items():
        names.setdefault(row["source"], []).append(name)
    for source, of in names.items():
        lines += [
            "",
            f"{', '.join(of)}:",
            *textwrap.wrap(source, _WIDTH - 2, initial_indent="  ", subsequent_indent="  "),
        ]
    return "\n".join(lines)


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    placed = [
        cell.rjust(width) if head in _NUMBERS else cell.ljust(width)
        for head, cell, width in zip(_HEADS, cells, widths, strict=True)
    ]
    return "  ".join(placed).rstrip()

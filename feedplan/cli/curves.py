"""The named curves: ``feedplan curves``."""

from __future__ import annotations

import json
from importlib import resources
from typing import TYPE_CHECKING

from feedplan.cli.app import app, exits, show

if TYPE_CHECKING:
    from rich.console import RenderableType

    from planner.geometry.curve import Curve


@app.command(epilog="\b\nExample:\n  feedplan curves")
def curves() -> None:
    """List the named curves.

    Breaks are counted by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature, G3 its rate.
    """
    with exits():
        from planner import CATALOG, load_curve

        show(_curve_list({name: load_curve(name) for name in CATALOG}))


def _curve_list(found: dict[str, Curve]) -> RenderableType:
    from rich.console import Group
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="underline")
    for column in ("name", "axes", "length mm", "u from", "to", "breaks by order"):
        table.add_column(
            column, justify="left" if column in {"name", "axes", "breaks by order"} else "right", no_wrap=True
        )
    sources: dict[str, list[str]] = {}
    for name, curve in found.items():
        u0, u1 = curve.domain
        table.add_row(name, " ".join(curve.axes), f"{curve.length:.3f}", f"{u0:.6g}", f"{u1:.6g}", _smoothness(curve))
        sources.setdefault(_source(name), []).append(name)
    parts: list[RenderableType] = [table, ""]
    for source, names in sources.items():
        parts += [Text(f"{', '.join(names)}:"), Padding(Text(source), (0, 0, 0, 2))]
    return Group(*parts)


def _smoothness(curve: Curve) -> str:
    """Count the breaks by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature."""
    orders = [b.geometric for b in curve.breaks]
    return ", ".join(f"{orders.count(k)} G{k}" for k in range(4) if k in orders) or "none"


def _source(name: str) -> str:
    """Where the definition of a named curve was published."""
    text = resources.files("planner").joinpath(f"data/curves/{name}.json").read_text(encoding="utf-8")
    source = json.loads(text)["source"]
    if "control_points_from" in source:
        return str(source["control_points_from"])
    return f"{source['authors']}: {source['title']} ({source['year']})"

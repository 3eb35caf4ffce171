"""Curves out of drawings (DXF).

A drawing's lines, arcs, ellipses and splines are all rational B-splines, so the chain of them is one, exactly: every piece
is taken apart into Bezier segments, raised to the common degree, and joined with knots as often as the degree; corners then
are corners, and tangent pieces are smooth.

Ends join within 1 um.  Entities that are no longer than this (slivers, zero-length lines and arcs) are absorbed by the joint
in which they lie.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import CurveError
from planner.geometry.drawing.bezier_pieces import joined
from planner.geometry.drawing.drawing_chains import choose_chain, find_chains
from planner.geometry.drawing.drawn_entities import JOIN_MM, DrawingContent, read_entities
from planner.geometry.drawing.entity_numbers import READ
from planner.geometry.nurbs import NurbsCurve
from planner.inputs import require_path, shorten


class DrawnCurve(NurbsCurve):
    """A chain of a drawing as one B-spline.

    Attributes
    ----------
    notes : tuple of str
        Which of several chains it is, what the drawing holds beside paths, what was made of splines without control points.
    """

    notes: tuple[str, ...]

    def __init__(
        self,
        control_points: ArrayLike,
        knots: ArrayLike,
        degree: int,
        weights: ArrayLike,
        name: str,
        notes: tuple[str, ...],
    ) -> None:
        super().__init__(control_points, knots, degree, weights, name=name)
        object.__setattr__(self, "notes", notes)


def read_dxf(path: str | Path, *, layer: str | None = None, chain: int | None = None, scale: float = 1.0) -> DrawnCurve:
    """Read a chain of entities from the model space of a DXF file.

    Read are SPLINE, LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE and HELIX entities, and those of blocks where they are
    inserted.  Texts, points, dimensions and hatches are passed over, which ``notes`` say.  The entities may stand in any
    order and direction; a chain starts with the first in the file that has a free end, the way it is drawn, or with the
    first of all where it is closed.  Ends join within 1 um.

    Parameters
    ----------
    path : str or Path
    layer : str, optional
        Only the entities of this layer.
    chain : int, optional
        Number of the chain, from 1 on, in the order of the file; needed where there are several.
    scale : float
        Multiplies the drawing.

    Returns
    -------
    DrawnCurve
        In mm by the units of the drawing (unitless counts as mm); axes X and Y where the drawing lies at Z = 0.

    Raises
    ------
    CurveError
        If the file cannot be read, holds an entity of another type, or several chains of which none is chosen: they are
        listed.
    """
    file = require_path(path, CurveError)
    if not file.is_file():
        raise CurveError(f"{path}: cannot be read (there is no such file)")
    if layer is not None and not isinstance(layer, str):
        raise CurveError(f"layer = {shorten(repr(layer))} must be the name of a layer of the drawing")
    if chain is not None and (isinstance(chain, bool) or not isinstance(chain, int)):
        raise CurveError(f"chain = {shorten(repr(chain))} must be a whole number, from 1 on")
    drawing = read_entities(file, layer, scale)
    _require_paths(drawing, layer)
    chains = find_chains(drawing.entities, str(path))
    chosen, number = choose_chain(chains, chain, str(path))
    control, knots, degree, weights = joined(chosen.pieces)
    flat = bool((np.abs(control[:, 2]) <= 1e-12 * np.abs(control).max()).all())
    which = (f"chain {number} of {len(chains)}: {chosen}",) if len(chains) > 1 else ()
    return DrawnCurve(control[:, :2] if flat else control, knots, degree, weights, file.stem, which + drawing.notes)


def _require_paths(drawing: DrawingContent, layer: str | None) -> None:
    """Refuse a drawing without any path on its layer."""
    if drawing.entities:
        return
    on_layer = layer is None or any(name.casefold() == layer.casefold() for name in drawing.layers)
    if drawing.layers and on_layer:
        raise CurveError(
            f"{drawing.file}: no entity is longer than {JOIN_MM} mm, within which ends join; are the units right?"
        )
    where = "the model space" if layer is None else f"layer {layer!r}"
    found = [*drawing.notes]
    if drawing.layers:
        found.append(f"the layers with paths are {', '.join(map(shorten, drawing.layers))}")
    raise CurveError(f"{drawing.file}: {where} has no {', '.join(READ)}{''.join(f'; {text}' for text in found)}")

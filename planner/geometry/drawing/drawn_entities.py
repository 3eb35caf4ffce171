"""The entities of a drawing that are paths, in mm: of its model space and of the blocks that it inserts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import MAX_COORDINATE
from planner.geometry.drawing.bezier_pieces import Piece
from planner.geometry.drawing.entity_numbers import PARSER_ERRORS, SKIPPED, numbers_of
from planner.inputs import shorten
from planner.types import FloatArray

JOIN_MM = 1e-3
"""Ends of neighbours lie this close; drawings are written with some 6 to 16 digits."""
_UNITS = {0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 13: 1e-3}  # $INSUNITS to mm; 0 is unitless
_HEADER = re.compile(rb"^[ \t]*2[ \t]*\r?\n[ \t]*HEADER[ \t]*\r?$", re.MULTILINE)
_MAX_ENTITIES = 200_000
_MAX_INSERTIONS = 10_000  # blocks of blocks of blocks would go on
_BLOCK_LAYER = "0"  # what stands on it in a block is on the layer of the block's insertion
_NOTES_SHOWN = 3


@dataclass(frozen=True, eq=False)
class DrawnEntity:
    """A path of a drawing: pieces one after the other, mm."""

    label: str
    layer: str
    pieces: list[Piece]

    @property
    def start(self) -> FloatArray:
        """Where it begins, (3,)."""
        return self.pieces[0].start

    @property
    def end(self) -> FloatArray:
        """Where it ends, (3,)."""
        return self.pieces[-1].end

    @property
    def length(self) -> float:
        """Length, mm."""
        return sum(piece.length for piece in self.pieces)


@dataclass
class DrawingContent:
    """The paths of a drawing; what was passed over; what a person should know of those that were read."""

    file: Path
    entities: list[DrawnEntity] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    remarks: list[str] = field(default_factory=list)
    layers: Counter[str] = field(default_factory=Counter)  # of all paths, whatever layer is asked for

    @property
    def notes(self) -> tuple[str, ...]:
        """What was passed over, and what the paths that were read are, in sentences."""
        parts = [f"{count} {kind}" for kind, count in self.skipped.items()]
        more = [f"and {len(self.remarks) - _NOTES_SHOWN} more"] if len(self.remarks) > _NOTES_SHOWN else []
        said = [*self.remarks[:_NOTES_SHOWN], *more]
        return (*([f"not read: {', '.join(parts)}"] if parts else []), *([", ".join(said)] if said else []))


def read_entities(file: Path, layer: str | None, scale: float) -> DrawingContent:
    """Read the entities of the model space, of one layer or of all; ``scale`` multiplies what they are in mm.

    Raises
    ------
    CurveError
        If the file is no drawing, or an entity is not one that is read.
    """
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    try:
        document = readfile(file)
        code = int(document.header.get("$INSUNITS", 0)) if _has_header(file) else 0
        entities = list(document.modelspace())
    except (DXFError, *PARSER_ERRORS) as problem:
        raise CurveError(f"{file}: not a valid DXF file ({shorten(str(problem))})") from None
    if code not in _UNITS:
        raise CurveError(f"{file}: $INSUNITS = {code} must be one of {', '.join(map(str, _UNITS))} (4 is mm, 1 inch)")
    drawing = DrawingContent(file)
    matrix = np.diag([scale * _UNITS[code]] * 3 + [1.0])
    for found in _flat(entities, drawing, _Insertion(matrix), _Counts()):
        _take(found, drawing, layer)
    return drawing


def _has_header(file: Path) -> bool:
    """Whether a drawing says anything of itself: where it has no section HEADER, ezdxf makes one up, in metres."""
    content = file.read_bytes()
    return content.startswith(b"AutoCAD Binary DXF") or bool(_HEADER.search(content))


@dataclass(frozen=True)
class _Insertion:
    """Where entities stand: the map to the world in mm, (4, 4), the blocks they are in, and the layer of the insertion."""

    matrix: FloatArray
    blocks: tuple[str, ...] = ()
    layer: str = _BLOCK_LAYER


@dataclass
class _Counts:
    """How much was found so far."""

    entities: int = 0
    insertions: int = 0

    def require_few(self, file: Path) -> None:
        """Refuse a drawing of which there is no end."""
        for what, count, most in (
            ("entities", self.entities, _MAX_ENTITIES),
            ("insertions of blocks", self.insertions, _MAX_INSERTIONS),
        ):
            if count > most:
                raise CurveError(f"{file}: more than {most} {what}; split the drawing")


@dataclass(frozen=True)
class _PlacedEntity:
    """An entity of the library, in its place."""

    entity: Any
    kind: str
    label: str
    layer: str
    matrix: FloatArray


def _flat(
    entities: Iterable[Any], drawing: DrawingContent, place: _Insertion, counts: _Counts
) -> Iterator[_PlacedEntity]:
    """All entities, those of inserted blocks in the place of the insertion."""
    for entity in entities:
        counts.entities += 1
        counts.require_few(drawing.file)
        found = _found(entity, drawing, place)
        if found.kind == "INSERT":
            yield from _inserted(found, drawing, place, counts)
        else:
            yield found


def _found(entity: Any, drawing: DrawingContent, place: _Insertion) -> _PlacedEntity:
    try:
        kind, own = str(entity.dxftype()), str(entity.dxf.layer)
        handle = str(entity.dxf.handle)
    except PARSER_ERRORS as problem:
        raise CurveError(f"{drawing.file}: an entity cannot be read ({shorten(str(problem))})") from None
    label = f"{drawing.file}: {kind} #{handle}" + (f" of block {shorten(place.blocks[-1])}" if place.blocks else "")
    layer = place.layer if place.blocks and own == _BLOCK_LAYER else own
    return _PlacedEntity(entity, kind, label, layer, place.matrix)


def _inserted(
    found: _PlacedEntity, drawing: DrawingContent, place: _Insertion, counts: _Counts
) -> Iterator[_PlacedEntity]:
    """The entities of an inserted block, as often as it is inserted."""
    from ezdxf.lldxf.const import DXFError
    from ezdxf.xclip import XClip

    try:
        insert, block = found.entity, found.entity.block()
        clip = XClip(insert)
        clipped = bool(clip.has_clipping_path and clip.is_clipping_enabled)
        name = str(insert.dxf.name)
        copies = insert.multi_insert() if insert.mcount > 1 else iter([insert])
        content = None if block is None else list(block)
        elsewhere = block is not None and bool(block.block.is_xref)
    except (DXFError, *PARSER_ERRORS) as problem:
        raise CurveError(f"{found.label} cannot be read ({shorten(str(problem))}); the file is damaged") from None
    if name in place.blocks:
        raise CurveError(f"{found.label}: block {shorten(name)} inserts itself; delete the insertion in it")
    if clipped:
        raise CurveError(
            f"{found.label}: block {shorten(name)} is shown in part (XCLIP); explode it and trim its paths"
        )
    if content is None or elsewhere:
        where = "is of another drawing; bind it" if elsewhere else "is not in the drawing; delete the insertion"
        raise CurveError(f"{found.label}: block {shorten(name)} {where}")
    for copy in copies:
        try:
            matrix = np.array([list(row) for row in copy.matrix44().rows()], dtype=np.float64)
        except (DXFError, *PARSER_ERRORS) as problem:
            raise CurveError(f"{found.label} cannot be read ({shorten(str(problem))}); the file is damaged") from None
        if not np.isfinite(matrix).all():
            raise CurveError(f"{found.label}: its place, scales and angle must be finite")
        counts.insertions += 1
        counts.require_few(drawing.file)
        yield from _flat(
            content, drawing, _Insertion(matrix @ place.matrix, (*place.blocks, name), found.layer), counts
        )


def _take(found: _PlacedEntity, drawing: DrawingContent, layer: str | None) -> None:
    """Add an entity to the drawing, where it is of the layer that is asked for."""
    wanted = layer is None or found.layer.casefold() == layer.casefold()
    if found.kind in SKIPPED:
        if wanted:
            drawing.skipped[found.kind] += 1
        return
    drawing.layers[found.layer] += 1
    if not wanted:
        return
    drawn = numbers_of(found.entity, found.label)
    pieces = [piece.mapped(found.matrix) for piece in drawn.pieces()]
    if any(not (np.abs(p.points[..., :3]) <= MAX_COORDINATE * p.points[..., 3:]).all() for p in pieces):
        raise CurveError(f"{found.label}: its coordinates must be finite, and lie within {MAX_COORDINATE:g} mm of 0")
    pieces = without_slivers(pieces)
    if drawn.note:
        drawing.remarks.append(f"{found.label.rpartition(': ')[2]} is a {drawn.note}")
    if pieces:
        drawing.entities.append(DrawnEntity(found.label, found.layer, pieces))


def without_slivers(pieces: list[Piece]) -> list[Piece]:
    """Pieces of one entity without those that a joint absorbs; what follows begins where the piece before ends."""
    kept: list[Piece] = []
    here = pieces[0].start if pieces else np.zeros(3)
    for piece in pieces:
        if piece.length <= JOIN_MM and np.linalg.norm(piece.end - here) <= JOIN_MM:
            continue
        kept.append(piece.starting_at(here))
        here = piece.end
    return kept

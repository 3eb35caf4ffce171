"""What one may choose of a figure: its panels and its width; refused here before anything is planned or drawn."""

from __future__ import annotations

from collections.abc import Sequence

from planner.errors import InputError

PLAN_PANELS = ("path", "feed", "velocity", "acceleration", "jerk", "chord", "binding")
COMPARISON_PANELS = ("feed", "jerk")
PAGE_MM = 180.0  # the text width of a two-column page
NARROW_MM = 130.0  # below this, panels stand one under the other
MIN_WIDTH_MM, MAX_WIDTH_MM = (
    80.0,
    420.0,
)  # labels of 7 points of five axes need the one; the other is the long side of A3


def require_width(width_mm: float) -> float:
    """Return the width of a figure, mm; raise InputError where no label would fit, or no page."""
    if not MIN_WIDTH_MM <= width_mm <= MAX_WIDTH_MM:
        raise InputError(
            f"a figure {width_mm:g} mm wide is not possible: allowed is {MIN_WIDTH_MM:g} to {MAX_WIDTH_MM:g} mm; "
            f"a paper's column is often 85, its page {PAGE_MM:g}"
        )
    return float(width_mm)


def panel_names(panels: str | Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of panels, given as a sequence or as text with commas between them.

    Raises
    ------
    InputError
        If a name is not one of those allowed, is given twice, or none is given.
    """
    names = tuple(name.strip() for name in (panels.split(",") if isinstance(panels, str) else panels))
    if not names:
        raise InputError(f"panels: none is given; allowed are {', '.join(allowed)}")
    for k, name in enumerate(names):
        if name not in allowed:
            raise InputError(f'panels: "{name}" is not one of {", ".join(allowed)}')
        if name in names[:k]:
            raise InputError(f'panels: "{name}" is given twice')
    return names

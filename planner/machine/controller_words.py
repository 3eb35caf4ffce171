"""What the file of a controller says of its own planner: no limit of ours, but what a model of that controller needs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ControllerWords:
    """Settings by what they are, mm and s; None where the file does not say.

    Attributes
    ----------
    junction_deviation, arc_tolerance : float, optional
        $11 and $12 of GRBL, mm.
    steps_per_mm : tuple of float, optional
        $100 to $102 of GRBL.
    square_corner_velocity : float, optional
        Of Klipper, mm/s.
    minimum_cruise_ratio : float, optional
        Of Klipper.
    arc_resolution : float, optional
        ``resolution`` in [gcode_arcs] of Klipper, mm.
    max_feed_override : float, optional
        [DISPLAY]MAX_FEED_OVERRIDE of LinuxCNC.
    arc_blend, optimization_depth, gap_cycles, ramp_frequency, kink_ratio : float, optional
        [TRAJ]ARC_BLEND_ENABLE, _OPTIMIZATION_DEPTH, _GAP_CYCLES, _RAMP_FREQ (Hz) and _KINK_RATIO of LinuxCNC.
    """

    junction_deviation: float | None = None
    arc_tolerance: float | None = None
    steps_per_mm: tuple[float, ...] | None = None
    square_corner_velocity: float | None = None
    minimum_cruise_ratio: float | None = None
    arc_resolution: float | None = None
    max_feed_override: float | None = None
    arc_blend: float | None = None
    optimization_depth: float | None = None
    gap_cycles: float | None = None
    ramp_frequency: float | None = None
    kink_ratio: float | None = None

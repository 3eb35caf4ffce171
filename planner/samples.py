"""The samples that a replay makes of a plan: what a controller sends to the drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from planner.frames import Tabular
from planner.geometry.curve import DEFAULT_AXES, ROTARY_AXES
from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class Samples(Tabular):
    """One point a period, as a controller would send them to the drives.

    ``to_frame()`` gives them as a ``pandas.DataFrame`` where pandas is installed, else as a plain dict of arrays; so does
    ``pandas.DataFrame(samples)``.

    Attributes
    ----------
    period : float
        Time between two samples, s.
    t : (m,) array
        Multiples of the period; the last is ceil(duration / period) periods.
    u : (m,) array
        Curve parameter.
    position : (m, dim) array
        Machine axes, mm (rad for rotary axes); the last row is the end of the curve exactly.
    start_feed, end_feed : float
        Feed of the plan at the first and last sample, mm/s.  Where it is 0 the point is held beyond the end; elsewhere
        the path goes on, and a last period cut short by the end of the curve is no motion of the machine's.
    axes : tuple of str
        Names of the machine axes; X, Y, Z, U, V, W if left out.
    """

    period: float
    t: FloatArray
    u: FloatArray
    position: FloatArray
    start_feed: float = 0.0
    end_feed: float = 0.0
    axes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.t, self.u, self.position):
            array.setflags(write=False)
        if not self.axes and self.position.ndim == 2:
            object.__setattr__(self, "axes", DEFAULT_AXES[: self.position.shape[1]])

    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Return the columns of the table of samples, one row a period, by the names they have there."""
        return {"t_s": self.t, "u": self.u, **axis_columns(self.axes, self.position)}

    def __len__(self) -> int:
        """Number of samples."""
        return self.t.size

    def __repr__(self) -> str:
        first, last = (round(feed, 9) + 0.0 for feed in (self.start_feed, self.end_feed))  # no -7e-18
        return (
            f"Samples: {self.t.size}, one every {1e3 * self.period:g} ms until {float(self.t[-1]):.6g} s, of "
            f"{' '.join(self.axes)}\n    feed {first:g} mm/s at the first, {last:g} mm/s at the last"
        )


def axis_columns(axes: tuple[str, ...], position: FloatArray) -> dict[str, FloatArray]:
    """Columns of the machine axes, by name and unit."""
    return {f"{axis}_{'rad' if axis in ROTARY_AXES else 'mm'}": position[:, j] for j, axis in enumerate(axes)}

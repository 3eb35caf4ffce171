"""One colour for every limit, the same in figures and in the page.

A limit is a quantity of an axis, or of the path.  The axis gives the hue, so that it is known again in every panel; the
quantity gives the shade.  The path is an axis too: its velocity is the feed.  What several axes set together is grey, and
so are rapids.

Any two limits are told apart by who sees three hues.  33 limits do not fit into what colour-blind eyes keep apart, so
that is asked only of what one panel may show: one quantity of nine axes and of the path.  Print may be grey: the lines of
a panel differ in their dashes as well, and each lane and each row of a table says its name.
"""

from __future__ import annotations

from planner.geometry.curve import AXES
from planner.quantity import ACCELERATION, JERK, VELOCITY

INK, FAINT = "#222222", "#9a9a9a"
RAPID = "#8c8c8c"
# Okabe and Ito's colours, which stay apart for every kind of colour vision: for lines that are no limits.
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def _by_axis(colours: dict[str, tuple[str, str, str]]) -> dict[str, str]:
    """Name the colours of each axis's velocity, acceleration and jerk."""
    return {what.of(axis): colours[axis][k] for k, what in enumerate((VELOCITY, ACCELERATION, JERK)) for axis in AXES}


# Found by simulated annealing for what the test of this module asks, with a little to spare.  On paper and on white screens.
_ON_LIGHT = {
    "none": "#c9ced3",
    "feed": "#2a71c5",
    "programmed feed": "#000000",
    "rapid": RAPID,
    "chord error": "#389b90",
    "tangential acceleration": "#1a759d",
    "tangential jerk": "#7297cd",
} | _by_axis(
    {
        "X": ("#b98076", "#c30411", "#d87660"),
        "Y": ("#30ce99", "#14c871", "#247638"),
        "Z": ("#c86ab0", "#ff1cb2", "#a01f68"),
        "A": ("#ceaf2c", "#b67600", "#7d5110"),
        "B": ("#0e4f61", "#215185", "#5e6680"),
        "C": ("#c0adef", "#9a72e2", "#472b9c"),
        "U": ("#77a433", "#6c7f32", "#3b4200"),
        "V": ("#eaa2be", "#fa678c", "#791d6e"),
        "W": ("#77b972", "#13a424", "#4f7961"),
    }
)
# On a dark screen.
_ON_DARK = {
    "none": "#454d55",
    "feed": "#2c84c5",
    "programmed feed": "#ffffff",
    "rapid": "#9ca7b0",
    "chord error": "#6da889",
    "tangential acceleration": "#8892c7",
    "tangential jerk": "#bed9ff",
} | _by_axis(
    {
        "X": ("#8e4049", "#fca2a2", "#f39c72"),
        "Y": ("#80b769", "#78fcaa", "#76fe80"),
        "Z": ("#9d4faa", "#ed52ba", "#e99ed4"),
        "A": ("#b28245", "#e99c11", "#e0d597"),
        "B": ("#13a49e", "#23889e", "#9adbca"),
        "C": ("#8261eb", "#7085fc", "#378ced"),
        "U": ("#7a7d10", "#bec852", "#4db902"),
        "V": ("#d84959", "#e4748c", "#be9091"),
        "W": ("#52642d", "#3dae3e", "#6fd7a7"),
    }
)
_DASHES: dict[str, tuple[float, ...]] = {
    "X": (),
    "Y": (7.0, 1.0),
    "Z": (3.5, 1.0),
    "A": (7.0, 1.0, 1.5, 1.0),
    "B": (1.6, 1.0),
    "C": (4.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    "U": (10.0, 1.0),
    "V": (2.4, 0.7, 1.0, 0.7),
    "W": (10.0, 1.0, 3.0, 1.0),
    "tangential": (0.9, 0.9),
}


def limit_colour(name: str, *, dark: bool = False) -> str:
    """Colour of a limit as #rrggbb: "feed", "chord error", "tangential jerk", "acceleration X", ...; "none" has one too."""
    return (_ON_DARK if dark else _ON_LIGHT)[name]


def dash_lengths(name: str) -> tuple[float, ...]:
    """Lengths of dashes and gaps of a limit's line, in widths of the line, by its axis; () is a solid line."""
    axis = name.rpartition(" ")[2]
    return _DASHES.get("tangential" if name.startswith("tangential ") else axis, ())


def line_dashes(name: str) -> str | tuple[float, tuple[float, ...]]:
    """The same for matplotlib."""
    lengths = dash_lengths(name)
    return (0.0, lengths) if lengths else "-"

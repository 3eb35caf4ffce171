"""A small plan as a feedrate table; its lines in CSV, changed and sealed again."""

import numpy as np
from motions import plan_along, scurve

from planner import FeedrateProfile, Limits, load_curve
from planner.files.columns import digest_of_lines, digest_of_rows

COLUMNS = ("t", "u", "u_rate", "u_acceleration", "s", "feed", "acceleration", "jerk", "binding")
CIRCLE = load_curve("circle")
LIMITS = Limits(100.0, [250.0, 300.0], [1000.0, np.inf], [20000.0, 1e-3], chord_error=1e-3, period=2e-3)


def small_plan(count=12):
    """Nodes on the circle, and the double one at its knot."""
    motion = scurve(CIRCLE.length, 100.0, 1000.0, 20000.0)
    return plan_along(CIRCLE, motion, LIMITS, np.linspace(0.0, motion.duration, count))


def first_row(lines):
    """Index of the first line with numbers."""
    return next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1


def sealed(lines):
    """The lines of a table with the seals of what they say: a lie that is not given away by them."""
    at = first_row(lines)
    header = dict(
        line[2:].rstrip("\n").split(" = ", 1) if " = " in line else (line[2:-3], "") for line in lines[: at - 1]
    )
    names, rows = lines[at - 1].rstrip("\n").split(","), [line.rstrip("\n").split(",") for line in lines[at:]]
    words = header["limit_names"].split(", ")
    columns = []
    for name, cells in zip(names, zip(*rows, strict=True), strict=True):
        binding = name == "binding"
        columns.append(np.array([words.index(c) for c in cells], np.int8) if binding else np.array(cells, np.float64))
    header["rows_sha256"] = digest_of_rows(columns)
    header["header_sha256"] = digest_of_lines(header)
    return [*(f"# {key} = {value}\n" for key, value in header.items()), *lines[at - 1 :]]


def with_cell(lines, row, column, text):
    """The lines with one cell replaced; row 0 is the first."""
    at = first_row(lines) + row
    cells = lines[at].rstrip("\n").split(",")
    cells[lines[first_row(lines) - 1].rstrip("\n").split(",").index(column)] = text
    return [*lines[:at], ",".join(cells) + "\n", *lines[at + 1 :]]


def same_bits(one: FeedrateProfile, other: FeedrateProfile) -> bool:
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes()
        and getattr(one, name).dtype == getattr(other, name).dtype
        for name in COLUMNS
    )

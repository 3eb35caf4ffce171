"""The lines of a feedrate table in CSV, changed and sealed again."""

import numpy as np

from planner.files.columns import digest_of_lines, digest_of_rows


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

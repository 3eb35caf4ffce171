"""The times of the lines of a part program as a file: CSV or NPZ, a row a line, with the text of the line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from planner.programs.program_text import ProgramText
from planner.programs.times import KINDS, LineTimes

FORMAT = "feedplan-lines 2"
_UNITS = "mm, s, degrees; share is the part of the line's time for which the limit beside it holds it back"


def write_line_times(
    path: str | Path,
    times: LineTimes,
    source: str,
    verdict: str,
    *,
    without_jerk: LineTimes | None = None,
    text: ProgramText | None = None,
) -> None:
    """Write the lines as CSV or NPZ, a row each.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (also without a suffix) or ``.npz``.
    times : LineTimes
    source : str
        Name of the program, for the header.
    verdict : str
        What the check says of the plan, for the header.
    without_jerk : LineTimes, optional
        The same lines planned without a jerk limit: a column more.
    text : ProgramText, optional
        Of the program: two columns more, the N words and the lines.

    Raises
    ------
    InputError
        If the file cannot be written; then none is left behind.
    """
    from planner.files.columns import write_columns

    columns = times.columns() | {"kind": times.kind, "held_back_by": times.binding}  # as indices into words
    header = {
        "format": FORMAT,
        "units": _UNITS,
        "program": " ".join(source.split()),
        "verdict": verdict,
        "total_s": repr(times.total),
        "seconds": repr(times.moving),
        "dwell_s": repr(times.dwelling),
        "tool_changes": str(times.changes),
    }
    if without_jerk is not None:
        columns["without_jerk_limit_s"] = without_jerk.seconds
        header["without_jerk_limit_s"] = repr(without_jerk.moving)
    if text is not None:
        lines = times.line.tolist()
        columns["n_word"] = np.array([text.number_word(line) for line in lines], dtype=object)
        columns["text"] = np.array([text.shown(line) for line in lines], dtype=object)
    header["rows"] = str(times.line.size)
    write_columns(path, header, columns, {"kind": KINDS, "held_back_by": times.limit_names})

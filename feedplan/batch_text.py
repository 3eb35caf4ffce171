"""The times of many part programs as a person reads them, as JSON, and as a file of rows."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from feedplan.batch import UnfinishedError
from feedplan.batch_times import TimeRow, TimeRows
from feedplan.layout import BOLD, RED, Cell, indented, named, styled, table
from feedplan.time_text import clock
from planner.errors import InputError
from planner.files.formats import file_format
from planner.files.whole_file import whole_file

_LEFT = ("program", "machine", "change", "held back by", "verdict")


def rows_text(found: TimeRows, notes: Sequence[str], file: str = "") -> list[str]:
    """Lay out a row each, the total, and below them why rows have no time; ``file`` is what was written."""
    rows = found.rows
    columns: dict[str, list[str | Cell]] = {"program": [row.case.file.label for row in rows]}
    columns |= _number_columns(rows)
    columns |= {"held back by": [_held_by(row) for row in rows], "share": [_share(row) for row in rows]}
    columns["verdict"] = [_verdict(row) for row in rows]
    lines = table(list(columns), list(zip(*columns.values(), strict=True)), left=_LEFT)
    names = [row.case.file.label for row in rows]
    lines += ["", *total_lines(found), *reason_lines(rows, names), *note_lines(rows, names, notes)]
    return lines + (named("written", file) if file else [])


def _number_columns(rows: Sequence[TimeRow]) -> dict[str, list[str | Cell]]:
    """Total and motion, and what no row has is left out."""
    times = [row.time for row in rows]
    columns: dict[str, list[str | Cell]] = {
        "total\nh:mm:ss": ["" if time is None else Cell(clock(time.total_s), BOLD) for time in times],
        "motion\ns": ["" if time is None else f"{time.motion_s:.2f}" for time in times],
    }
    if any(time is not None and time.dwell_s for time in times):
        columns["dwells\ns"] = ["" if time is None or not time.dwell_s else f"{time.dwell_s:.2f}" for time in times]
    if any(time is not None and time.tool_changes for time in times):
        columns["tool\nchanges"] = [
            "" if time is None or not time.tool_changes else str(time.tool_changes) for time in times
        ]
    return columns


def total_lines(found: TimeRows) -> list[str]:
    """What all of them take together, and how many that are."""
    timed = [row.time for row in found.rows if row.time is not None]
    count = len(found.rows)
    of = f"{count} programs" if len(timed) == count else f"{len(timed)} of {count} programs"
    of = of if count != 1 else of[:-1]
    total = math.fsum(time.total_s for time in timed)
    lines = named("total", f"{clock(total)} or {total:.6g} s, {of}", BOLD)
    unknown = sum(time.tool_changes for time in timed if time.tool_change_s is None)
    if unknown:
        lines += named("tool changes", f"{unknown} are not in it, for nobody says how long one takes: --tool-change-s")
    if found.interrupted:
        lines += named("interrupted", "what is missing was not timed")
    return lines


def reason_lines(rows: Sequence[TimeRow], names: Sequence[str]) -> list[str]:
    """Why rows have no time, or which limit a plan breaks; ``names`` is what to call each."""
    lines: list[str] = []
    for row, name in zip(rows, names, strict=True):
        if not row.ok:
            broken = "" if row.time is None else "LIMIT BROKEN  "
            text = row.reason if row.reason.startswith(f"{name}:") else f"{name}: {broken}{row.reason}"
            lines += [styled(line, RED) for line in indented(text)]
    return lines


def note_lines(rows: Sequence[TimeRow], names: Sequence[str], notes: Sequence[str]) -> list[str]:
    """What a person should know: of the folders, and of the programs, the same once."""
    said: dict[str, list[str]] = {}
    for row, name in zip(rows, names, strict=True):
        for note in row.time.notes if row.time is not None else ():
            said.setdefault(note, []).append(name)
    texts = list(notes)
    for note, of in said.items():
        texts.append(f"{of[0] if len(of) == 1 else f'{of[0]} and {len(of) - 1} more'}: {note}")
    return [line for text in texts for line in named("note", text)]


def _held_by(row: TimeRow) -> str:
    return "" if row.time is None else row.time.held_by or "no limit"


def _share(row: TimeRow) -> str:
    return "" if row.time is None or not row.time.held_by else f"{100.0 * row.time.share:.0f}%"


def _verdict(row: TimeRow) -> Cell:
    return Cell("ok") if row.ok else Cell(verdict_word(row), RED)


def verdict_word(row: TimeRow) -> str:
    """What became of a row, in two words."""
    if row.time is not None:
        return "ok" if row.ok else "limit broken"
    words = {InputError: "bad input", UnfinishedError: "not done"}
    return next((word for kind, word in words.items() if isinstance(row.error, kind)), "no plan")


# ---- JSON and files ------------------------------------------------------------------------------------------------


def row_facts(row: TimeRow) -> dict[str, Any]:
    """A row as plain values; None is not known."""
    time = row.time
    return {
        "program": row.case.file.label,
        "file": str(row.case.file.path),
        "machine": row.case.machine.label,
        "tolerance_mm": row.case.tolerance,
        **{f"scale_{name}": factor for name, factor in row.case.scales},
        "ok": row.ok,
        "total_s": None if time is None else time.total_s,
        "motion_s": None if time is None else time.motion_s,
        "dwell_s": None if time is None else time.dwell_s,
        "tool_changes": None if time is None else time.tool_changes,
        "tool_change_s": None if time is None else time.tool_change_s,
        "held_back_by": None if time is None else time.held_by or "none",
        "share": None if time is None else time.share,
        "verdict": verdict_word(row),
        "reason": row.reason,
    }


def rows_facts(found: TimeRows) -> list[dict[str, Any]]:
    """All rows as plain values."""
    return list(map(row_facts, found.rows))


def rows_json(found: TimeRows, notes: Sequence[str], facts: Sequence[dict[str, Any]]) -> str:
    """All rows as JSON; ``facts`` are those of the rows."""
    timed = [row.time.total_s for row in found.rows if row.time is not None]
    return json.dumps(
        {
            "ok": all(row.ok for row in found.rows),
            "count": len(found.rows),
            "timed": len(timed),
            "total_s": math.fsum(timed),
            "interrupted": found.interrupted,
            "notes": list(notes),
            "programs": list(facts),
        },
        indent=2,
        allow_nan=False,
    )


def _array_cells(values: Sequence[Any]) -> list[Any]:
    """The cells of a column as numbers, nan where one is not known, or as texts."""
    if any(isinstance(value, str) for value in values):
        return ["" if value is None else str(value) for value in values]
    return [math.nan if value is None else float(value) for value in values]


def write_rows(path: Path, facts: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV, where what is not known is empty, or as NPZ, where it is nan and texts are arrays of texts.

    Raises InputError if the file cannot be written; then none is left behind.
    """
    from planner.files.archive import write_arrays

    with whole_file(path) as file:
        if file_format(path) == ".npz":
            import numpy as np

            write_arrays(file, {key: np.array(_array_cells([row[key] for row in facts])) for key in facts[0]})
        else:
            text = io.StringIO()
            writer = csv.DictWriter(text, list(facts[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows({key: "" if value is None else value for key, value in row.items()} for row in facts)
            file.write(text.getvalue().encode("utf-8", "backslashreplace"))

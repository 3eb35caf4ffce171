"""A plan as one page for a browser: the path coloured by feed, played back, what it uses of its limits, and the verdict.

The page is one file that loads nothing: style, program and numbers are inside it (``page.html`` is its template).
Its size is bounded: the plan is thinned out to the extremes of as many buckets of time as fit
(:mod:`planner.output.traces`), and of very long programs neighbouring lines share an entry.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from feedplan.playback import Playback, PlayedLines
from feedplan.tolerances import ToleranceTime, tolerance_facts
from feedplan.verdict import Verdict, to_json
from planner.errors import InputError
from planner.files.whole_file import require_writable, whole_file
from planner.inputs import require_instance, require_path
from planner.machine.feed_limits import COMMANDS
from planner.output.palette import dash_lengths, limit_colour
from planner.output.traces import PlanTraces, Traces, trace_chord_error, trace_plan
from planner.profile import FeedrateProfile
from planner.quantity import ACCELERATION, JERK

if TYPE_CHECKING:
    from feedplan.slow_corner import SlowCorner
    from planner.programs.times import LineTimes

_SUFFIXES = (".html", ".htm")
# Base64 makes 4 bytes of 3, so the page stays below 7 MB of traces, 0.9 of chords, 0.7 of frames, 4.9 of lines and their
# text, and what the rest takes.
_TRACE_BYTES = 5_200_000
_MAX_POINTS = 60_000  # of a plan that needs no thinning out; more make a page slow to send, and no clearer
_MAX_CHORDS = 40_000
_MAX_FRAMES = 20_000  # of the playback; more than one a pixel of any path that a screen shows
_MAX_LINES = 200_000  # entries of the line at each time
_LINE_BYTES = 20  # of such an entry: first and last line, time, feed, and the number of its text
_LINES_BYTES = 4_900_000  # of them all in the page, with their text
_TOP_LINES = 1000  # rows of the table of lines
_DTYPES = {"float64": "<f8", "float32": "<f4", "int32": "<i4", "int8": "|i1"}


def write_report(
    path: str | Path,
    verdict: Verdict,
    *,
    lines: LineTimes | None = None,
    played: PlayedLines | None = None,
    tolerances: Sequence[ToleranceTime] = (),
    corner: SlowCorner | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Write a plan and the verdict on it as one HTML page, whole or not at all.

    Parameters
    ----------
    path : str or Path
        Ends in .html or .htm.  At most 15 MB, whatever the plan's size.
    verdict : Verdict
        The plan, its limits, its samples and what was found about both.
    lines : LineTimes, optional
        Of a part program, for this plan; the page then shows the line at every time, and which lines take longest.
    played : PlayedLines, optional
        The same lines in the order of the run; the playback then shows their text and programmed feed too.
    tolerances : sequence of ToleranceTime
        What :func:`time_of_tolerances` found for a part program; the page then shows time against tolerance.
    corner : SlowCorner, optional
        The corner of a part program that the page shows close.
    progress : callable
        Is told what is being done.

    Raises
    ------
    InputError
        If the suffix is another one, the file cannot be written, the lines are those of another plan, or tolerances are
        given for what is no part program.
    """
    require_instance(verdict, Verdict, "verdict")
    require_report(path)
    profile, limits = verdict.profile, verdict.limits
    curve = profile.curve
    if lines is not None and lines.limit_names != profile.limit_names:
        raise InputError(
            f"the lines are of another plan than {curve.name}: their limits are {', '.join(lines.limit_names)}"
        )
    if played is not None and lines is None:
        raise InputError(f"the lines of {curve.name} are to be played, but their times are not given")
    bought = _tolerance_facts(verdict, tolerances) if tolerances else None
    progress("evaluating the plan for the report")
    traces = trace_plan(curve, limits, profile, _most_points(curve.dim, curve.tip.dim))
    chords = trace_chord_error(curve, verdict.samples, _MAX_CHORDS)
    facts = json.loads(to_json(verdict)) | {
        "version": _version(),
        "tip_axes": list(curve.tip.axes),
        "limit_names": list(profile.limit_names),
        "colours": {name: [limit_colour(name), limit_colour(name, dark=True)] for name in _coloured(profile)},
        "dashes": {name: list(dash_lengths(name)) for name in _coloured(profile)},
        "limits": {
            # by the names of the traces, which are along the path
            "feed": _finite(limits.feed),
            "acceleration": _finite(float(limits.of_motions(ACCELERATION.order)[-1])),
            "jerk": _finite(float(limits.of_motions(JERK.order)[-1])),
            "chord error": _finite(limits.chord_error),
        },
        "plan": _trace_facts(traces) | _place_facts(traces),
        "chords": _trace_facts(chords),
        "playback": _playback_facts(Playback.of(profile, _MAX_FRAMES)),
        "origin": [list(pair) for pair in verdict.facts],
        "lines": None if lines is None else _line_facts(lines, played, profile),
        "tolerances": bought,
        "corner": None if corner is None else _corner_facts(corner),
    }
    progress(f"writing {path}")
    with whole_file(path) as file:
        file.write(_page(facts).encode())


def _coloured(profile: FeedrateProfile) -> tuple[str, ...]:
    """What has a colour of its own in the page."""
    return tuple(dict.fromkeys((*profile.limit_names, *COMMANDS)))


def require_report(path: str | Path) -> None:
    """Raise InputError unless a report can be written under this name."""
    suffix = require_path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(f'{path}: the suffix "{suffix}" must be .html or .htm')
    require_writable(path)


def _version() -> str:
    from planner.version import __version__

    return __version__


def _most_points(dim: int, tip_dim: int) -> int:
    """How many buckets fit: t, u, s, binding, rapid and position each, and two values a quantity."""
    return min(_MAX_POINTS, _TRACE_BYTES // (8 + 8 + 4 + 1 + 1 + 4 * tip_dim + 2 * 4 * (6 + 3 * dim)))


# --- numbers --------------------------------------------------------------------------------------------------------


def _packed(values: NDArray[Any]) -> dict[str, str]:
    """An array as the page reads it: little-endian bytes in base64."""
    data = np.ascontiguousarray(values, dtype=_DTYPES[values.dtype.name]).tobytes()
    return {"type": values.dtype.name, "data": base64.b64encode(data).decode("ascii")}


def _trace_facts(traces: Traces) -> dict[str, Any]:
    return {
        "thinned": traces.thinned,
        "t": _packed(traces.t),
        "low": {name: _packed(values) for name, values in traces.low.items()},
        "high": {name: _packed(values) for name, values in traces.high.items()} if traces.thinned else None,
    }


def _place_facts(traces: PlanTraces) -> dict[str, Any]:
    return {
        "u": _packed(traces.u),
        "s": _packed(traces.s.astype(np.float32)),
        "position": [_packed(column.astype(np.float32)) for column in traces.position.T],
        "binding": _packed(traces.binding),
        "rapid": _packed(traces.rapid.astype(np.int8)) if traces.rapid.any() else None,
    }


def _playback_facts(frames: Playback) -> dict[str, Any]:
    return {
        "t": _packed(frames.t),
        "position": [_packed(column.astype(np.float32)) for column in frames.position.T],
        "feed": _packed(frames.feed.astype(np.float32)),
        "position_error_mm": frames.position_error,
        "feed_error_mm_s": frames.feed_error,
    }


def _line_facts(lines: LineTimes, played: PlayedLines | None, profile: FeedrateProfile) -> dict[str, Any]:
    """The line at each time, of very many lines the first and last of each group; and the lines that take longest."""
    from planner.programs.times import KINDS, times_at

    line, start = (lines.line, times_at(profile, lines.u_start)) if played is None else (played.line, played.start)
    group = max(1, -(-line.size // _MAX_LINES))
    first = np.arange(0, line.size, group)
    last = np.minimum(first + group, line.size) - 1
    top = np.argsort(-(lines.seconds + lines.dwell), kind="stable")[:_TOP_LINES]
    return {
        "count": int(lines.line.size),
        "seconds": lines.moving,
        "dwell": lines.dwelling,
        "tool_changes": lines.changes,
        "group": group,
        "first": _packed(line[first].astype(np.int32)),
        "last": _packed(line[last].astype(np.int32)) if group > 1 else None,
        # Differences keep their digits in single precision where the times of a long program would not.
        "step": _packed(np.diff(start[first], prepend=0.0).astype(np.float32)),
        "feed": None if played is None or group > 1 else _packed(played.feed.astype(np.float32)),
        "text": None if played is None or group > 1 else _text_facts(played),
        "top": {
            "line": lines.line[top].tolist(),
            "kind": [KINDS[kind] for kind in lines.kind[top]],
            "start": times_at(profile, lines.u_start[top]).tolist(),
            "end": times_at(profile, lines.u_end[top]).tolist(),
            "seconds": lines.seconds[top].tolist(),
            "length": lines.length[top].tolist(),
            "binding": lines.binding[top].tolist(),
            "share": lines.share[top].tolist(),
            "dwell": lines.dwell[top].tolist(),
        },
    }


def _text_facts(played: PlayedLines) -> dict[str, Any] | None:
    """Text and N word of each line by its number; None where they are longer than there is room for."""
    facts = {"number": _packed(played.number.astype(np.int32)), "text": played.texts(), "n_word": played.n_words()}
    room = _LINES_BYTES - 4 * played.line.size * _LINE_BYTES // 3
    return facts if len(_numbers([facts["text"], facts["n_word"]])) <= room else None


def _corner_facts(slow: SlowCorner) -> dict[str, Any]:
    """A corner as a picture, and what to say of it."""
    from planner.output.corner_view import plot_corner
    from planner.output.figures import svg_of

    picture = base64.b64encode(svg_of(plot_corner(slow.corner))).decode("ascii")
    return {
        "lines": slow.lines,
        "lost_s": slow.lost,
        "turn": slow.corner.turn,
        "picture": f"data:image/svg+xml;base64,{picture}",
    }


def _tolerance_facts(verdict: Verdict, tolerances: Sequence[ToleranceTime]) -> dict[str, Any]:
    """What the plan takes within its own tolerance and within others, from the smallest to the largest."""
    now = ToleranceTime.of(verdict.program, verdict.profile, verdict.plan_report)
    rows = sorted(tolerances, key=lambda row: row.tolerance)
    return {"now": tolerance_facts(now, [now])[0], "rows": tolerance_facts(now, rows)}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


# --- page -----------------------------------------------------------------------------------------------------------


def _page(facts: dict[str, Any]) -> str:
    """Put title and numbers into the template; no name can end the element it stands in."""
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    before, between, after = _split(template, "{{title}}", "{{facts}}")
    return "".join((before, html.escape(facts["curve"]["name"]), between, _numbers(facts), after))


def _numbers(facts: Any) -> str:
    """JSON that no name in it can end."""
    return json.dumps(facts, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _split(text: str, *marks: str) -> list[str]:
    parts = []
    for mark in marks:
        part, _, text = text.partition(mark)
        parts.append(part)
    return [*parts, text]

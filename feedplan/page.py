"""A plan as one page for a browser: the path coloured by feed, what it uses of its limits over time, and the verdict.

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
# Base64 makes 4 bytes of 3, so the page stays below 8.3 + 0.9 + 4 MB and what the text takes.
_TRACE_BYTES = 6_200_000
_MAX_POINTS = 60_000  # of a plan that needs no thinning out; more make a page slow to send, and no clearer
_MAX_CHORDS = 40_000
_MAX_LINES = 250_000  # entries of the line at each time
_TOP_LINES = 1000  # rows of the table of lines
_DTYPES = {"float64": "<f8", "float32": "<f4", "int32": "<i4", "int8": "|i1"}


def write_report(
    path: str | Path,
    verdict: Verdict,
    *,
    lines: LineTimes | None = None,
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
        "origin": [list(pair) for pair in verdict.facts],
        "lines": None if lines is None else _line_facts(lines, profile),
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


def _line_facts(lines: LineTimes, profile: FeedrateProfile) -> dict[str, Any]:
    """The line at each time, of very many lines the first and last of each group; and the lines that take longest."""
    from planner.programs.times import KINDS, times_at

    group = max(1, -(-lines.line.size // _MAX_LINES))
    first = np.arange(0, lines.line.size, group)
    last = np.minimum(first + group, lines.line.size) - 1
    start = times_at(profile, lines.u_start[first])
    top = np.argsort(-(lines.seconds + lines.dwell), kind="stable")[:_TOP_LINES]
    return {
        "count": int(lines.line.size),
        "seconds": lines.moving,
        "dwell": lines.dwelling,
        "tool_changes": lines.changes,
        "group": group,
        "first": _packed(lines.line[first].astype(np.int32)),
        "last": _packed(lines.line[last].astype(np.int32)) if group > 1 else None,
        # Differences keep their digits in single precision where the times of a long program would not.
        "step": _packed(np.diff(start, prepend=0.0).astype(np.float32)),
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
    numbers = json.dumps(facts, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    before, between, after = _split(template, "{{title}}", "{{facts}}")
    return "".join((before, html.escape(facts["curve"]["name"]), between, numbers, after))


def _split(text: str, *marks: str) -> list[str]:
    parts = []
    for mark in marks:
        part, _, text = text.partition(mark)
        parts.append(part)
    return [*parts, text]

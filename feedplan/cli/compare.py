"""The literature's interpolators beside the planner, on one curve: ``feedplan compare``."""

from __future__ import annotations

import csv
import io
import json
import math
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, NO_PLAN, notice, require_apart, require_figure, require_outputs
from feedplan.cli.streams import Streams
from feedplan.job import load_job
from feedplan.sources import is_program
from planner.errors import InputError
from planner.files.whole_file import require_writable, whole_file

if TYPE_CHECKING:
    from feedplan.comparison import Comparison
    from feedplan.comparison.judgement import Judgement
    from feedplan.comparison.result import Result
    from planner.geometry.curve import Curve
    from planner.geometry.tolerance import PathKind, PathSide
    from planner.machine.limits import Limits
    from planner.output.panels import Panel
    from planner.types import FloatArray

FIGURE_TITLE = "the same limits for all (! breaks some of them)"
_FORMATS = (".json", ".csv")
_WIDTH = 80  # columns of a terminal
_COLUMNS = 600  # of a panel; each shows the largest value it covers
# Panels of the figure: title, methods drawn in it beside the optimal plan.
_FAMILIES = (
    ("Algorithms 1-4 (2022)", ("algorithm-1", "algorithm-2", "algorithm-2-soft", "algorithm-4")),
    ("feed shapes (2002)", ("2002-trapezoid-2", "2002-bell-2", "2002-bell-steady")),
    ("look-ahead (2007)", ("2007-printed", "2007-uniform")),
    ("planned", ("toppra", "scurve", "nlp")),
)
_BROAD, _SLIM = 1.8, 0.7  # points: the optimum shows below a line that coincides with it
_FLOOR = 1e-3  # of a limit; less is drawn as this


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan compare teardrop --machine mill.toml\n"
        "  feedplan compare butterfly --scale 10 --methods algorithm,scurve,optimal -o result.csv --plot result.png\n"
    ),
)
@options.curve
@options.machine
@options.scale
@options.layer
@options.chain
@options.tools
@options.ignore
@options.commanded_feed
@options.period
@options.reader
@options.path_to_compare
@options.side
@options.controllers
@options.controller_settings
@click.option("--methods", metavar="A,B,...", help="Names, or their beginnings: algorithm, 2002, 2007, scurve.")
@click.option("--output", "-o", type=options.FILE, help="Result, .json or .csv.")
@click.option("--plot", type=options.FILE, help="Figure, .png, .pdf or .svg.")
@click.option("--panels", metavar="A,B", help="Of the figure: feed, jerk.")
@options.plot_width
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON and nothing else.")
def compare(
    curve: str,
    *,
    machine: str | None,
    complete: dict[str, float],
    scale: float,
    layer: str | None,
    chain: int | None,
    tools: Path | None,
    ignore: tuple[str, ...],
    feed_mm_s: float | None,
    period_s: float | None,
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    controllers: tuple[str, ...],
    controller_settings: tuple[str, ...],
    methods: str | None,
    output: Path | None,
    plot: Path | None,
    panels: str | None,
    width_mm: float | None,
    as_json: bool,
) -> None:
    """Compare the literature's interpolators with the optimal plan.

    All of them run on the same curve under the same limits, and are judged alike.  Of a part program a row more has the
    optimal plan on the path that is found together with its feed, and others have what models of other controllers do: all
    of them unless --methods or --controller names some.  Exit code 1: the optimal plan breaks a limit, or without
    it every method does.
    """
    with Streams() as at:
        curve, output = at.curve(curve), at.output(output, ".csv")
        require_apart([output, plot], [curve, machine])
        if output is not None:
            _require_format(output)
            require_writable(output)
        require_outputs(None, plot)
        from planner.output.panel_choice import COMPARISON_PANELS, PAGE_MM

        drawing = require_figure(plot, panels, width_mm, COMPARISON_PANELS)
        given: dict[str, Any] = {
            "complete": complete, "scale": scale, "feed": feed_mm_s, "period": period_s, "tools": tools, "ignore": ignore,
            "reader": reader, "layer": layer, "chain": chain,
        }  # fmt: skip
        chosen = _controllers(curve, controllers, controller_settings, every=methods is None)
        one_side = side not in (None, "both")
        kind = "separate" if path is None and not one_side and is_program(curve) else path
        job = load_job(curve, machine, path=kind, side=side, notice=notice, **given)
        from feedplan.comparison import compare as compare_methods
        from feedplan.comparison import run_method
        from feedplan.comparison.controller_rows import with_controllers
        from feedplan.comparison.methods import OPTIMUM
        from feedplan.comparison.two_paths import with_other_path
        from feedplan.progress import ProgressLine

        with ProgressLine() as line:
            found = compare_methods(job.curve, job.limits, methods, progress=line)
            line("the other path of the program")
            rows = with_other_path(
                found.results,
                job,
                lambda kind: load_job(curve, machine, path=kind, side=side, **given),
                lambda other: run_method(OPTIMUM, other.curve, other.limits),
            )
            line("models of controllers")
            found = replace(found, results=with_controllers(rows, job, chosen))
            facts = _facts(found, job.machine)
            if output is not None:
                line(f"writing {output}")
                _write(output, facts)
            if plot is not None and any(result.judgement for result in found.results):
                from planner.output.figures import save_plot
                from planner.output.panels import plot_panels

                line(f"drawing {plot}")
                shown = drawing.get("panels", COMPARISON_PANELS)
                width = drawing.get("width_mm", PAGE_MM)
                drawn = comparison_panels(found, shown)
                title = f"{found.curve.name}: {FIGURE_TITLE}"
                save_plot(plot, plot_panels(title, drawn, columns=len(shown), width_mm=width))
        if as_json:
            click.echo(_json(facts), err=at.taken)
        else:
            files = [at.told(str(name)) for name in (output, plot) if name is not None and name.exists()]
            click.echo(_text(found, job.machine, files), err=at.taken)
        _leave(found.results)


def _controllers(
    curve: str, names: Sequence[str], settings: Sequence[str], *, every: bool
) -> dict[str, dict[str, float]]:
    """Controllers to compare with: those that are named, or of a part program all."""
    from feedplan.controller_time import ALL, chosen_controllers

    if is_program(curve):
        return chosen_controllers(names or ((ALL,) if every else ()), settings)
    if names or settings:
        raise InputError(f"--controller is for part programs; {curve} is none")
    return {}


def _leave(results: Sequence[Result]) -> None:
    """Leave with an exit code other than 0 where the comparison found nothing that holds."""
    from feedplan.comparison.methods import OPTIMUM

    if all(result.judgement is None for result in results):
        raise click.exceptions.Exit(NO_PLAN)
    meant = [result for result in results if result.method == OPTIMUM] or results
    if not any(result.ok for result in meant):
        raise click.exceptions.Exit(BROKEN)


def _require_format(path: Path) -> None:
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f'{path}: the suffix "{path.suffix}" must be one of {", ".join(_FORMATS)}')


# ---- files ---------------------------------------------------------------------------------------------------------


def _facts(found: Comparison, machine: str) -> dict[str, Any]:
    from feedplan.comparison import NOTE
    from feedplan.comparison.result import result_facts, saving_facts
    from feedplan.comparison.two_paths import joint_saving

    curve, limits = found.curve, found.limits
    return {
        "curve": {"name": curve.name, "hash": curve.fingerprint, "axes": list(curve.axes), "length_mm": curve.length},
        "machine": machine,
        "feed_mm_s": limits.feed,
        "period_s": limits.period,
        "methods": [result_facts(result) for result in found.results],
        "saving": saving_facts(found.saving),
        "joint_path_saves": joint_saving(found.results),
        "note": NOTE,
    }


def _json(facts: dict[str, Any]) -> str:
    from feedplan.comparison.result import finite

    return json.dumps(finite(facts), indent=2, allow_nan=False)


def _write(path: Path, facts: dict[str, Any]) -> None:
    text = _json(facts) + "\n" if path.suffix.lower() == ".json" else _csv(facts["methods"])
    with whole_file(path) as file:
        file.write(text.encode())


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    """One line a method; what is not known is empty, several limits are separated by semicolons."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: _cell(value) for key, value in row.items()})
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return "; ".join(value)
    return "" if isinstance(value, float) and math.isnan(value) else value


# ---- for a person --------------------------------------------------------------------------------------------------


def _text(found: Comparison, machine: str, files: Sequence[str]) -> str:
    from feedplan.comparison import NOTE

    curve, limits, results, saved = found.curve, found.limits, found.results, found.saving
    lines = [
        f"curve    {curve.name}, {curve.length:.3f} mm, axes {' '.join(curve.axes)}",
        f"machine  {machine}; feed {limits.feed:g} mm/s, period {limits.period:g} s",
        "",
        *_table(results),
        "",
    ]
    if any(not result.ok and result.judgement for result in results):
        lines += [*_slowed_table(results), ""]
    if saved is not None and saved.rival:
        lines += textwrap.wrap(
            f"The optimum saves {100.0 * saved.share:.2f} % of the {saved.rival_duration:.4f} s of {saved.rival}, the "
            "fastest other method that breaks nothing as it is.",
            _WIDTH,
        )
    if saved is not None and saved.slowed_rival and saved.slowed_rival != saved.rival:
        lines += textwrap.wrap(
            f"It saves {100.0 * saved.slowed_share:.2f} % of the {saved.slowed_duration:.4f} s of "
            f"{saved.slowed_rival}, the fastest other method once each has been slowed.",
            _WIDTH,
        )
    lines += [*_paths_text(results), *_controllers_text(results)]
    return "\n".join([*lines, *textwrap.wrap(f"{NOTE}.", _WIDTH), *(f"written  {name}" for name in files)])


def _paths_text(results: Sequence[Result]) -> list[str]:
    """Of a part program: how far its two paths leave it, and what finding path and feed together saves."""
    from feedplan.comparison.methods import OPTIMUM
    from feedplan.comparison.two_paths import PATHS, joint_saving

    off = {result.method: result.deviation for result in results if not math.isnan(result.deviation)}
    other = next((name for name in PATHS if name in off), None)
    if other is None:
        return []
    text = (
        f"{other} is the optimal plan on the path that is found together with its feed"
        if other == "joint"
        else f"{other} is the optimal plan on the path that is made before its feed"
    )
    text += (
        f": it leaves the program by {1e3 * off[other]:.4g} um at most, that of the other rows by "
        f"{1e3 * off[OPTIMUM]:.4g} um."
    )
    if (saved := joint_saving(results)) is not None:
        text += f" Finding path and feed together saves {100.0 * saved:.2f} %."
    return textwrap.wrap(text, _WIDTH)


def _controllers_text(results: Sequence[Result]) -> list[str]:
    """Of the controllers: whose path they are on, how far that is from the program, and how far their models were off."""
    from planner.controllers.known import CONTROLLERS

    ran = [result for result in results if result.method in CONTROLLERS and result.judgement]
    lines = []
    for result in ran:
        far = "" if math.isnan(result.deviation) else f" leaves the program by {1e3 * result.deviation:.4g} um at most;"
        text = f"{result.method}, the model of a controller,{far} {CONTROLLERS[result.method].measured}."
        lines += textwrap.wrap(text, _WIDTH)
    return lines


def _table(results: Sequence[Result]) -> list[str]:
    """Time never stands without what is broken, judged from rest to rest; a method that did not run says why."""
    from feedplan.comparison.judgement import LETTERS, letters

    lines = [
        f"{'':16}{'':9}{'':8}{'chord':>7}{'worst value / limit':>21}{'feed':>6}{'CPU':>5}",
        f"{'':16}{'time s':>9} {'breaks':7}{'um':>7}{'veloc':>7}{'accel':>7}{'jerk':>7}{'fluct':>6}{'ms':>5}{'points':>7}",
    ]
    for result in results:
        if result.judgement is None:
            why = textwrap.wrap(result.reason, _WIDTH - 18)
            lines += [f"{result.method if k == 0 else '':18}{part}" for k, part in enumerate(why)]
            continue
        ratios = (_ratio(result.judgement.ratios[name]) for name in ("velocity", "acceleration", "jerk"))
        fluctuation = "-" if math.isnan(result.fluctuation) else f"{result.fluctuation:.0e}"
        lines.append(
            f"{result.method:16}{result.duration:9.4f} {letters(result.judgement):7}{1e3 * result.chord_error:7.3g}"
            f"{''.join(f'{ratio:>7}' for ratio in ratios)}"
            f"{fluctuation:>6}{1e3 * result.computing_time:5.0f}{result.points:7}"
        )
    used = {row.limit for result in results if result.judgement for row in result.judgement.broken}
    known = [f"{letter} {name}" for name, letter in LETTERS.items() if name in used]
    known += [f"? {name}" for name in sorted(used - set(LETTERS))]
    return [*lines, *textwrap.wrap(f"breaks: {', '.join(known)}", _WIDTH)] if known else lines


def _ratio(value: float) -> str:
    """Three digits behind the point, rounded up above 1 so that what is broken is seen to be."""
    if 1.0 + 1e-6 < value < 1.001:
        return "1.001"
    return f"{value:.3f}" if value < 10.0 else (f"{value:.4g}" if value < 1e4 else f"{value:.0e}")


def _slowed_table(results: Sequence[Result]) -> list[str]:
    head = f"{'slowed':>9}{'time s':>11}{'confirmed':>11}"
    lines = ["slowed down uniformly until nothing is broken", f"{'':16}{head}"]
    if any(result.entered_at_speed for result in results):
        lines[0] += "; the same for a path that is\nentered and left at the method's own feed"
        lines[1] += f" {head}"
    for result in results:
        if result.judgement is None or result.ok:
            continue
        line = f"{result.method:16}{_slowed(result.judgement)}"
        lines.append(line + (f" {_slowed(result.entered_at_speed)}" if result.entered_at_speed else ""))
    return lines


def _slowed(judgement: Judgement) -> str:
    found = judgement.dilation
    return f"{found.factor:8.3f}x{found.duration:11.4f}{'yes' if found.confirmed else 'NO':>11}"


# ---- figure --------------------------------------------------------------------------------------------------------


def comparison_panels(found: Comparison, shown: Sequence[str] = ("feed", "jerk")) -> list[Panel]:
    """Feed and jerk over the path, a row for each family of methods, the optimal plan in all of them.

    Parameters
    ----------
    shown : sequence of str
        "feed", "jerk" or both: the columns.

    Returns
    -------
    list of Panel
        One for each column of each row: what ``planner.output.panels.plot_panels`` draws.
    """
    from feedplan.comparison.methods import OPTIMUM
    from planner.output.panels import Line, Panel

    curve, limits = found.curve, found.limits
    ran = {result.method: result for result in found.results if result.motion is not None}
    panels: list[Panel] = []
    for title, names in _FAMILIES:
        family = [name for name in names if name in ran]
        if not family and (title != "planned" or set(ran) != {OPTIMUM}):
            continue
        feeds, jerks = [], []
        for name in (*((OPTIMUM,) if OPTIMUM in ran else ()), *family):
            label = name if ran[name].ok else f"{name} !"
            width = _BROAD if name == OPTIMUM else _SLIM
            s, feed, jerk = _along(curve, limits, ran[name])
            feeds.append(Line(label, *_largest(s[:-1], feed), width))
            jerks.append(Line(label, *_largest(s[: jerk.size], jerk), width))
        bound = [limits.feed] if math.isfinite(limits.feed) else []
        made = {
            "feed": Panel(title, "arc length, mm", "feed, mm/s", feeds, bound, legend="above"),
            # beside the feed its lines have their names already
            "jerk": Panel(title if shown[0] == "jerk" else "", "arc length, mm", "axis jerk over limit", jerks, [1.0],
                          log=True, legend="above" if shown[0] == "jerk" else "none"),
        }  # fmt: skip
        panels.extend(made[name] for name in shown)
    return panels


def _along(curve: Curve, limits: Limits, result: Result) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arc length of the samples, feed of every period, and the largest third difference as a share of the axis jerk."""
    import numpy as np

    assert result.motion is not None
    samples = result.motion.samples
    s = np.maximum.accumulate(curve.tip.arclength.s(samples.u))
    jerk = np.abs(np.diff(samples.position, 3, axis=0)) / samples.period**3 / limits.jerk
    return s, np.diff(s) / samples.period, np.maximum(jerk.max(axis=1, initial=0.0), _FLOOR)


def _largest(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thin out a line to the largest value of each column of the panel."""
    import numpy as np

    if x.size <= _COLUMNS:
        return x, y
    column = np.minimum(((x - x[0]) / (x[-1] - x[0]) * _COLUMNS).astype(np.intp), _COLUMNS - 1)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    return x[first], np.asarray(np.maximum.reduceat(y, first))

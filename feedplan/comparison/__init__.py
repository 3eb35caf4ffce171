"""The interpolators of the literature and the planner's methods on the same curve, under the same limits.

    found = compare(curve, limits, "algorithm,scurve,optimal")
    print(found.saving, found["scurve"].duration)

Every method is turned into the samples a drive would get, one a period, and these are judged by ``planner.verify``, which
shares no formula with any of them; a plan is judged between its samples as well.  Rules of the comparison:

1. *From rest to rest.*  The drives hold the first and the last sample.  Algorithms 1-4 enter and leave a path with a feed
   of their own, which is a step for a machine at rest; what they break without that step is told beside it.
2. *Machining time* is the time of the last sample, or the duration of a plan: the feed that drives the axes decides, not
   one that is only drawn.
3. *Dilation.*  The same points sent every kappa T have 1/kappa of the velocities, 1/kappa^2 of the accelerations and
   1/kappa^3 of the jerks, so that from the measured ratios r follows the least factor that breaks nothing,

       kappa = max(1, r_feed, r_velocity, sqrt(r_acceleration), cbrt(r_jerk), sqrt(r_chord error)).

   The check of the slowed motion confirms it.  A plan is slowed between its points, too; a step of its acceleration on
   a smooth path, which is no finite jerk however slow, counts there as the jerk a drive sees of it.  The chord error of
   the same points does not change: where it is too large, the slowed motion is sampled with the machine's own T, u(t)
   between the points by a monotone cubic, and the chord error of that must hold.
4. *The saving* of the optimum is counted against the fastest method that breaks nothing as it is, and against the fastest
   once each has been slowed by its kappa.  ``nlp`` solves the problem of ``optimal`` and is no rival.
5. *Both paths of a part program.*  All methods run on one of them.  A row of its own, ``joint`` or ``separate``, has the
   optimal plan on the other, judged by the same check, with how far each leaves the program: only that makes them rivals.
   Computing times are without making the paths.

Where a method's parameters must be chosen: Algorithms 1-4 as in :func:`interp.greedy`, mode physical.  2002: ramps that
use the weakest linear axis' acceleration (bell: and its jerk); a feed that the path is too short for is lowered; "steady"
runs at the highest constant feed that every limit allows everywhere, with ramps at half the acceleration and jerk.  2007:
both its accelerations are the weakest axis' over sqrt(2), so that their resultant keeps it.

Known limitation: kappa flatters a motion whose acceleration jumps.  Sampled with the same T instead of kappa T, a jump
leaves a jerk that falls with kappa^2 only.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from feedplan.comparison.judgement import fluctuation, judge
from feedplan.comparison.methods import METHODS, REFERENCE, select_methods
from feedplan.comparison.result import Result, Saving, result_facts, saving
from planner.errors import FeedrateError, InputError
from planner.frames import Tabular
from planner.geometry.curve import Curve
from planner.machine.limits import Limits, require_limits
from planner.types import Progress

NOTE = (
    "toppra, the trapezoid of 2002 and 2007 know no jerk limit: where the machine has one they are no fair rivals, and "
    "their times say what it costs"
)
# Loaded beforehand, so that no method is charged for it.
_LOADED = (
    "interp.taylor",
    "interp.literature.greedy",
    "planner.plan",
)
_LIBRARIES = {"toppra": "toppra", "scurve": "ruckig", REFERENCE: "casadi"}


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Tabular):
    """What :func:`compare` found: a row for each method.

    Attributes
    ----------
    curve : Curve
    limits : Limits
    results : tuple of Result
        In the order in which the methods were asked for.
    """

    curve: Curve
    limits: Limits
    results: tuple[Result, ...]

    @property
    def saving(self) -> Saving | None:
        """What the optimal plan saves; None where it is not there or breaks a limit."""
        return saving(self.results)

    def __getitem__(self, method: str) -> Result:
        """Return the result of a method by its name; raises InputError where it is not among them."""
        for result in self.results:
            if result.method == method:
                return result
        raise InputError(f"method {method!r} was not compared; there are {', '.join(r.method for r in self.results)}")

    def columns(self) -> dict[str, NDArray[Any]]:
        """Everything that is a number or a word, a row a method; of broken limits the names, with commas."""
        rows = [result_facts(result) for result in self.results]
        cells = {name: [row[name] for row in rows] for name in rows[0]}
        return {name: _column(values) for name, values in cells.items()}

    def __repr__(self) -> str:
        ran = sum(result.judgement is not None for result in self.results)
        holds = sum(result.ok for result in self.results)
        text = f"Comparison({self.curve.name}: {len(self.results)} methods, {ran} ran, {holds} break nothing"
        found = self.saving
        if found is None or not found.rival:
            return f"{text})"
        saved = f"{100.0 * found.share:.2f} % less than {found.rival}"
        return f"{text};\n           optimal takes {found.optimum:.6g} s, {saved})"


def _column(values: list[Any]) -> NDArray[Any]:
    """Numbers as an array of them, words and lists of words as texts."""
    if all(isinstance(value, bool | int | float) for value in values):
        return np.array(values)
    texts = [", ".join(value) if isinstance(value, list) else value for value in values]
    return np.array(texts, dtype=object)


def compare(
    curve: Curve, limits: Limits, methods: str | Sequence[str] | None = None, *, progress: Progress | None = None
) -> Comparison:
    """Run methods on a curve and judge all of them alike.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    methods : sequence of str, or str, optional
        Names of :data:`METHODS`, or a text as for :func:`select_methods`; all of them if left out.
    progress : callable, optional
        Called with the name of a method and the share of the methods done.

    Returns
    -------
    Comparison
        A result for each method, in that order.  One that cannot run on this curve has a reason in place of numbers.

    Raises
    ------
    InputError
        If there is no such method, or limits and curve do not belong together.
    """
    chosen = select_methods(methods) if isinstance(methods, str) else list(METHODS if methods is None else methods)
    for name in chosen:
        if name not in METHODS:
            raise InputError(f"method {name!r} must be one of {', '.join(METHODS)}")
    if not chosen:
        raise InputError(f"methods is empty; it must name some of {', '.join(METHODS)}")
    limits = require_limits(curve, limits)
    for module in (*_LOADED, *(_LIBRARIES[name] for name in chosen if name in _LIBRARIES)):
        import_module(module)
    for part in {curve, curve.tip}:
        _ = part.pieces, part.length, part.arclength
    results = []
    for k, name in enumerate(chosen):
        if progress is not None:
            progress(name, k / len(chosen))
        results.append(run_method(name, curve, limits))
    return Comparison(curve, limits, tuple(results))


def run_method(name: str, curve: Curve, limits: Limits) -> Result:
    """Run one method of :data:`METHODS` and judge it."""
    began = time.process_time()
    try:
        motion = METHODS[name](curve, limits)
    except FeedrateError as error:
        return Result(name, reason=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - began
    samples, entered = motion.samples, None
    if motion.profile is None and (samples.start_feed or samples.end_feed):
        _, entered = judge(curve, limits, motion)
        motion = replace(motion, samples=replace(samples, start_feed=0.0, end_feed=0.0))
    rows, judgement = judge(curve, limits, motion)
    return Result(
        method=name,
        duration=motion.duration,
        points=samples.t.size,
        chord_error=max(row.worst for row in rows if row.limit == "chord error"),
        fluctuation=fluctuation(curve, motion),
        computing_time=seconds,
        judgement=judgement,
        entered_at_speed=entered,
        motion=motion,
    )

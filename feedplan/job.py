"""One door: load -> plan -> replay -> check -> Verdict.

    verdict = plan_and_check("part.ngc", "mill.toml", tolerance=0.01)
    print(verdict.ok, verdict.profile.duration, verdict.gap)

A :class:`Job` is a curve with the limits on it, wherever both come from; its methods are the steps, in this order:
``plan``, ``bound``, ``replay``, ``check``, and ``run`` and ``judge``, which take them.  The command line, the comparison and
the benchmarks call these and hold no step of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from feedplan.sources import (
    DrawingChoice,
    SourceCurve,
    is_program,
    path_for,
    plain_curve,
    program_curve,
    require_no_path_choice,
    tolerance_of_table,
)
from planner.errors import InputError

if TYPE_CHECKING:
    from feedplan.verdict import ReserveCost, Verdict
    from planner.geometry.curve import Curve
    from planner.geometry.tolerance import PathKind, PathSide
    from planner.machine.limits import Limits
    from planner.machine.machine_table import Machine
    from planner.machine.program_setup import ProgramSetup, RestTimes
    from planner.output.ngc import FeedMode, WrittenProgram
    from planner.profile import FeedrateProfile
    from planner.programs.neighbours import NeighbouringPasses
    from planner.programs.path.smooth_path import ProgramPath
    from planner.programs.reading.program import Program
    from planner.programs.times import LineTimes
    from planner.samples import Samples
    from planner.types import Progress
    from planner.verify import Report

GIVEN = "limits given"
UNBOUNDED = "toppra"
"""The method without a jerk limit: its plans are compared with, and their time is not bounded."""


def _silent(message: str, fraction: float | None = None) -> None:
    """Show no progress."""


@dataclass(frozen=True, eq=False, repr=False)
class Job:
    """A curve and the limits on it.

    Attributes
    ----------
    curve : Curve
    limits : Limits
        On the axes of the curve.
    machine : str
        Where the limits come from, for a person.
    program : Program, optional
        The part program the curve was made from.
    path : ProgramPath, optional
        What was made of it; its curve is ``curve``.
    room : float
        Distance that the lines of a program written from the plan may leave the curve by, mm.
    facts : tuple of (str, str)
        What the verdict says of where the curve comes from.
    path_seconds : float
        What it took to make the path of a program: a joint one is planned there.
    setup : ProgramSetup, optional
        What the machine's file says of homes, tools and rests.
    acceleration_share : float
        Of the machine's acceleration, what ``limits`` have of it.
    override_reserve : float
        Share of the limits that plans leave for feed override, as :func:`planner.plan_feedrate` has it.
    """

    curve: Curve
    limits: Limits
    machine: str = GIVEN
    program: Program | None = None
    path: ProgramPath | None = None
    room: float = 0.0
    facts: tuple[tuple[str, str], ...] = ()
    path_seconds: float = 0.0
    setup: ProgramSetup | None = None
    acceleration_share: float = 1.0
    override_reserve: float = 0.0

    def __repr__(self) -> str:
        return f"Job({self.curve.name} on {self.machine})"

    @classmethod
    def of(
        cls,
        found: SourceCurve,
        limits: Limits,
        machine: str,
        setup: ProgramSetup | None = None,
        acceleration_share: float = 1.0,
    ) -> Job:
        """Put a curve and the limits of a machine together, which may have more axes."""
        own = limits.for_curve(found.curve)
        source = found.program, found.path, found.room, found.facts, found.seconds
        return cls(found.curve, own, machine, *source, setup, acceleration_share)

    def run(
        self, progress: Progress = _silent, *, bound: bool = True, certificate: Path | None = None, **options: Any
    ) -> Verdict:
        """Plan, bound, replay and check.

        Parameters
        ----------
        progress : callable
            Is told what is being done, and which share of it is done where that is known.
        bound : bool
            Bound the time from below as closely as can be; else the verdict has the bound that every plan carries.
        certificate : Path, optional
            The proof of the bound is written there, ``.npz``, and verified.
        options
            As for :func:`planner.plan_feedrate`.

        Raises
        ------
        FeedrateError
            If there is no plan, or no certificate.
        """
        began = time.perf_counter()
        profile = self.plan(progress, **options)
        seconds = time.perf_counter() - began + self.path_seconds
        # What is proved is of every plan within the limits, and one without a reserve is nearer to the fastest.
        without = self._without_reserve(profile, progress, options) if self.override_reserve else None
        nearest = profile if without is None else without
        if bound and profile.method != UNBOUNDED:
            found = self.bound(nearest, progress, certificate=certificate)
            notes = (*profile.notes, *found.notes[len(nearest.notes) :])
            profile = replace(profile, lower_bound=found.lower_bound, claim=found.claim, notes=notes)
        verdict = self.judge(profile, progress, seconds=seconds)
        if self.override_reserve:
            verdict = replace(verdict, reserve=self.reserve_cost(profile, without, progress))
        if bound and profile.method != UNBOUNDED:
            verdict = replace(verdict, any_path=self.any_path_bound(progress))
        return verdict if certificate is None else self.prove(verdict, certificate, progress)

    def plan(self, progress: Progress = _silent, **options: Any) -> FeedrateProfile:
        """Plan the curve; options as for :func:`planner.plan_feedrate`.

        A plan with a reserve has no lower bound of its own: it may not use all of the limits that others may.
        """
        from planner import plan_feedrate
        from planner.status import Claim

        options = {"override_reserve": self.override_reserve} | options
        profile = plan_feedrate(self.curve, self.limits, progress=progress, **options)
        if profile.origin.override_reserve:
            profile = replace(profile, lower_bound=math.nan, claim=Claim.NONE)
        return profile

    def _without_reserve(
        self, profile: FeedrateProfile, progress: Progress, options: Mapping[str, Any]
    ) -> FeedrateProfile | None:
        """The plan without the reserve, on the same path; None where none is found, or it stops where this one does not.

        A path that was found with its feed may turn back in motion.  The feed that was found is of the limits with the
        reserve; another plan of that path stops there, or is not found at all.
        """
        from planner.errors import SolverError

        progress("planning without the reserve", None)
        try:
            found = self.plan(progress, **{**options, "override_reserve": 0.0})
        except SolverError:
            return None
        return found if _rests(found) <= _rests(profile) else None

    def reserve_cost(
        self, profile: FeedrateProfile, without: FeedrateProfile | None, progress: Progress = _silent
    ) -> ReserveCost:
        """What the reserve of a plan costs, against a plan without it on the same path, and how fast it stops."""
        from feedplan.verdict import ReserveCost
        from interp.rate_limits import rate_limits

        progress("finding the fastest stop", None)
        found = rate_limits(profile, self.limits)
        stop = math.nan if found is None else found.stop_time
        return ReserveCost(profile.origin.override_reserve, math.nan if without is None else without.duration, stop)

    def bound(
        self, profile: FeedrateProfile, progress: Progress = _silent, *, certificate: Path | None = None
    ) -> FeedrateProfile:
        """Bound the time of every plan from below, and write the certificate of that if a file is given.

        A plan is not lost for want of a bound: it then has none, and a note says why; but where a certificate is wanted
        the error is raised.
        """
        from planner import SolverError, certify
        from planner.status import Claim

        progress("bounding the time from below", None)
        try:
            found = certify(self.curve, self.limits, profile)
        except SolverError as error:
            if certificate is not None:
                raise
            said = str(error)
            note = said if said.startswith("no lower bound") else f"no lower bound: {said}"
            notes = (*profile.notes, note)
            return replace(profile, lower_bound=math.nan, claim=Claim.NONE, notes=notes)
        if certificate is not None:
            from planner.output.certificate_file import write_certificate

            progress(f"writing {certificate}", None)
            write_certificate(certificate, found.certificate)
        return replace(profile, lower_bound=float(found), claim=Claim.COMPUTED)

    def any_path_bound(self, progress: Progress = _silent) -> float:
        """Bound the time of the program from below, whatever path is made of it, s; nan where there is none."""
        if self.program is None or self.path is None or self.curve.made_within is None:
            return math.nan
        from planner.programs.path.any_path import any_path_bound

        progress("bounding the time of every path from below", None)
        return any_path_bound(self.program, self.curve.made_within.mm, self.limits)

    def replay(self, profile: FeedrateProfile, period: float | None = None, *, order: int = 5) -> Samples:
        """Sample a plan once a period, that of the limits if left out."""
        import interp

        return interp.replay(self.curve, profile, self.limits.period if period is None else period, order=order)

    def check(self, plan: FeedrateProfile | Samples, **options: Any) -> Report:
        """Measure a plan, or samples, against the limits; options as for :func:`planner.check`."""
        from planner import check

        return check(self.curve, self.limits, plan, **options)

    def judge(
        self,
        profile: FeedrateProfile,
        progress: Progress = _silent,
        *,
        seconds: float = math.nan,
        files: tuple[str, ...] = (),
    ) -> Verdict:
        """Check a plan and the samples of it, each on its own; ``seconds`` is what it took to plan."""
        from feedplan.verdict import Verdict

        progress("checking the plan", None)
        plan_report = self.check(profile)
        progress("checking the samples", None)
        samples = self.replay(profile)
        reports = plan_report, self.check(samples)
        verdict = Verdict(profile, self.limits, self.machine, samples, *reports, seconds, files, self.path, self.facts)
        return replace(verdict, passes=self.neighbouring_passes(profile))

    def neighbouring_passes(self, profile: FeedrateProfile) -> NeighbouringPasses | None:
        """How equal a plan's feed is at the same place in neighbouring passes; None where there are none, or no program."""
        if self.path is None:
            return None
        from planner.programs.neighbours import neighbouring_passes

        return neighbouring_passes(self.path, profile, self.limits)

    def prove(self, verdict: Verdict, certificate: Path, progress: Progress = _silent) -> Verdict:
        """Add what the certificate in a file proves of the lower bound of this job's plans."""
        from planner.output.certificate_file import read_certificate
        from planner.verify.certificate import verify_plan_bound

        progress("verifying the lower bound", None)
        found = read_certificate(certificate)
        return replace(verdict, proof=verify_plan_bound(self.curve, self.limits, found, verdict.profile))

    @property
    def rests(self) -> RestTimes:
        """What the machine's file says of tool changes and spindle starts."""
        from planner.machine.program_setup import RestTimes

        return RestTimes() if self.setup is None else self.setup.rests

    def without_jerk(self) -> Job:
        """The same without a jerk limit."""
        return replace(self, limits=self.limits.without_jerk())

    def line_times(self, profile: FeedrateProfile, rests: RestTimes | None = None) -> LineTimes:
        """Share the time of a plan out among the lines of the program.

        ``rests`` are the seconds of tool changes and spindle starts; left out, those of the machine's file.
        Raises InputError where the curve is of no program.
        """
        from planner.programs.times import line_times

        if self.program is None or self.path is None:
            raise InputError(f"{self.curve.name} has no lines; their times need a part program")
        return line_times(self.program, self.path, profile, self.rests if rests is None else rests)

    def write(self, file: Path, profile: FeedrateProfile, mode: FeedMode, **options: Any) -> WrittenProgram:
        """Write a program of the plan for LinuxCNC; options as for :func:`planner.write_ngc`."""
        from planner.output.ngc import write_ngc
        from planner.output.ngc_program import write_program

        options.setdefault("acceleration", self.limits.acceleration / self.acceleration_share)
        if self.program is None or self.path is None:
            return write_ngc(file, self.curve, profile, tolerance=self.room, mode=mode, **options)
        return write_program(file, self.program, self.path, profile, tolerance=self.room, mode=mode, **options)


def plan_and_check(
    source: str | Path | Curve,
    machine: str | Path | Limits | None = None,
    *,
    complete: Mapping[str, float] | None = None,
    scale: float = 1.0,
    layer: str | None = None,
    chain: int | None = None,
    feed: float | None = None,
    period: float | None = None,
    tolerance: float | None = None,
    path: PathKind | None = None,
    side: PathSide | None = None,
    override_reserve: float = 0.0,
    bound: bool = True,
    progress: Progress = _silent,
    **options: Any,
) -> Verdict:
    """Load a curve and a machine, plan, replay, check, and say what was found: all that ``feedplan plan`` does.

    Parameters
    ----------
    source, machine, complete, scale, layer, chain, feed, period, tolerance, path, side, override_reserve
        As for :func:`load_job`.
    bound, progress, options
        As for :meth:`Job.run`; options are those of :func:`planner.plan_feedrate`: ``method``, ``start_feed``,
        ``end_feed``, ``periodic``, ``exact_stop``, ``intervals``, ``budget``.

    Returns
    -------
    Verdict
        ``ok`` says whether every limit holds; ``profile``, ``samples``, their reports and the lower bound are in it.

    Raises
    ------
    InputError
        If something given is not as it must be.
    InfeasibleError, SolverError
        If there is no plan.

    Examples
    --------
    >>> plan_and_check("butterfly-nurbs", "mill").ok
    True
    """
    job = load_job(
        source,
        machine,
        complete=complete,
        scale=scale,
        layer=layer,
        chain=chain,
        feed=feed,
        period=period,
        tolerance=tolerance,
        path=path_for(source, path, options),
        side=side,
        override_reserve=override_reserve,
    )
    return job.run(progress, bound=bound, **options)


def _rests(profile: FeedrateProfile) -> set[float]:
    """Parameters inside the path at which a plan comes to rest; where it turns back in motion it has an acceleration."""
    inner = (profile.t > 0.0) & (profile.t < profile.duration)
    return set(profile.u[inner & (profile.u_rate == 0.0) & (profile.u_acceleration == 0.0)].tolist())


def load_job(
    source: str | Path | Curve,
    machine: str | Path | Limits | Machine | None = None,
    *,
    complete: Mapping[str, float] | None = None,
    scale: float = 1.0,
    layer: str | None = None,
    chain: int | None = None,
    feed: float | None = None,
    period: float | None = None,
    tolerance: float | None = None,
    share: float = 1.0,
    tools: str | Path | None = None,
    ignore: Sequence[str] = (),
    reader: str = "feedplan",
    path: PathKind | None = None,
    side: PathSide | None = None,
    acceleration_share: float = 1.0,
    override_reserve: float = 0.0,
    notice: Callable[[str], None] | None = None,
) -> Job:
    """Load a curve, or a part program as a path, and the limits of a machine.

    Parameters
    ----------
    source : str, Path or Curve
        The name or file of a curve, as :func:`planner.load_curve` takes it, a part program, or a curve.
    machine : str, Path, Limits or Machine, optional
        A machine file or an example machine, limits, or a machine as read; left out, the example that has the curve's axes.
    complete : mapping of str to float, optional
        Limits for the axes that the machine file has none for, as for :func:`planner.load_limits`.
    scale : float
        Multiplies the linear axes; of a curve by name or from a file of one.
    layer, chain : str, int, optional
        Of a drawing: only what is on the layer, and which of several chains.
    feed : float, optional
        Commanded feed, mm/s, in place of the machine's.
    period : float, optional
        Interpolation period, s, in place of the machine's.
    tolerance : float, optional
        Largest distance of the curve from a part program, in place of its P words, or from points, mm.
    share : float
        Part of the tolerance that the curve takes, less than 1 where a program is to be written from the plan.
    tools : str or Path, optional
        Tool table for a part program.
    ignore : sequence of str
        Words of a part program to pass over, as :func:`planner.read_program` does.
    reader : str
        Who reads a part program: "feedplan", or "rs274" for an installed LinuxCNC.
    path : {"joint", "separate"}, optional
        Whether the path of a part program is found together with its feed, which is the default, or before it.
    side : {"both", "left", "right", "inside", "outside"}, optional
        Where the path of a part program may leave it to, as :func:`planner.programs.path.smooth_path.program_path` has it.
    acceleration_share : float
        Of the machine's acceleration, what the plan may use: a controller that cannot use all of it while it turns then
        keeps to the plan.
    override_reserve : float
        Share of every jerk limit, and a third of it of every acceleration limit, that plans leave for feed override and feed
        hold, 0 to 0.5; they are checked against the whole limits.
    notice : callable, optional
        Is told what is no error and yet worth knowing.

    Raises
    ------
    InputError
        If something given is not as it must be, or does not fit the rest.
    """
    from planner.geometry.catalog import require_no_choice
    from planner.geometry.curve import ROTARY_AXES, Curve
    from planner.machine.limits import reserve_shares
    from planner.programs.source import require_no_program_options

    tolerance, choice = _positive(tolerance), DrawingChoice(layer, chain)
    if not isinstance(source, Curve) and is_program(source):
        require_no_choice(source, layer, chain)
        found, named = load_machine(machine, complete=complete)
        limits = _changed(found.limits, feed, period, acceleration_share)
        job = Job.of(
            program_curve(
                source, scale, limits.with_reserve(override_reserve), tolerance, share, notice,
                tools=tools, ignore=ignore, reader=reader, setup=found.setup, path=path or "joint", side=side or "both",
            ),
            limits,
            named,
            found.setup,
            acceleration_share,
        )  # fmt: skip
        return replace(job, override_reserve=override_reserve)
    require_no_program_options(source, tools, ignore)
    require_no_path_choice(source, path, side)
    made = plain_curve(source, scale, tolerance, share, choice)
    example = "five-axis" if ROTARY_AXES & set(made.curve.axes) else "mill"
    found, named = load_machine(machine, example, complete=complete)
    limits = _changed(found.limits.for_curve(made.curve), feed, period, acceleration_share)
    reserve_shares(override_reserve)  # refused before anything is planned
    job = Job.of(made, limits, named, acceleration_share=acceleration_share)
    return replace(job, override_reserve=override_reserve)


def load_machine(
    machine: str | Path | Limits | Machine | None, example: str = "mill", *, complete: Mapping[str, float] | None = None
) -> tuple[Machine, str]:
    """Load a machine, or an example where none is given; with it comes what to call it, and what to know of its limits."""
    from planner import Limits
    from planner.machine.machine_file import read_machine
    from planner.machine.machine_table import Machine

    if isinstance(machine, Limits | Machine):
        if complete:
            raise InputError(f"{', '.join(complete)}: completes a machine file; limits are given whole")
        return machine if isinstance(machine, Machine) else Machine(machine), GIVEN
    found = read_machine(example if machine is None else machine, complete)
    name = f"{example} (example machine)" if machine is None else str(machine)
    return found, f"{name} ({'; '.join(found.notes)})" if found.notes else name


def load_job_of_table(
    table: Path,
    source: str | Path | Curve,
    machine: str | Path | Limits | None = None,
    *,
    complete: Mapping[str, float] | None = None,
    scale: float = 1.0,
    layer: str | None = None,
    chain: int | None = None,
    tolerance: float | None = None,
    tools: str | Path | None = None,
    ignore: Sequence[str] = (),
    reader: str = "feedplan",
    setup: str | Path | None = None,
    path: PathKind | None = None,
    side: PathSide | None = None,
) -> Job:
    """Load the curve a table was planned for, and the limits of a machine; without one, those in the table's header.

    The path of a part program depends on the limits it was made for, on the tolerance, and on how it was made: all stand in
    the header.  It
    depends too on the homes and offsets of the machine: these are those of the file ``setup``, or where that is left out of
    ``machine``.  Other arguments as for :func:`load_job`; the plan itself is read by :func:`planner.read_table`.
    """
    from planner import load_limits, table_limits
    from planner.geometry.catalog import require_no_choice
    from planner.geometry.curve import Curve
    from planner.machine.machine_file import read_machine
    from planner.output.table import table_origin
    from planner.programs.source import require_no_program_options

    own, reserve = table_limits(table), table_origin(table).override_reserve
    said = tolerance_of_table(table, source)
    tolerance, choice = said.mm if tolerance is None else _positive(tolerance), DrawingChoice(layer, chain)
    on, named = (None, "") if machine is None else load_machine(machine, complete=complete)
    if not isinstance(source, Curve) and is_program(source):
        require_no_choice(source, layer, chain)
        known = on if setup is None else read_machine(setup)
        weights = load_limits(said.machine) if said.machine else own.with_reserve(reserve)
        found = program_curve(
            source,
            scale,
            weights,
            tolerance,
            said.share,
            tools=tools,
            ignore=ignore,
            reader=reader,
            setup=None if known is None else known.setup,
            path=path or said.path,
            side=side or said.side,
            widen=not said.machine,
        )
    else:
        require_no_program_options(source, tools, ignore)
        require_no_path_choice(source, path, side)
        found = plain_curve(source, scale, tolerance, said.share, choice)
    if on is None:
        if complete:
            raise InputError(f"{', '.join(complete)}: completes a machine file; the limits are those of {table}")
        job = Job.of(found, own, f"limits in {table}")
    else:
        job = Job.of(found, on.limits, named)
    return replace(job, override_reserve=reserve)


def _positive(tolerance: float | None) -> float | None:
    from planner.inputs import positive_number

    return None if tolerance is None else positive_number(tolerance, "tolerance")


def _changed(limits: Limits, feed: float | None, period: float | None, acceleration_share: float) -> Limits:
    from planner.inputs import positive_number

    share = positive_number(acceleration_share, "acceleration_share")
    if share > 1.0:
        raise InputError(f"acceleration_share = {share:g} must be > 0 and at most 1")
    if share < 1.0:
        limits = limits.with_acceleration_share(share)
    if feed is not None:
        limits = limits.with_feed(feed)
    return limits if period is None else limits.with_period(period)

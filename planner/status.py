"""What a plan says of itself: how it ended, how its lower bound is known, and what it cost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np


class Status(Enum):
    """How a solve or a plan ended: a word for files, and a sentence for people."""

    sentence: str

    OPTIMAL = "optimal", "it is the optimum"
    FEASIBLE = "feasible", "its method keeps the limits and does not look for the optimum"
    BUDGET = "budget", "the computing time ran out before the optimum was found"
    SLOWED = "slowed", "it was slowed down for what it would use too much of its limits"
    SINGULAR = "singular", "the solver stalled at a plan within the limits: its Newton system is singular"
    NO_STEP = "no step", "the solver stalled at a plan within the limits: its step length vanished"
    TOO_MANY = "too many iterations", "the solver stalled at a plan within the limits: it took too many iterations"

    def __new__(cls, word: str, sentence: str) -> Status:
        """Keep the word as the value."""
        status = object.__new__(cls)
        status._value_ = word
        status.sentence = sentence
        return status

    @property
    def as_meant(self) -> bool:
        """The method found what it looks for."""
        return self in {Status.OPTIMAL, Status.FEASIBLE}

    @property
    def stalled(self) -> bool:
        """The solver could not go on."""
        return self in {Status.SINGULAR, Status.NO_STEP, Status.TOO_MANY}


class Claim(Enum):
    """How a lower bound is known; the value says it to a person."""

    NONE = "there is none"
    COMPUTED = "computed with the plan"
    TABLE = "claimed by the table, not verified"
    CERTIFIED = "proved by the certificate"


@dataclass(frozen=True)
class Work:
    """What a plan took, and how near its solver came.

    Attributes
    ----------
    sections : int
        Stretches between exact stops, each planned by itself.
    intervals, iterations, rounds : int
        Of the grids and of the solver at the end, and rounds of refinement (of the section with most of them).
    solve_cpu_s, first_solve_cpu_s, planning_s : float
        CPU time of all solves and of the first ones on the wanted grid; elapsed time of the whole plan; s.
    gap, residual : float
        Largest relative gap and violation that a solver ended with; nan where it has none.
    slowdown : float
        Largest factor by which a section was too fast between the points of its grid, and slowed down as a whole.
    proven_global : bool
        The multipliers prove that no other plan on the grids is faster.
    """

    sections: int = 1
    intervals: int = 0
    iterations: int = 0
    rounds: int = 0
    solve_cpu_s: float = 0.0
    first_solve_cpu_s: float = 0.0
    planning_s: float = np.nan
    gap: float = np.nan
    residual: float = np.nan
    slowdown: float = 1.0
    proven_global: bool = False

    @classmethod
    def of_all(cls, parts: Iterable[Work], planning_s: float) -> Work:
        """Sum up the work on the sections of one plan."""
        every = list(parts)
        return cls(
            sections=sum(part.sections for part in every),
            intervals=sum(part.intervals for part in every),
            iterations=sum(part.iterations for part in every),
            rounds=max(part.rounds for part in every),
            solve_cpu_s=sum(part.solve_cpu_s for part in every),
            first_solve_cpu_s=sum(part.first_solve_cpu_s for part in every),
            planning_s=planning_s,
            gap=float(np.fmax.reduce([part.gap for part in every])),
            residual=float(np.fmax.reduce([part.residual for part in every])),
            slowdown=max(part.slowdown for part in every),
            proven_global=all(part.proven_global for part in every),
        )

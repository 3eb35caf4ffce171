"""What the windows of a long program amount to, as far as they are planned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.programs.long.window import Kept

_SAID = 8  # of the runs that are made separately: a long program may have many


@dataclass(frozen=True)
class Done:
    """What the windows so far amount to; ``t`` and ``u`` are where they end.

    Of ``runs`` of the path ``made_separately`` are; the first of them are in ``separate``.
    """

    windows: int = 0
    t: float = 0.0
    u: float = 0.0
    stops: int = 0
    share: float = 0.0
    deviation: float = 0.0
    deviation_row: int = 0
    worst: float = 0.0
    worst_limit: str = ""
    joint_feed: float = 0.0
    joint_acceleration: float = 0.0
    limit_names: tuple[str, ...] = ()
    violations: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    runs: int = 0
    made_separately: int = 0
    separate: tuple[str, ...] = ()

    def with_window(self, kept: Kept) -> Done:
        """Add a window."""
        largest = max(kept.report.rows, key=lambda row: row.ratio if np.isfinite(row.ratio) else 0.0)
        worse, further = largest.ratio > self.worst, kept.deviation > self.deviation
        return replace(
            self,
            windows=self.windows + 1,
            t=kept.t,
            u=kept.u,
            stops=self.stops + kept.stopped,
            share=max(self.share, kept.share),
            deviation=kept.deviation if further else self.deviation,
            deviation_row=kept.deviation_row if further else self.deviation_row,
            worst=largest.ratio if worse else self.worst,
            worst_limit=f"{largest.limit} {largest.axis}".strip() if worse else self.worst_limit,
            joint_feed=max(self.joint_feed, kept.joint[0]),
            joint_acceleration=max(self.joint_acceleration, kept.joint[1]),
            limit_names=kept.limit_names,
            violations=self.violations + kept.violations,
            notes=self.notes + kept.notes,
            runs=self.runs + kept.runs,
            made_separately=self.made_separately + len(kept.separate),
            separate=(self.separate + kept.separate)[:_SAID],
        )

"""What a command shows while it works: nothing within the first second, then a line on a terminal."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

_PATIENCE = 1.0  # s; what is quicker needs no explanation


class ProgressLine:
    """A context in which ``line(message, fraction)`` is shown on standard error, if that is a terminal.

    ``fraction`` is None where nobody knows how far the work is.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._message = "working"
        self._fraction: float | None = None
        self._bar: tuple[Progress, TaskID] | None = None
        self._timer = threading.Timer(_PATIENCE, self._show)
        self._timer.daemon = True

    def __enter__(self) -> ProgressLine:
        if sys.stderr.isatty():
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        with self._lock:
            if self._bar is not None:
                self._bar[0].stop()
                self._bar = None

    def __call__(self, message: str, fraction: float | None = None) -> None:
        """Say what is being done."""
        with self._lock:
            self._message, self._fraction = message, fraction
            self._update()

    def _show(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
        with self._lock:
            if self._timer.finished.is_set():  # the work ended while rich was loading
                return
            progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar = progress, progress.add_task(self._message, total=None)
            self._update()
            progress.start()

    def _update(self) -> None:
        if self._bar is not None:
            progress, task = self._bar
            total = None if self._fraction is None else 1.0
            progress.update(task, description=self._message, total=total, completed=self._fraction or 0.0)

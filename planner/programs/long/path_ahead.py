"""The parts of a path, made by another process while this one plans: one part is ready or in work ahead of what is planned.

The process beside makes part after part, and waits to hand over one before it begins the one after the next: so what waits
is one part.  Where it ends, the parts are made here.  They are the same to the last bit wherever they are made: they go
through the same serialisation in one process, after which arrays lie in memory as they do in the other.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from types import TracebackType

from planner.programs.long.parts import PathPart, next_part
from planner.programs.long.path_source import Cursor, PathSource
from planner.programs.long.runs_beside import RunsBeside
from planner.programs.long.worker import Receive, Send, Worker, WorkerEndedError

_MIN_MOVES = 100  # of a program for which a second process is worth its start

MadePart = tuple[PathPart, Cursor | None]
MakePart = Callable[[Cursor], MadePart]


class PathAhead:
    """Hands on the parts of a path, each asked for by the cursor that the one before gave.

    ``cores``: how many processors to use; with one all is made here.  ``lost`` says what became of a process that ended.
    """

    def __init__(self, source: PathSource, cores: int = 1) -> None:
        self.lost = ""
        self._source = source
        self._cores = cores if len(source.program) >= _MIN_MOVES else 1
        self._worker: Worker | None = None
        self._expected: Cursor | None = None

    def __enter__(self) -> PathAhead:
        """Start nothing: the first part does."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the process beside."""
        self._close()

    def next(self, cursor: Cursor) -> MadePart:
        """The part at a cursor, and the cursor behind it."""
        if self._cores > 1 and not self.lost:
            try:
                if self._worker is None or cursor is not self._expected:
                    self._close()
                    self._worker = Worker(make_parts, (self._source, cursor))
                made: MadePart = self._worker.receive()
                self._expected = made[1]
                return made
            except WorkerEndedError as error:
                self._worker = None
                self.lost = str(error)
        return _handed_over(next_part(self._source, cursor))

    def _close(self) -> None:
        if self._worker is not None:
            self._worker.close()
            self._worker = None


def make_parts(receive: Receive, send: Send) -> None:
    """Make the parts behind a cursor, one after the other, in the process beside."""
    source, cursor = receive()
    with RunsBeside(source) as beside:
        while cursor is not None:
            made = _handed_over(next_part(source, cursor, beside))
            send(made)
            cursor = made[1]


def _handed_over(made: MadePart) -> MadePart:
    """A part as another process gets it."""
    copied: MadePart = pickle.loads(pickle.dumps(made, protocol=pickle.HIGHEST_PROTOCOL))
    return copied

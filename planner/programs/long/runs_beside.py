"""Runs of a part, found by two processes: each is a problem of its own.

The process beside has the next runs in work while this one finds the first; who is done sooner takes the next.  Who found
which makes no difference to a bit, and where the other process ends, all are found here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType

from planner.programs.long.part_runs import RunsInSight
from planner.programs.long.path_source import PathSource
from planner.programs.long.worker import Receive, Send, Worker, WorkerEndedError
from planner.programs.path.joint_runs import FoundRun

_AHEAD = 2  # runs that are begun before the one that is waited for is there: a part may end with any


class RunsBeside:
    """Finds runs together with another process, which the first part with more than one of them starts."""

    def __init__(self, source: PathSource) -> None:
        self.lost = False
        self._source = source
        self._worker: Worker | None = None
        self._waiting = ThreadPoolExecutor(max_workers=1)  # of which the thread waits for the other process

    def __enter__(self) -> RunsBeside:
        """Start nothing yet."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the process beside."""
        if self._worker is not None:
            self._worker.close()
        self._waiting.shutdown(cancel_futures=True)

    def found(self, sight: RunsInSight, pairs: Sequence[tuple[int, int]]) -> Iterator[FoundRun]:
        """The runs from each first block to before each last, in their order."""
        if self.lost or len(pairs) < 2:
            yield from sight.found(pairs)
            return
        self._waiting.submit(self._show, sight)
        there: dict[int, Future[FoundRun | None]] = {}
        here: dict[int, FoundRun] = {}
        try:
            for k, pair in enumerate(pairs):
                while k not in here and not (k in there and there[k].done()):
                    left = [j for j in range(k, min(k + _AHEAD + 1, len(pairs))) if j not in here and j not in there]
                    if all(one.done() for one in there.values()):
                        for j in [j for j in left if j > k][:1]:
                            there[j] = self._waiting.submit(self._ask, *pairs[j])
                            left.remove(j)
                    if left:
                        here[left[0]] = sight.run(*pairs[left[0]])
                    else:
                        there[k].result()
                run = here.pop(k) if k in here else there.pop(k).result()
                yield run if run is not None else sight.run(*pair)
        finally:
            for one in there.values():
                one.cancel()

    def _show(self, sight: RunsInSight) -> None:
        """Let the other process see the blocks of a part."""
        try:
            if self._worker is None:
                self._worker = Worker(find_each, self._source)
            self._worker.send((sight.first, sight.blocks, sight.junctions))
        except WorkerEndedError:
            self.lost = True

    def _ask(self, first: int, last: int) -> FoundRun | None:
        """Let the other process find a run; None where it is gone."""
        if self.lost or self._worker is None:
            return None
        try:
            self._worker.send((first, last))
            found: FoundRun = self._worker.receive()
        except WorkerEndedError:
            self.lost = True
            return None
        return found


def find_each(receive: Receive, send: Send) -> None:
    """Find runs as they are asked for, in the process beside."""
    source = receive()
    sight: RunsInSight | None = None
    while True:
        message = receive()
        if len(message) == 3:
            sight = RunsInSight(source, *message)
        elif sight is not None:
            send(sight.run(*message))

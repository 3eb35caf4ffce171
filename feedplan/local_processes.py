"""Processes of this machine that do tasks, one at a time each.

A pool of the standard library fails every task that it has when one of its processes dies, and does not say whose process
it was.  Here each process is a pool of its own: a death is the end of one task, and of no other.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, TypeVar

from planner.errors import InputError

T = TypeVar("T")
# One thread each for the libraries of linear algebra: as many as there are cores would stand in each other's way.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def core_count() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class LocalProcesses:
    """A pool of processes; a context that ends them."""

    def __init__(self, count: int | None = None) -> None:
        count = core_count() if count is None else count
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise InputError(f"count = {count!r} must be a whole number of at least 1, of processes")
        self._slots: list[_Slot | None] = [None] * count

    def __enter__(self) -> LocalProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def room(self) -> int:
        """Return how many tasks to have handed out at a time."""
        return len(self._slots)

    def lost(self) -> str:
        """Say why no task will be done any more: a process that is lost is replaced."""
        return ""

    def explained(self, error: BaseException) -> str:
        """Say what an error means that has its cause in the pool, not in the task."""
        if isinstance(error, BrokenExecutor):
            return "the process that worked on it died, twice: it was killed, as when memory runs out, or crashed"
        return ""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Hand a task to a process that has none."""
        for k, slot in enumerate(self._slots):
            if slot is None or slot.is_idle:
                self._slots[k] = fresh = slot if slot is not None and slot.is_whole else _Slot.started()
                return fresh.submit(function, *arguments)
        raise AssertionError("every process is at work")

    def stop(self) -> None:
        """End the processes, also in the middle of a task."""
        for k, slot in enumerate(self._slots):
            if slot is not None:
                slot.end()
            self._slots[k] = None


@dataclass
class _Slot:
    """A process, and the last task that it was given."""

    executor: ProcessPoolExecutor
    process: Future[int]
    task: Future[Any] | None = None

    @classmethod
    def started(cls) -> _Slot:
        context = multiprocessing.get_context("spawn")
        executor = ProcessPoolExecutor(1, mp_context=context, initializer=_begin)
        with _environment(_ONE_THREAD):
            return cls(executor, executor.submit(os.getpid))

    @property
    def is_idle(self) -> bool:
        return self.task is None or self.task.done()

    @property
    def is_whole(self) -> bool:
        died = self.task is not None and not self.task.cancelled() and isinstance(self.task.exception(), BrokenExecutor)
        return not died

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        try:
            self.task = self.executor.submit(function, *arguments)
        except BrokenExecutor as error:  # it died while it had nothing to do
            self.task = Future()
            self.task.set_exception(error)
        return self.task

    def end(self) -> None:
        if not self.is_idle and self.process.exception() is None:
            os.kill(self.process.result(), signal.SIGKILL)
        self.executor.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Begin a process: an interrupt is for the parent to answer, and without the parent there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set variables for the processes that start meanwhile; those that the user has set stay."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]

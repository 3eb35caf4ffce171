"""Many tasks on many processes: each is done once, and what goes wrong with one stays with it.

    with LocalProcesses(2) as pool:
        found = run_batch(tasks, pool)

One loop, whoever does the work: a pool is an executor of ``concurrent.futures``, of this machine's processes
(:mod:`feedplan.local_processes`) or of a Dask cluster (:mod:`feedplan.dask_cluster`).

1. A task has a key.  Its outcome is kept under that key, once, whatever happens on the way.
2. No more tasks are handed out than the pool has room for, so that no more programs are in memory than are worked on.
3. A task that raises an error gets the error's text as its outcome.
4. A task whose process dies, or that is let go, is handed out once more, after all others and alone: a neighbour may have
   been the cause, or have taken the memory.  The second time, this is its outcome.
5. Where the pool is lost, or the user interrupts, what is done stays, and the outcome of the rest says why it is missing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

from planner import __version__
from planner.errors import FeedrateError, InputError, SolverError
from planner.types import Progress

T = TypeVar("T")
_TICK = 0.5  # s; how soon a pool that is lost is noticed
_TRIES = 2  # of a task whose process dies
_NAMED = 3  # tasks in work that the progress names


@dataclass(frozen=True, eq=False)
class BatchTask(Generic[T]):
    """Something to do in another process.

    Attributes
    ----------
    key : str
        Its identity: no two tasks of a batch have the same.
    label : str
        What to call it in the progress.
    work : callable
        A function at the top of a module: the other process loads it by its name.
    arguments : callable
        Makes the arguments of ``work``, when it is the task's turn; may raise a FeedrateError.
    """

    key: str
    label: str
    work: Callable[..., T]
    arguments: Callable[[], Sequence[Any]]


@dataclass(frozen=True)
class TaskOutcome(Generic[T]):
    """What became of a task: its value, or the error that there is in place of it."""

    value: T | None = None
    error: FeedrateError | None = None


class UnfinishedError(FeedrateError):
    """A task was not done: it was interrupted, or those who should have done it are gone."""


class WorkerPool(Protocol):
    """Who works: an executor that says how much it can take."""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Hand a task out."""
        ...

    def room(self) -> int:
        """Return how many tasks to have handed out at a time."""
        ...

    def lost(self) -> str:
        """Say why no task will be done any more; empty while they are."""
        ...

    def explained(self, error: BaseException) -> str:
        """Say what an error means that has its cause in the pool, not in the task; empty where it is one of the task."""
        ...

    def stop(self) -> None:
        """End what runs, at once."""
        ...


@dataclass
class Batch(Generic[T]):
    """Outcomes by the keys of their tasks, in the order in which these were given.

    ``interrupted``: the user ended it before all were done.
    """

    outcomes: dict[str, TaskOutcome[T]] = field(default_factory=dict)
    interrupted: bool = False


def run_batch(tasks: Iterable[BatchTask[T]], pool: WorkerPool, progress: Progress | None = None) -> Batch[T]:
    """Do every task once.

    Parameters
    ----------
    tasks : iterable of BatchTask
    pool : WorkerPool
    progress : callable, optional
        Is told how many are done and which are in work.

    Returns
    -------
    Batch
        An outcome for every task; those that failed, or were not done, say why.

    Raises
    ------
    InputError
        If two tasks have the same key.
    """
    every = list(tasks)
    keys = [task.key for task in every]
    if len(set(keys)) < len(keys):
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f'the key "{twice}" is that of two tasks; each needs one of its own')
    run = _BatchRun(every, pool, progress)
    try:
        run.to_the_end()
    except KeyboardInterrupt:
        pool.stop()
        run.give_up("interrupted before it was done")
        run.interrupted = True
    return Batch({key: run.found[key] for key in keys}, run.interrupted)


class _BatchRun(Generic[T]):
    """A batch on its way: which tasks wait, which are handed out, and what was found."""

    def __init__(self, tasks: Sequence[BatchTask[T]], pool: WorkerPool, progress: Progress | None) -> None:
        self.tasks, self.pool, self.progress = tasks, pool, progress
        self.waiting = deque(tasks)
        self.running: dict[Future[T], BatchTask[T]] = {}
        self.tries = {task.key: 0 for task in tasks}
        self.found: dict[str, TaskOutcome[T]] = {}
        self.interrupted = False

    def to_the_end(self) -> None:
        """Hand out and collect until every task has its outcome."""
        while self.waiting or self.running:
            self.hand_out()
            self.report()
            ready, _ = wait(self.running, timeout=_TICK, return_when=FIRST_COMPLETED)
            reason = self.pool.lost()
            # In the order in which they were handed out, not in that of a set: so are their second tries.
            for future in [one for one in self.running if one in ready]:
                self.collect(future, reason)
            if reason:
                self.pool.stop()
                self.give_up(reason)

    def hand_out(self) -> None:
        while self.waiting and len(self.running) < self.room():
            task = self.waiting.popleft()
            try:
                arguments = task.arguments()
            except FeedrateError as error:
                self.found[task.key] = TaskOutcome(error=error)
                continue
            self.tries[task.key] += 1
            self.running[self.pool.submit(task.key, run_task, __version__, task.work, *arguments)] = task

    def room(self) -> int:
        """How many tasks to have handed out; those that are tried again wait at the end, and are alone."""
        return 1 if self.tries[self.waiting[0].key] else self.pool.room()

    def collect(self, future: Future[T], lost: str) -> None:
        task = self.running.pop(future)
        error = CancelledError() if future.cancelled() else future.exception()
        let_go = error is not None and bool(self.pool.explained(error))
        if error is None:
            self.found[task.key] = TaskOutcome(future.result())
        elif let_go and lost:
            self.found[task.key] = TaskOutcome(error=UnfinishedError(lost))
        elif let_go and self.tries[task.key] < _TRIES:
            self.waiting.append(task)
        else:
            self.found[task.key] = TaskOutcome(error=self.as_ours(error))

    def as_ours(self, error: BaseException) -> FeedrateError:
        """What is not ours must not end the batch; its kind is told, for whoever reports it."""
        if isinstance(error, FeedrateError):
            return error
        if isinstance(error, MemoryError):
            return SolverError("the memory of this machine does not suffice")
        if meaning := self.pool.explained(error):
            return UnfinishedError(meaning)
        return SolverError(f"unexpected {type(error).__name__}: {error}; please report it with the program")

    def give_up(self, reason: str) -> None:
        """Give every task without an outcome one that says why."""
        for task in self.tasks:
            self.found.setdefault(task.key, TaskOutcome(error=UnfinishedError(reason)))
        self.running.clear()
        self.waiting.clear()

    def report(self) -> None:
        if self.progress is not None:
            names = [task.label for task in self.running.values()]
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            done, count = len(self.found), len(self.tasks)
            self.progress(f"{done} of {count} done; in work: {', '.join(names[:_NAMED])}{more}", done / count)


def run_task(version: str, work: Callable[..., T], *arguments: Any) -> T:
    """Do a task in the process that it was sent to, which must have the same version of feedplan."""
    if version != __version__:
        raise InputError(
            f"the worker has feedplan {__version__}, and the task is of feedplan {version}; install one version on all"
        )
    return work(*arguments)

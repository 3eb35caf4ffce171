"""The workers of a Dask cluster that do tasks, as the processes of :mod:`feedplan.local_processes` do.

Scheduler and workers need feedplan installed, in the version of the one who asks, and no disk in common with it: what a
task needs travels with it.  A task whose worker dies is given to another by the scheduler, which gives up a task when more
workers died than its setting ``distributed.scheduler.allowed-failures`` says.  So it does with the tasks that waited beside
it: they are tried again alone.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
import time
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from types import TracebackType
from typing import Any, TypeVar

from planner import __version__
from planner.errors import InputError

T = TypeVar("T")
_ADDRESS = re.compile(r"(?:tcp|tls)://(?:[^\s:/\[\]]+|\[[^\s\[\]]+\]):(\d{1,5})")
_MAX_PORT = 65535
_PATIENCE = 5.0  # s, for a scheduler to answer: one in the same building does within milliseconds
_MAX_IDLE = 60.0  # s without a worker, after which no task is waited for; a cluster that scales needs some to start one
_MAX_SILENCE = 30.0  # s; a scheduler that is busy answers within fewer
_INTERVAL = 1.0  # s between questions for the workers that there are
_AHEAD = 2  # tasks a worker, so that none waits while the next one travels


class DaskCluster:
    """The workers of a scheduler; a context that lets go of them.

    Parameters
    ----------
    address : str
        Of the scheduler, ``tcp://host:port`` or ``tls://host:port``; with ``tls`` Dask's settings say where the keys are.
    max_idle : float
        Seconds without any worker after which the cluster is given up.

    Raises
    ------
    InputError
        If Dask is not installed, the address is none, no scheduler answers there, it has no workers, or their version of
        feedplan is another.
    """

    def __init__(self, address: str, *, max_idle: float = _MAX_IDLE) -> None:
        self._address, self._max_idle = require_address(address), max_idle
        try:
            import distributed
        except ImportError:
            raise InputError('a scheduler needs Dask, which is not installed: pip install "feedplan[dask]"') from None
        # What happens to the cluster is said in the outcomes of the tasks, once.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        _require_scheduler(self._address)
        try:
            self._client = distributed.Client(self._address, timeout=_PATIENCE, set_as_default=False)
        except OSError as error:
            raise _no_scheduler(self._address, error) from None
        self._executor = self._client.get_executor(pure=False)
        self._gone = False
        self._threads: Mapping[str, int] = {}  # of each worker
        self._asked = self._seen = -math.inf  # when the scheduler was asked for them, and when there was one
        try:
            self._require_workers()
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> DaskCluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def notes(self) -> tuple[str, ...]:
        """What keeps the cluster from working as fast as it could."""
        wide = sum(count > 1 for count in self._threads.values())
        text = (
            f"{wide} of {len(self._threads)} workers have several threads, and a process plans one program at a time; "
            "dask worker with --nthreads 1 --nworkers auto uses every core"
        )
        return (text,) if wide else ()

    def room(self) -> int:
        """Return how many tasks to have handed out at a time; workers may come and go."""
        self._look()
        return max(1, _AHEAD * len(self._threads))

    def lost(self) -> str:
        """Say why no task will be done any more; empty while they are."""
        self._look()
        if self._gone:
            return f"the scheduler at {self._address} is gone: it did not give this back"
        if time.monotonic() - self._seen > self._max_idle:
            return f"the scheduler at {self._address} has had no worker for {self._max_idle:g} s"
        return ""

    def _look(self) -> None:
        """Ask the scheduler for its workers, if that was not just done."""
        now = time.monotonic()
        if self._client.status != "running":
            self._gone = True
        if self._gone or now - self._asked < _INTERVAL:
            return
        found: dict[str, Any] | None = None
        if (scheduler := self._client.scheduler) is not None:
            with suppress(OSError):  # it hung up, or is silent
                found = self._client.sync(scheduler.identity, n_workers=-1, callback_timeout=_MAX_SILENCE)
        if found is None:
            self._gone = True
            return
        self._asked = now
        self._threads = {name: int(worker["nthreads"]) for name, worker in found["workers"].items()}
        if self._threads:
            self._seen = now

    def explained(self, error: BaseException) -> str:
        """Say what an error means that has its cause in the cluster, not in the task."""
        from distributed.scheduler import KilledWorker

        if isinstance(error, KilledWorker):
            return (
                "every worker that had it died, again and again: they were killed, as when memory runs out, or crashed"
            )
        if isinstance(error, CancelledError):
            return "the scheduler let go of it, twice"
        if isinstance(error, ModuleNotFoundError):
            return f"a worker has no {error.name}: install feedplan {__version__} on every worker"
        return ""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Hand a task to the scheduler."""
        future: Future[T] = self._executor.submit(function, *arguments)
        return future

    def stop(self) -> None:
        """Let go of the workers; tasks that they have not begun are forgotten."""
        self._client.close(timeout=_PATIENCE)

    def _require_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise InputError(
                f"the scheduler at {self._address} has no workers; start some: dask worker {self._address} --nthreads 1"
            ) from None
        self._require_versions()
        self._look()

    def _require_versions(self) -> None:
        """The scheduler looks into what it hands on, so it needs feedplan too."""
        found: dict[str, Any] = {}
        try:
            found["the scheduler"] = self._client.run_on_scheduler(installed_version)
        except ImportError as error:
            found["the scheduler"] = error
        for name, answer in self._client.run(installed_version, on_error="return").items():
            found[f"the worker {name}"] = answer
        for name, answer in found.items():
            if answer != __version__:
                has = f"no feedplan ({answer})" if isinstance(answer, BaseException) else f"feedplan {answer}"
                raise InputError(f"{name} has {has}; install feedplan {__version__}, which asks, on all of them")


def require_address(address: str) -> str:
    """Refuse what is not the address of a scheduler."""
    match = _ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match[1]) <= _MAX_PORT:
        raise InputError(
            f'scheduler "{address}" must be tcp://host:port, as tcp://10.0.0.5:8786, with a port up to {_MAX_PORT}'
        )
    return address


def installed_version() -> str:
    """Return the version of feedplan in the process that calls this."""
    return __version__


def _require_scheduler(address: str) -> None:
    """Ask who is there, and do not wait for one who is silent: the client would, for ever."""
    try:
        found = asyncio.run(_identity(address))
    except (OSError, ValueError, TypeError, MemoryError) as error:
        # Nobody, somebody who is silent, or one who does not speak as a scheduler does: its first bytes, read as a length,
        # make a number that may be too large for the memory.
        raise _no_scheduler(address, error) from None
    if found.get("type") != "Scheduler":
        raise InputError(
            f"at {address} there is no scheduler but a {found.get('type')}; give the address of its scheduler"
        )


async def _identity(address: str) -> dict[str, Any]:
    from distributed.core import rpc
    from distributed.security import Security

    remote = rpc(address, timeout=_PATIENCE, connection_args=Security().get_connection_args("client"))
    try:
        answer: dict[str, Any] = await asyncio.wait_for(remote.identity(), 2.0 * _PATIENCE)
    finally:
        await remote.close_rpc()
    return answer


def _no_scheduler(address: str, error: BaseException) -> InputError:
    return InputError(
        f"no Dask scheduler answers at {address} ({str(error) or type(error).__name__}); start one (dask scheduler) or "
        "correct the address"
    )

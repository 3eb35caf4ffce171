"""A process beside this one, to which objects are sent and from which objects come back, in order.

It is started with ``-c``, not by :mod:`multiprocessing`, which would run the user's script a second time to find a function.
Whatever ends it, its work can be done here: :class:`WorkerEndedError` says only that it is gone.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO

_PROGRAM = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from planner.programs.long.worker import serve; serve()"
)

_PATIENCE, _LONG_PATIENCE = 0.2, 5.0  # s, for a process to end by itself: one that may be at work, one that is ending

Receive = Callable[[], Any]
Send = Callable[[Any], None]


class WorkerEndedError(Exception):
    """The process is gone, or never came."""


class Worker:
    """A process that runs ``work(receive, send)``, a function of a module of ours; ``first`` is the first it receives.

    It takes no part in what the terminal sends to this process, Ctrl-C among it, and ends when it is closed, or when nobody
    is left to read what it has to say.
    """

    def __init__(self, work: Callable[[Receive, Send], None], first: Any) -> None:
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,  # what goes wrong there goes wrong here again, and is said once
                start_new_session=True,
                # The processors are taken: threads that wait for a share of a small product take time from this process.
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            raise WorkerEndedError(f"no second process could be started ({error.strerror or error})") from None
        try:
            for message in (sys.path, work, first):
                self.send(message)
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send(self, message: Any) -> None:
        """Send an object; WorkerEndedError where nobody is there to take it."""
        assert self._process.stdin is not None
        try:
            _write(self._process.stdin, message)
        except (OSError, ValueError):  # the pipe is broken, or closed
            raise self._ended() from None

    def receive(self) -> Any:
        """Wait for the next object; WorkerEndedError where none comes any more."""
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError, OSError, ValueError):  # it ended, perhaps in the middle of an object
            raise self._ended() from None

    def close(self, patience: float = _PATIENCE) -> None:
        """Let the process end, which it does by itself where its work is done, and wait for that."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):  # what was still to be sent
                pipe.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(patience)
        self._process.kill()
        self._process.wait()

    def _ended(self) -> WorkerEndedError:
        self.close(_LONG_PATIENCE)
        return WorkerEndedError(f"the second process ended (status {self._process.returncode})")


def serve() -> None:
    """Run the function that is received first, in the process beside."""
    objects = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nothing that is printed may come between the objects
    work = pickle.load(sys.stdin.buffer)
    try:
        work(lambda: pickle.load(sys.stdin.buffer), lambda message: _write(objects, message))
    except (EOFError, OSError):  # nobody is there any more
        os._exit(0)


def _write(file: BinaryIO | Any, message: Any) -> None:
    pickle.dump(message, file, protocol=pickle.HIGHEST_PROTOCOL)
    file.flush()

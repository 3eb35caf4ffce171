"""What the tests of batches have done in other processes; each stands at the top of a module, to be found by its name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from planner.errors import InfeasibleError


def double(value):
    return 2 * value


def process_id(_):
    return os.getpid()


def sleep(seconds):
    time.sleep(seconds)
    return seconds


def refuse(text):
    raise InfeasibleError(text)


def fail(text):
    raise ZeroDivisionError(text)


def exhaust(_):
    raise MemoryError


def threads(_):
    """How many threads the libraries of linear algebra would take here."""
    return [os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")]


def die(marks):
    """Note that it was begun, and die, as a process does for which there is no memory."""
    _note(marks)
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(marks):
    """Die when it is begun for the first time."""
    if _note(marks) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def noted_sleep(marks, seconds):
    """Note that it was begun, and take a while."""
    _note(marks)
    time.sleep(seconds)
    return os.getpid()


def begun(marks):
    """How often it was begun."""
    return len(list(Path(marks).iterdir())) if Path(marks).is_dir() else 0


def _note(marks):
    folder = Path(marks)
    folder.mkdir(exist_ok=True, parents=True)
    count = begun(folder) + 1
    (folder / f"{count}-{os.getpid()}").touch()
    return count

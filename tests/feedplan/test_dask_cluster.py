"""A Dask cluster does what the processes of this machine do; and one that is not there, or dies, is told."""

from __future__ import annotations

import http.server
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import batch_work
import pytest
from cases import PROJECT

import feedplan.dask_cluster
from feedplan.batch import BatchTask, run_batch
from feedplan.dask_cluster import DaskCluster, require_address
from planner import __version__
from planner.errors import InfeasibleError, InputError

distributed = pytest.importorskip("distributed")  # an extra: feedplan[dask]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (PROJECT, PROJECT / "tests")))}


def task(key, work, *arguments):
    return BatchTask(key, key, work, lambda: arguments)


def eventually(holds, seconds=30.0):
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


@pytest.fixture(scope="module")
def cluster():
    """Two processes that work, with a scheduler in this one."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as found:
        yield found


@pytest.fixture
def pool(cluster):
    with DaskCluster(cluster.scheduler_address) as found:
        yield found


class TestTwoWorkers:
    def test_do_what_they_are_given(self, pool):
        found = run_batch([task(str(k), batch_work.double, k) for k in range(20)], pool).outcomes
        assert [outcome.value for outcome in found.values()] == list(range(0, 40, 2))
        assert pool.room() == 4
        assert pool.notes == ()

    def test_errors_come_back(self, pool):
        tasks = [
            task("refused", batch_work.refuse, "no plan for part.ngc"),
            task("wrong", batch_work.fail, "of a kind nobody thought of"),
            task("good", batch_work.double, 21),
        ]
        found = run_batch(tasks, pool).outcomes
        assert isinstance(found["refused"].error, InfeasibleError)
        assert "unexpected ZeroDivisionError: of a kind nobody thought of" in str(found["wrong"].error)
        assert found["good"].value == 42

    def test_one_killed_in_the_middle_loses_nothing_and_nothing_counts_twice(self, pool, tmp_path):
        """What it had begun is begun again by the other, and has one outcome all the same."""
        marks = [tmp_path / str(k) for k in range(10)]
        killed = []

        def kill():
            assert eventually(lambda: sum(map(batch_work.begun, marks)) >= 5)
            now = [int(path.name.partition("-")[2]) for mark in marks if mark.is_dir() for path in mark.iterdir()]
            killed.append(now[-1])
            os.kill(killed[0], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        tasks = [task(f"{k}", batch_work.noted_sleep, marks[k], 0.15) for k in range(10)]
        found = run_batch(tasks, pool)
        killer.join()
        assert list(found.outcomes) == [str(k) for k in range(10)]
        assert not found.interrupted
        assert [outcome.error for outcome in found.outcomes.values()] == [None] * 10
        assert len(killed) == 1
        assert [batch_work.begun(mark) for mark in marks].count(0) == 0
        assert sum(map(batch_work.begun, marks)) > 10  # the death was in the middle of one


class TestWhatIsNotThere:
    @pytest.mark.parametrize(
        "address",
        [
            "",
            "foo",
            "tcp://",
            "tcp://host",
            "host:8786",
            "http://host:80",
            "tcp://host:0",
            "tcp://host:99999",
            "tcp://a b:1",
        ],
    )
    def test_what_is_no_address_is_refused(self, address):
        with pytest.raises(InputError, match=re.escape(f'scheduler "{address}" must be tcp://host:port')):
            DaskCluster(address)

    def test_addresses_of_both_kinds_of_network_are(self):
        for address in ("tcp://10.0.0.5:8786", "tls://scheduler.shop:1", "tcp://[::1]:8786"):
            assert require_address(address) == address

    @pytest.fixture
    def quick(self, monkeypatch):
        monkeypatch.setattr(feedplan.dask_cluster, "_PATIENCE", 0.5)

    def refused(self, address, seconds=3.0):
        began = time.monotonic()
        with pytest.raises(InputError, match="no Dask scheduler answers at ") as error:
            DaskCluster(address)
        assert time.monotonic() - began < seconds
        assert address in str(error.value)

    def test_nobody(self, quick):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.refused(f"tcp://127.0.0.1:{port}")

    def test_one_who_is_silent(self, quick):
        with socket.socket() as silent:
            silent.bind(("127.0.0.1", 0))
            silent.listen()
            self.refused(f"tcp://127.0.0.1:{silent.getsockname()[1]}")

    def test_one_who_speaks_otherwise(self, quick):
        """A page of the web, and a service whose greeting, read as a length, is more than any memory."""

        class Quiet(http.server.SimpleHTTPRequestHandler):
            def log_message(self, *_):
                pass

        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as web:
            threading.Thread(target=web.serve_forever, daemon=True).start()
            self.refused(f"tcp://127.0.0.1:{web.server_port}")
            web.shutdown()
        with socket.socket() as greeting:
            greeting.bind(("127.0.0.1", 0))
            greeting.listen()

            def greet():
                connection, _ = greeting.accept()
                with connection:
                    connection.sendall(b"SSH-2.0-OpenSSH_9.2p1\r\n" * 4)
                    connection.recv(1)

            threading.Thread(target=greet, daemon=True).start()
            self.refused(f"tcp://127.0.0.1:{greeting.getsockname()[1]}")

    def test_a_worker_is_no_scheduler(self, cluster, quick, monkeypatch):
        async def identity(address):
            return {"type": "Worker"}

        monkeypatch.setattr(feedplan.dask_cluster, "_identity", identity)
        with pytest.raises(InputError, match="there is no scheduler but a Worker"):
            DaskCluster(cluster.scheduler_address)

    def test_dask_itself(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "distributed", None)
        with pytest.raises(InputError, match=r'not installed: pip install "feedplan\[dask\]"'):
            DaskCluster("tcp://127.0.0.1:1")

    def test_workers_of_one_version(self, cluster, monkeypatch):
        monkeypatch.setattr(feedplan.dask_cluster, "__version__", "9.9.9")
        with pytest.raises(InputError, match=rf"has feedplan {re.escape(__version__)}; install feedplan 9\.9\.9"):
            DaskCluster(cluster.scheduler_address)


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler in a process of its own, which gives up a task at the first death, and its address."""
    file = tmp_path / "scheduler.json"
    command = "import sys; from distributed.cli.dask_scheduler import main; main()"
    environment = {**ENVIRONMENT, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    arguments = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    run = subprocess.Popen([sys.executable, "-c", command, *arguments], env=environment, stderr=subprocess.DEVNULL)
    try:
        assert eventually(lambda: file.exists() and file.read_text().strip().endswith("}"))
        yield run, json.loads(file.read_text())["address"]
    finally:
        run.kill()
        run.wait()


@pytest.fixture
def workers():
    """Start workers of a scheduler; ended with the test."""
    runs = []

    def start(address, count, *, threads=1, before=""):
        command = f"import sys; {before}from distributed.cli.dask_worker import main; main()"
        arguments = [address, "--no-nanny", "--no-dashboard", "--nthreads", str(threads), "--death-timeout", "20"]
        runs.extend(
            subprocess.Popen([sys.executable, "-c", command, *arguments], env=ENVIRONMENT, stderr=subprocess.DEVNULL)
            for _ in range(count)
        )
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
        return runs

    yield start
    for run in runs:
        run.kill()
        run.wait()


class TestWhatDies:
    def test_a_task_that_kills_every_worker_is_told_and_the_others_are_done(self, scheduler, workers, tmp_path):
        """Others may wait at a worker that it kills: tried again alone, they are done, and it is not."""
        workers(scheduler[1], 3)
        with DaskCluster(scheduler[1]) as pool:
            assert eventually(lambda: pool.room() == 6)
            tasks = [task("dies", batch_work.die, tmp_path / "dies")]
            tasks += [task(str(k), batch_work.double, k) for k in range(6)]
            found = run_batch(tasks, pool).outcomes
        assert re.match("every worker that had it died", str(found["dies"].error))
        assert [found[str(k)].value for k in range(6)] == [0, 2, 4, 6, 8, 10]
        assert batch_work.begun(tmp_path / "dies") == 2

    def test_no_workers_and_one_without_feedplan_are_told(self, scheduler, workers, monkeypatch):
        with monkeypatch.context() as soon:
            soon.setattr(feedplan.dask_cluster, "_PATIENCE", 1.0)
            with pytest.raises(InputError, match=r"has no workers; start some: dask worker tcp:.*:\d+ --nthreads 1"):
                DaskCluster(scheduler[1])
        workers(scheduler[1], 1, before="sys.modules['feedplan'] = None; ")
        with pytest.raises(InputError, match=rf"the worker tcp.* has no feedplan \(.*install feedplan {__version__}"):
            DaskCluster(scheduler[1])

    def test_a_scheduler_that_dies_leaves_what_is_done(self, scheduler, workers, tmp_path):
        workers(scheduler[1], 1)
        marks = [tmp_path / "marks" / str(k) for k in range(6)]

        def kill():
            assert eventually(lambda: batch_work.begun(marks[2]) == 1)
            scheduler[0].kill()

        killer = threading.Thread(target=kill)
        with DaskCluster(scheduler[1]) as pool:
            killer.start()
            began = time.monotonic()
            tasks = [task("0", batch_work.double, 1)]
            tasks += [task(str(k), batch_work.noted_sleep, marks[k], 0.5) for k in range(1, 6)]
            found = run_batch(tasks, pool)
        killer.join()
        assert time.monotonic() - began < 30.0
        assert list(found.outcomes) == [str(k) for k in range(6)]
        assert found.outcomes["0"].value == 2
        for key in "345":
            assert re.match(r"the scheduler at tcp://.* is gone", str(found.outcomes[key].error))

    def test_a_cluster_whose_workers_are_all_gone_is_not_waited_for(self, scheduler, workers, tmp_path):
        (only,) = workers(scheduler[1], 1, threads=2)

        def kill():
            assert eventually(lambda: batch_work.begun(tmp_path / "a") == 1)
            only.kill()

        killer = threading.Thread(target=kill)
        with DaskCluster(scheduler[1], max_idle=2.0) as pool:
            assert "1 of 1 workers have several threads" in pool.notes[0]
            killer.start()
            found = run_batch([task("a", batch_work.noted_sleep, tmp_path / "a", 60.0)], pool).outcomes
        killer.join()
        assert "has had no worker for 2 s" in str(found["a"].error)

    def test_a_scheduler_without_feedplan_is_told(self, cluster, monkeypatch):
        def missing(*_):
            raise ModuleNotFoundError("No module named 'feedplan'")

        monkeypatch.setattr(distributed.Client, "run_on_scheduler", missing)
        with pytest.raises(InputError, match=r"the scheduler has no feedplan \(No module"):
            DaskCluster(cluster.scheduler_address)

"""Installed elsewhere: built by a compiler from the index where there is none, run without compiler and network."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SITES = [path for path in sys.path if path.endswith("site-packages")]
# The last part of the line under "Start" in the README, after what creates the environment and installs.
(README_COMMAND,) = re.findall(r"&& \.venv/bin/(feedplan plan .*)\n", (ROOT / "README.md").read_text(encoding="utf-8"))
# Runs before everything else: nothing is fetched, nothing compiled.
ALONE = """
import sys

def refuse(event, arguments):
    if event in {"socket.connect", "socket.getaddrinfo"}:
        raise RuntimeError(f"the network was asked for: {event}{arguments}")

sys.addaudithook(refuse)
"""


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    builder = pytest.importorskip("hatchling.builders.sdist", reason="needs hatchling, of the extra dev").SdistBuilder
    (file,) = builder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("sdist")))
    return Path(file)


@pytest.fixture
def tree(sdist, tmp_path):
    """The source as it is handed out."""
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "tree", filter="data")
    (found,) = (tmp_path / "tree").iterdir()
    return found


@pytest.fixture
def bare(tmp_path):
    """An environment whose PATH leads nowhere: no compiler, nothing."""
    (tmp_path / "nothing").mkdir()
    kept = {name: value for name, value in os.environ.items() if name not in {"CC", "PYTHONPATH", "VIRTUAL_ENV"}}
    return kept | {"PATH": str(tmp_path / "nothing"), "MPLCONFIGDIR": str(tmp_path)}


@pytest.fixture
def venv(tmp_path):
    """An environment that has what feedplan depends on, and not feedplan; returns its folder of commands."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    (site,) = (tmp_path / "venv").glob("[Ll]ib/**/site-packages")
    (site / "dependencies.pth").write_text("\n".join(SITES))
    return next(path for path in (tmp_path / "venv" / "bin", tmp_path / "venv" / "Scripts") if path.exists())


def run(command, env, cwd, code=0):
    done = subprocess.run(list(map(str, command)), env=env, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout, done.stderr


def pip(venv, *arguments, env, cwd):
    python = venv / "python"
    run([sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", *arguments], env, cwd)


def works_alone(venv, wheel, bare, tmp_path):
    """Install the wheel, and type what the README says, with no compiler and no network."""
    pip(venv, "--no-index", wheel, env=os.environ, cwd=tmp_path)
    (site,) = (tmp_path / "venv").glob("[Ll]ib/**/site-packages")
    (site / "sitecustomize.py").write_text(ALONE)
    command, *arguments = README_COMMAND.split()
    out, err = run([venv / command, *arguments], bare, tmp_path)
    assert "OK  every limit holds" in out
    assert err == ""
    assert {"butterfly.csv", "butterfly.png"} <= set(os.listdir(tmp_path))
    where, _ = run([venv / "python", "-c", "import feedplan; print(feedplan.__file__)"], bare, tmp_path)
    assert Path(where.strip()).is_relative_to(site)


def built(source, env, tmp_path, *options):
    """Build a wheel with pip; returns it."""
    run([sys.executable, "-m", "pip", "wheel", "--no-deps", *options, "-w", tmp_path / "out", source], env, tmp_path)
    (file,) = (tmp_path / "out").iterdir()
    return file


@pytest.mark.slow
def test_a_wheel_from_the_source_runs_alone(sdist, venv, bare, tmp_path):
    wheel = built(sdist, os.environ, tmp_path, "--no-build-isolation", "--no-index")
    assert wheel.name.startswith("feedplan-")
    assert "-py3-none-" in wheel.name
    assert not wheel.name.endswith("-any.whl")
    works_alone(venv, wheel, bare, tmp_path)


@pytest.mark.slow
def test_a_machine_without_a_compiler_gets_one_for_the_build(sdist, venv, bare, tmp_path):
    """pip asks the index for what the hook says it needs; PATH leads nowhere all the time."""
    wheel = built(sdist, bare, tmp_path)
    if sys.platform == "linux":
        assert "manylinux_2_17" in wheel.name  # the compiler from the index aims at old systems
    with zipfile.ZipFile(wheel) as archive:
        assert [name for name in archive.namelist() if name.startswith("planner/_core.")]
    works_alone(venv, wheel, bare, tmp_path)


@pytest.mark.slow
def test_an_editable_install_says_what_to_type_when_the_source_changes(tree, venv, bare, tmp_path):
    pip(venv, "--no-index", "--no-build-isolation", "--editable", tree, env=os.environ, cwd=tmp_path)
    plan = [venv / "feedplan", "plan", "circle", "--intervals", "60"]
    assert "OK  every limit holds" in run(plan, bare, tmp_path)[0]
    with (tree / "planner/core.c").open("a") as file:
        file.write("\n/* edited */\n")
    out, err = run(plan, bare, tmp_path, code=4)
    assert out == ""
    assert re.fullmatch(r"error: the compiled core \S+ was made from other source .*--editable \.\)\n", err)
    run([venv / "python", "hatch_build.py"], os.environ, tree)
    assert "OK  every limit holds" in run(plan, bare, tmp_path)[0]

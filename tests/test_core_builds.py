"""The compiled core built in other ways: with every warning, under sanitizers and valgrind, for the least processor.

Each build stands in a copy of the packages, so that the library of the checkout stays what it is.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("feedplan", "planner", "interp", "benchmarks", "docs", "tests")
ZIG = "ziglang>=0.13"
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g", "-O1")
# The folders and files of tests whose modules call the core.
KERNEL_TESTS = (
    "tests/geometry",
    "tests/interp",
    "tests/plan/dual",
    "tests/plan/solvers",
    "tests/plan/test_guard.py",
    "tests/plan/test_guess.py",
    "tests/plan/test_rows.py",
    "tests/plan/test_speed_law.py",
    "tests/plan/test_stops.py",
    "tests/plan/test_time_map.py",
    "tests/plan/test_utilisation.py",
    "tests/programs/path",
    "tests/programs/reading",
    "tests/verify",
    "tests/test_compiled.py",
)
# CasADi opens its plugins in a way that the sanitizers refuse (RTLD_DEEPBIND).
NO_KERNEL_TESTS = ("--ignore=tests/plan/solvers/test_ipopt.py",)
# Valgrind's tools for errors; what the interpreter, the loader and numpy do is not ours.  A suppression holds for errors
# that happen in these libraries themselves, or in a function of libc that they call; those of the core all count.
KINDS = ("Cond", "Value1", "Value2", "Value4", "Value8", "Value16", "Value32", "Addr1", "Addr2", "Addr4", "Addr8",
         "Addr16", "Addr32", "Jump", "Overlap")  # fmt: skip
OTHERS = ("*python3*", "*ld-linux*", "*numpy*", "*site-packages*.libs*", "*lib-dynload*")
PLANTED = """
#include "planner/core.h"
double planted_fault(const double *x, int64_t n);
double planted_fault(const double *x, int64_t n) { return x[n] > 0.5 ? 1.0 : 2.0; }
"""
PLANTED_HEADER = "/* Reads behind the end. */\ndouble planted_fault(const double *x, int64_t n);\n"
CALL_PLANTED = "import numpy; from planner.compiled import core; print(core.planted_fault(numpy.ones(7), 7))"
# Plans, each written whole: curves of every kind, with and without programs of lines.
PLANS = """
import sys
import numpy as np
from planner import load_curve, load_limits, plan_feedrate, check
from interp import replay
def arrays(name, intervals):
    curve = load_curve(name)
    limits = load_limits("five-axis" if len(curve.axes) > 3 else "mill").for_curve(curve)
    profile = plan_feedrate(curve, limits, intervals=intervals)
    samples = replay(curve, profile)
    ratios = np.array([row.ratio for row in check(curve, limits, profile).rows])
    return {f"{name}-{part}": value for part, value in (("t", profile.t), ("u", profile.u), ("u_rate", profile.u_rate),
            ("acceleration", profile.u_acceleration), ("samples", samples.u), ("ratios", ratios))}
for _ in range(int(sys.argv[2])):
    arrays("circle", 40)
found = {}
for name in ("circle", "teardrop", "butterfly-nurbs", "flank"):
    found |= arrays(name, 150)
np.savez(sys.argv[1], **found)
"""


def copied(folder):
    """A copy of the packages and of what builds the core, with no library in it."""
    unwanted = shutil.ignore_patterns("__pycache__", "_core.*", ".core-*")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=unwanted)
    for name in ("hatch_build.py", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    return folder


def run(folder, *arguments, env=None, code=0):
    """Run a command in a copy; returns what it printed."""
    done = subprocess.run(
        list(map(str, arguments)),
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)} | (env or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout[-4000:] + done.stderr[-8000:]
    return done.stdout + done.stderr


def build(folder, *flags):
    run(folder, sys.executable, "-c", f"import hatch_build; hatch_build.build(extra={flags!r})")


def plant(folder):
    """Add a function with a fault that no test of values finds."""
    (folder / "interp" / "planted.c").write_text(PLANTED)
    (folder / "interp" / "planted.h").write_text(PLANTED_HEADER)


@pytest.fixture(scope="module")
def sanitized(tmp_path_factory):
    """A copy built with the sanitizers, and the environment to run it in."""
    if shutil.which("cc") is None or sys.platform != "linux":
        pytest.skip("needs a C compiler of a Linux system")
    folder = copied(tmp_path_factory.mktemp("sanitized"))
    plant(folder)
    build(folder, *SANITIZERS)
    libraries = [subprocess.run(["cc", f"-print-file-name={name}.so"], capture_output=True, text=True, check=True).stdout
                 for name in ("libasan", "libubsan")]  # fmt: skip
    # What the interpreter does not free at its end is no leak of the core, which frees what it takes in the same call.
    return folder, {"LD_PRELOAD": " ".join(map(str.strip, libraries)), "ASAN_OPTIONS": "detect_leaks=0"}


@pytest.mark.slow
class TestSanitizers:
    def test_they_see_a_planted_fault(self, sanitized):
        folder, env = sanitized
        said = run(folder, sys.executable, "-c", CALL_PLANTED, env=env, code=1)
        assert "heap-buffer-overflow" in said
        assert "planted_fault" in said

    def test_the_tests_of_the_kernels_pass(self, sanitized):
        folder, env = sanitized
        # what a sanitizer says as it ends the process must not end with it
        capture = ("--capture=sys", "-p", "no:cacheprovider")
        pytest_run = (sys.executable, "-m", "pytest", "-q", "-x", *capture, "-c", "pyproject.toml")
        assert " passed" in run(folder, *pytest_run, "-o", "addopts=--import-mode=importlib", *KERNEL_TESTS,
                                *NO_KERNEL_TESTS, "-m", "not slow", env=env)  # fmt: skip


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """A function that runs Python in a copy under valgrind, with a fault planted in it."""
    if shutil.which("valgrind") is None or shutil.which("cc") is None:
        pytest.skip("needs valgrind and a C compiler")
    folder = copied(tmp_path_factory.mktemp("valgrind"))
    plant(folder)
    build(folder, "-g")
    lines = [
        f"{{\n {kind} in {library}\n Memcheck:{kind}\n {called}obj:{library}\n ...\n}}\n"
        for kind in KINDS
        for library in OTHERS
        for called in ("", "obj:*vgpreload*\n ", "obj:*libc.so*\n ")
    ]
    (folder / "others.supp").write_text("".join(lines))
    command = ("valgrind", "-q", "--error-exitcode=9", "--num-callers=30", "--suppressions=others.supp",
               sys.executable)  # fmt: skip
    env = {"PYTHONMALLOC": "malloc", "OPENBLAS_NUM_THREADS": "1"}
    return lambda *arguments, code=0: run(folder, *command, *arguments, env=env, code=code)


@pytest.mark.slow
class TestValgrind:
    def test_it_sees_a_planted_fault(self, checked):
        said = checked("-c", CALL_PLANTED, code=9)
        assert "Invalid read of size 8" in said
        assert "planted_fault" in said

    def test_a_plan_and_its_check_are_clean(self, checked):
        said = checked("-m", "feedplan", "plan", "circle", "--intervals", "60")
        assert "OK  every limit holds" in said
        assert "==" not in said


@pytest.mark.slow
def test_no_compiler_warns(tmp_path):
    """The system's with every warning an error, and the one from the index."""
    folder = copied(tmp_path)
    run(folder, sys.executable, "-m", "pip", "install", "-q", "--target", tmp_path / "zig", ZIG)
    env = {"PYTHONPATH": f"{folder}{os.pathsep}{tmp_path / 'zig'}"}
    code = "import hatch_build as h\nfor c in (h.system_compiler(), h.zig_compiler()):\n"
    code += "    if c: h.build(extra=('-Werror', '-Wshadow'), compiler=c); print(c)"
    assert "ziglang" in run(folder, sys.executable, "-c", code, env=env)
    run(folder, sys.executable, "-c", PLANS, tmp_path / "zig.npz", 0)  # the last one built also plans


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """A function that returns the arrays of some plans, made by a process of its own."""
    folders = {flag: copied(tmp_path_factory.mktemp("core")) for flag in ("-DFEEDPLAN_ONE_TARGET", "-DFEEDPLAN_HERE")}
    for flag, folder in folders.items():
        build(folder, flag)

    def made(*, one_target=False, earlier=0, **env):
        folder = folders["-DFEEDPLAN_ONE_TARGET" if one_target else "-DFEEDPLAN_HERE"]
        run(folder, sys.executable, "-c", PLANS, folder / "plans.npz", earlier, env=env)
        with np.load(folder / "plans.npz") as archive:
            return dict(archive)

    return made


@pytest.fixture(scope="module")
def usual(plans):
    return plans()


@pytest.mark.slow
class TestResults:
    @pytest.mark.parametrize(
        "other", [{}, {"earlier": 20}, {"OPENBLAS_NUM_THREADS": "1"}, {"OPENBLAS_NUM_THREADS": "4"}]
    )
    def test_the_same_machine_gives_the_same_bytes(self, plans, usual, other):
        """Twice, after twenty plans in the same process, and whatever the number of threads."""
        found = plans(**other)
        assert found.keys() == usual.keys()
        assert all(found[name].tobytes() == usual[name].tobytes() for name in usual)

    def test_they_do_not_depend_on_the_processor(self, plans, usual):
        found = plans(one_target=True)
        for name, value in usual.items():
            scale = np.abs(value).max()
            np.testing.assert_allclose(found[name], value, rtol=1e-12, atol=1e-12 * scale, err_msg=name)

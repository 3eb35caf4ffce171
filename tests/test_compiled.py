"""The compiled core: what headers declare is what Python may call, and with nothing else; a stale library says so."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from planner import compiled, core_source
from planner.compiled import Core, prototypes
from planner.errors import CoreError

ROOT = Path(__file__).parents[1]
HEADER = """
#ifndef SAMPLE_H
#define SAMPLE_H
/* Adds f * x[n] to y[n]; returns the last sum; void nothing(void); stands in a comment. */
double sample_add(int64_t n, double f,
                  const double *x, double *restrict y);
int64_t sample_count(const uint8_t *flags, int64_t n);  // how many are set
#endif
"""
SOURCE = """
#include "planner/core.h"
#include "interp/sample.h"
double sample_add(int64_t n, double f, const double *x, double *restrict y) {
    for (int64_t i = 0; i < n; i++) y[i] += f * x[i];
    return n ? y[n - 1] : 0.0;
}
int64_t sample_count(const uint8_t *flags, int64_t n) {
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) count += flags[i] != 0;
    return count;
}
"""


@pytest.fixture(scope="module")
def hook():
    pytest.importorskip("hatchling", reason="needs hatchling, of the extra dev")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture
def sample(hook, monkeypatch, tmp_path):
    """A core of two functions, built in a folder of its own."""
    if hook.system_compiler() is None:
        pytest.skip("needs a C compiler")
    for folder in ("planner", "interp"):
        (tmp_path / folder).mkdir()
    for name in ("core.h", "core.c", "core_source.py"):
        (tmp_path / "planner" / name).write_bytes((ROOT / "planner" / name).read_bytes())
    (tmp_path / "interp" / "sample.h").write_text(HEADER)
    (tmp_path / "interp" / "sample.c").write_text(SOURCE)
    monkeypatch.setattr(hook, "ROOT", tmp_path)
    monkeypatch.setattr(compiled, "_ROOT", tmp_path)
    hook.build()
    return tmp_path


def test_prototypes_of_a_header():
    assert prototypes(HEADER) == {
        "sample_add": ("double", ["int64_t n", "double f", "const double *x", "double *restrict y"]),
        "sample_count": ("int64_t", ["const uint8_t *flags", "int64_t n"]),
    }


def test_functions_are_called_as_declared(sample):
    core = Core()
    y = np.array([1.0, 2.0])
    assert core.sample_add(2, 3, np.array([1.0, 10.0]), y) == 32.0
    assert y.tolist() == [4.0, 32.0]
    assert core.sample_add(0, 1.0, None, None) == 0.0
    assert core.sample_count(np.array([True, False, True]), 3) == 2
    again = core.sample_add.bind(2, 1.0, np.ones(2), y)
    assert [again(), again()] == [33.0, 34.0]
    partly = core.sample_add.bind(2, 1.0)
    assert [partly(np.ones(2), y), partly(np.zeros(2), y)] == [35.0, 35.0]
    with pytest.raises(TypeError, match="sample_add takes 4 arguments"):
        partly(y)
    with pytest.raises(TypeError, match="y must be contiguous and writable"):
        partly(y, np.ones(4)[::2])


def test_wrong_arguments_are_refused(sample):
    core, x, y = Core(), np.ones(4), np.ones(4)
    frozen = np.ones(4)
    frozen.flags.writeable = False
    assert core.sample_add(2, 1.0, frozen, y) == 2.0
    for arguments, message in (
        ((2, 1.0, x), "sample_add takes 4 arguments, not 3"),
        ((2, 1.0, [1.0, 1.0], y), "x must be an array of float64, not list"),
        ((2, 1.0, x.astype(np.float32), y), "x must be an array of float64, not float32"),
        ((2, 1.0, x[::2], y), "x must be contiguous"),
        ((2, 1.0, x, frozen), "y must be contiguous and writable"),
    ):
        with pytest.raises(TypeError, match=message):
            core.sample_add(*arguments)
    with pytest.raises(AttributeError, match="declares no function 'sample_subtract'"):
        core.sample_subtract  # noqa: B018


def test_a_stale_library_says_what_to_type(sample):
    (sample / "interp" / "sample.c").write_text(SOURCE + "\n/* edited */\n")
    with pytest.raises(CoreError, match=r"other source .* pip install"):
        Core().sample_add(0, 1.0, None, None)


def test_a_missing_library_says_what_to_type(sample):
    core_source.core_file(sample).unlink()
    with pytest.raises(CoreError, match=r"missing .* pip install"):
        Core().sample_add(0, 1.0, None, None)


def test_a_file_that_is_no_library_says_what_to_type(sample):
    core_source.core_file(sample).unlink()  # not written over: who has it loaded would read what is new
    core_source.core_file(sample).write_bytes(b"no library")
    with pytest.raises(CoreError, match=r"cannot be loaded .* pip install"):
        Core().sample_add(0, 1.0, None, None)


def test_another_library_says_what_to_type(sample):
    """Which has no ``core_source``."""
    (sample / "planner" / "core.c").write_text("int something_else(void) { return 0; }\n")
    file = core_source.core_file(sample)
    file.unlink()
    subprocess.run(["cc", "-shared", "-fPIC", sample / "planner" / "core.c", "-o", file], check=True)
    with pytest.raises(CoreError, match=r"cannot be loaded .*core_source.* pip install"):
        Core().sample_add(0, 1.0, None, None)


def test_a_declaration_of_another_form_is_refused(sample, hook):
    (sample / "interp" / "sample.h").write_text(HEADER + "double sample_wide(long n);\n")
    (sample / "interp" / "sample.c").write_text(SOURCE + "double sample_wide(long n) { return n; }\n")
    hook.build()
    with pytest.raises(CoreError, match="declaration 'long n'"):
        Core().sample_wide  # noqa: B018


def test_line_ends_of_a_checkout_do_not_count(sample):
    before = core_source.source_hash(core_source.source_texts(sample))
    (sample / "interp" / "sample.c").write_bytes(SOURCE.replace("\n", "\r\n").encode())
    assert core_source.source_hash(core_source.source_texts(sample)) == before


def test_a_compiler_that_fails_leaves_the_library_alone(sample, hook):
    file = core_source.core_file(sample)
    before = file.read_bytes()
    (sample / "interp" / "sample.c").write_text("this is no C\n")
    with pytest.raises(RuntimeError, match="C compiler failed"):
        hook.build()
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir() if path.name.startswith(".core-")] == []


def test_the_source_compiles_without_a_warning(hook, tmp_path):
    if hook.system_compiler() is None:
        pytest.skip("needs a C compiler")
    hook.build(tmp_path / "core", extra=("-Werror",))


def test_every_declared_function_is_in_the_library():
    core = Core()
    for name in core._declared:
        assert getattr(core, name).name == name

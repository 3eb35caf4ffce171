"""The steps in C against the same steps in plain Python, bit by bit, and as a controller compiles them."""

from __future__ import annotations

import gc
import re
import shutil
import subprocess
import weakref
from functools import partial

import numpy as np
import pytest
import steps_reference as plain
from cases import PROJECT, drives
from tables import random_feed, random_pieces, random_segments, random_state, same_bits

from interp import InterpolatorTable, TaylorTable, quintic_step, replay, start, stepping, taylor_step
from interp.taylor import runner
from planner import load_curve
from planner.compiled import core
from planner.errors import InputError

SEEDS = range(40)
COUNT = 60


# ---- against plain Python ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_quintic_has_the_bits_of_plain_python(seed):
    rng = np.random.default_rng(seed)
    pieces, dim = random_pieces(rng, tip=False)
    segments = random_segments(rng, len(pieces) - 1)
    state = random_state(rng, pieces, dim, last=COUNT - 5)
    expected = np.empty(COUNT), np.empty(COUNT * dim), state.copy()
    plain.quintic_run(segments, pieces, expected[2], *expected[:2])
    found = np.empty(COUNT), np.empty(COUNT * dim), state.copy()
    core.quintic_run(segments, pieces, found[2], COUNT, *found[:2])
    assert all(map(same_bits, found, expected))
    assert (np.diff(found[0]) >= 0.0).all()
    assert np.unique(found[1]).size > 10 * dim
    stepped, rows = state.copy(), []
    for _ in range(COUNT):
        quintic_step(segments, pieces, stepped)
        rows.append(stepped[-dim:].copy())
    assert same_bits(np.ravel(rows), expected[1])
    assert same_bits(stepped, expected[2])


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_taylor_step_has_the_bits_of_plain_python(seed, order):
    rng = np.random.default_rng(seed)
    pieces, dim = random_pieces(rng, tip=seed % 3 == 0)
    feed = random_feed(rng)
    state = random_state(rng, pieces, dim, last=COUNT - 5)
    expected = np.empty(COUNT), np.empty(COUNT * dim), state.copy()
    with np.errstate(all="ignore"):
        plain.taylor_run(order, feed, pieces, expected[2], *expected[:2])
    found = np.empty(COUNT), np.empty(COUNT * dim), state.copy()
    core.taylor_run(order, feed, pieces, found[2], COUNT, *found[:2])
    assert all(map(same_bits, found, expected))
    assert found[0][0] < found[0][3]
    stepped, rows = state.copy(), []
    for _ in range(COUNT):
        taylor_step(order, feed, pieces, stepped)
        rows.append(stepped[-dim:].copy())
    assert same_bits(np.ravel(rows), expected[1])
    assert same_bits(stepped, expected[2])


def test_a_run_of_no_steps_changes_nothing():
    rng = np.random.default_rng(0)
    pieces, dim = random_pieces(rng, tip=False)
    state = random_state(rng, pieces, dim, last=7)
    before = state.copy()
    core.quintic_run(random_segments(rng, len(pieces) - 1), pieces, state, 0, np.empty(0), np.empty(0))
    core.taylor_run(2, random_feed(rng), pieces, state, 0, np.empty(0), np.empty(0))
    assert same_bits(state, before)


def test_a_curve_that_stands_still_takes_no_taylor_step():
    # |C'| = 0: the series would be nan, or infinite
    rng = np.random.default_rng(1)
    pieces, dim = random_pieces(rng, tip=False)
    pieces[:-1, 1 : 1 + dim, :-1] = 0.0
    if pieces.shape[1] > dim + 1:
        pieces[:-1, -1, :-1] = 0.0
    state = random_state(rng, pieces, dim, last=10)
    u, positions = np.empty(8), np.empty(8 * dim)
    core.taylor_run(3, random_feed(rng), pieces, state, 8, u, positions)
    assert (u == u[0]).all()
    assert np.isfinite(positions).all()


# ---- the state -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan():
    from feedplan import plan_feedrate

    curve = load_curve("circle")
    return plan_feedrate(curve, drives())


def test_indices_are_those_of_the_header():
    text = (PROJECT / "interp" / "step_inline.h").read_text(encoding="utf-8")
    inside = re.search(r"enum \{\n(.*?)\n\};", text, re.DOTALL)[1]
    names = re.findall(r"^\s+([A-Z_]+)", inside, re.MULTILINE)
    theirs = {"PARAMETER": "U", "STATE_END": "END"}
    assert [getattr(stepping, theirs.get(name, name)) for name in names] == list(range(stepping.END + 1))


def test_a_state_of_another_table_is_refused(plan):
    table, taylor = InterpolatorTable.from_profile(plan), TaylorTable.from_profile(plan)
    state = start(table, 1e-3)
    with pytest.raises(
        InputError, match=r"state of 15 numbers does not belong to these arrays, .*; make it with start"
    ):
        quintic_step(*taylor.arrays, state)
    with pytest.raises(InputError, match=r"does not belong"):
        quintic_step(table.segments, table.pieces[:, :-1].copy(), state)
    with pytest.raises(InputError, match=r"does not belong"):
        quintic_step(*table.arrays, state[:-1].copy())
    with pytest.raises(InputError, match=r"does not belong"):
        taylor_step(1, *table.arrays, state)
    with pytest.raises(InputError, match=r"order = 4 must be 1, 2 or 3"):
        taylor_step(4, *taylor.arrays, start(taylor, 1e-3))


def test_a_state_follows_the_arrays_it_is_given(plan):
    """What is kept from the first call belongs to its arrays, its order and this state alone."""
    table, taylor = InterpolatorTable.from_profile(plan), TaylorTable.from_profile(plan)
    state, other = start(table, 1e-3), start(table, 1e-3)
    for _ in range(100):
        quintic_step(*table.arrays, state)
    copied, viewed = state.copy(), other[:]
    assert other[stepping.SAMPLE] == 0.0
    quintic_step(*table.arrays, copied)
    assert (state[stepping.SAMPLE], copied[stepping.SAMPLE]) == (100.0, 101.0)
    quintic_step(*table.arrays, viewed)
    assert other[stepping.SAMPLE] == 1.0
    shifted = table.segments.copy()
    shifted[:-1, 1] += 1e-3
    expected = copied.copy()
    quintic_step(shifted, table.pieces, copied)
    quintic_step(*table.arrays, expected)
    assert copied[stepping.U] > expected[stepping.U]
    first, third = start(taylor, 1e-2), start(taylor, 1e-2)
    for order in (1, 1, 3, 3):
        taylor_step(order, *taylor.arrays, first)
        taylor_step(3, *taylor.arrays, third)
    assert first[stepping.U] != third[stepping.U]
    for current, take in ((table, quintic_step), (taylor, partial(taylor_step, 2))):
        kept, any_array = start(current, 1e-3), np.array(start(current, 1e-3))
        assert type(any_array) is np.ndarray
        for _ in range(3):
            assert not take(*current.arrays, kept)
            assert not take(*current.arrays, any_array)
        assert same_bits(any_array, kept)


def test_a_state_is_gone_when_nobody_has_it(plan):
    table = InterpolatorTable.from_profile(plan)
    state = start(table, 1e-3)
    seen = weakref.ref(state)
    quintic_step(*table.arrays, state)
    del state
    gc.collect()
    assert seen() is None


# ---- in a controller -----------------------------------------------------------------------------------------------

CONTROLLER = r"""
#include <stdio.h>
#include <stdlib.h>
#include "interp/interp.h"
#include "interp/step_inline.h"

/* Reads three arrays, each behind its size, steps to the end, and writes each sample. */
static double *array(void)
{
    int64_t size;
    if (fread(&size, sizeof size, 1, stdin) != 1)
        exit(1);
    double *found = malloc(size * sizeof *found);
    if (!found || fread(found, sizeof *found, size, stdin) != (size_t)size)
        exit(1);
    return found;
}

int main(void)
{
    double *segments = array(), *pieces = array(), *state = array();
    const int64_t dim = (int64_t)state[DIM];
    for (int64_t done = 0; !done;) {
        done = quintic_step(segments, pieces, state);
        fwrite(&state[PARAMETER], sizeof *state, 1, stdout);
        fwrite(state + STATE_END + dim, sizeof *state, dim, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def compiler():
    found = shutil.which("cc")
    if found is None:
        pytest.skip("needs a C compiler")
    return [found, "-std=c11", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", f"-I{PROJECT}"]


def test_a_controller_compiles_the_step_by_itself_and_gets_the_samples_of_replay(compiler, plan, tmp_path):
    program = tmp_path / "controller"
    (tmp_path / "controller.c").write_text(CONTROLLER)
    files = [tmp_path / "controller.c", PROJECT / "interp" / "quintic.c"]
    subprocess.run([*compiler, *map(str, files), "-o", str(program)], check=True)
    table = InterpolatorTable.from_profile(plan)
    arrays = *table.arrays, np.asarray(start(table, 1e-3))
    given = b"".join(np.int64(array.size).tobytes() + array.tobytes() for array in arrays)
    rows = np.frombuffer(subprocess.run([program], input=given, stdout=subprocess.PIPE, check=True).stdout)
    rows = rows.reshape(-1, 1 + table.dim)
    samples = replay(plan.curve, plan, 1e-3)
    assert same_bits(rows[:, 0], samples.u[1:])
    assert same_bits(np.ravel(rows[:, 1:]), np.ravel(samples.position[1:]))


@pytest.mark.parametrize("name", ["quintic", "taylor"])
def test_the_steps_call_nothing(compiler, tmp_path, name):
    """Neither memory nor the mathematical library: what a real-time thread may not wait for."""
    made = tmp_path / f"{name}.o"
    source = PROJECT / "interp" / f"{name}.c"
    subprocess.run([*compiler, "-fno-math-errno", "-c", str(source), "-o", str(made)], check=True)
    listed = subprocess.run(["nm", "-u", str(made)], capture_output=True, text=True, check=True).stdout
    assert listed.split() == []


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_a_run_writes_as_many_steps_as_there_is_room_for(plan, order):
    table = (InterpolatorTable if order == 5 else TaylorTable).from_profile(plan)
    u, positions = np.full(12, np.pi), np.full(24, np.pi)
    state = start(table, 1e-3)
    runner(table, order)(state, u[:10], positions[:20])
    assert (u[10:] == np.pi).all()
    assert (positions[20:] == np.pi).all()
    assert (u[:10] != np.pi).all()
    assert state[stepping.SAMPLE] == 10.0

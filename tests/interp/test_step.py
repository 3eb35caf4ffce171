"""The interpolator of a controller: the bits of replay, places, lines, snapshots; and what it needs to be compiled."""

import shutil
import subprocess

import numpy as np
import pytest
from cases import PROJECT
from tables import same_bits

from interp import PlanStep, replay
from interp.plan_file import plan_bytes
from planner import Limits, load_curve, plan_feedrate
from planner.errors import InputError

LIMITS = Limits(100.0, 300.0, 1000.0, 20000.0)
LINES = [(0.0, 1), (0.25, 4), (0.25, 5), (0.5, 2)]
FREE = ["-std=c11", "-ffreestanding", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wconversion"]


@pytest.fixture(scope="module")
def plan():
    curve = load_curve("butterfly-nurbs")
    return plan_feedrate(curve, LIMITS.on(curve), override_reserve=0.09)


@pytest.fixture(scope="module")
def content(plan):
    return plan_bytes(plan, LIMITS.on(plan.curve), lines=LINES)


# ---- against replay --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.25e-3, 0.4e-3, 1e-3, 2e-3])
def test_at_full_rate_it_has_the_bits_of_replay(plan, content, period):
    expected = replay(plan.curve, plan, period)
    found = PlanStep(content, period).samples(plan.curve.axes)
    assert same_bits(np.ravel(found.position), np.ravel(expected.position))
    assert same_bits(found.u, expected.u)


@pytest.mark.parametrize("name", ["teardrop", "circle", "flank"])
def test_other_curves_have_the_bits_of_replay(name):
    from feedplan.job import load_job

    job = load_job(name)
    profile = job.plan()
    expected = job.replay(profile)
    step = PlanStep(plan_bytes(profile, job.limits))
    found = step.samples(job.curve.axes)
    assert same_bits(np.ravel(found.position), np.ravel(expected.position))
    assert same_bits(found.u, expected.u)
    assert step.done


def test_one_step_at_a_time_is_the_same(plan, content):
    expected = replay(plan.curve, plan, 1e-3)
    step = PlanStep(content, 1e-3)
    rows = [step.position.copy()]
    done = False
    while not done:
        done = step.step()
        rows.append(step.position.copy())
    assert same_bits(np.ravel(rows), np.ravel(expected.position))
    assert step.step()  # held
    assert (step.position == expected.position[-1]).all()


def test_after_a_hold_it_is_the_plan_again(plan, content):
    """At full rate again, the samples are points of the plan at times that lie one period apart."""
    step = PlanStep(content, 1e-3)
    step.run(1000)
    step.run(3000, hold=True)
    assert step.rate == 0.0
    still = step.position.copy()
    _, course = step.run(100_000, hold=True)
    assert (step.position == still).all()
    assert np.ptp(course[1:, 0]) == 0.0
    step.run(2000)
    positions, course = step.run(500)
    assert (course[:, 1] == 1.0).all()
    assert np.diff(course[:, 0]) == pytest.approx(1e-3, abs=1e-15)
    states = plan.at(course[:, 0])
    assert np.abs(plan.curve.derivatives(states.u, 0)[0] - positions).max() < 1e-10


# ---- places ----------------------------------------------------------------------------------------------------------


def test_seek_by_sample_goes_on_as_the_run_did(content):
    whole, _ = PlanStep(content, 1e-3).run(5000)
    for sample in (0, 1, 777, 4001):
        step = PlanStep(content, 1e-3)
        step.seek(sample=sample, rate=1.0)
        assert sample == 0 or same_bits(step.position, whole[sample - 1])
        positions, _ = step.run(200)
        assert same_bits(positions.ravel(), whole[sample : sample + 200].ravel())


def test_seek_by_time_goes_to_that_point(plan, content):
    step = PlanStep(content, 1e-3)
    for time in (0.0, 0.3, 1.2345678, plan.duration - 1e-4, plan.duration):
        step.seek(time)
        assert step.time == pytest.approx(time, abs=1e-15)
        assert step.rate == 0.0
        there = plan.curve.derivatives(plan.at(time).u, 0)[0]
        assert np.abs(there - step.position).max() < 1e-10
        assert step.progress == pytest.approx(time / plan.duration)
    assert step.done


@pytest.mark.parametrize(
    "place",
    [
        {"time": -1.0},
        {"time": 1e9},
        {"sample": -1},
        {"sample": 10**9},
        {"sample": 2**70},
        {"sample": 1.5},
        {"sample": np.nan},
        {"time": 1.0, "rate": 1.5},
    ],
)
def test_places_outside_the_plan_are_refused(content, place):
    with pytest.raises(InputError, match="must lie within the plan"):
        PlanStep(content).seek(**place)


@pytest.mark.parametrize(
    "signals", [{"count": -1}, {"count": 3, "override": [1.0, 0.5]}, {"count": 2, "hold": [[True]]}]
)
def test_signals_of_another_length_are_refused(content, signals):
    with pytest.raises(InputError, match=r"count = -?\d must be >= 0, and override and hold, of the shapes"):
        PlanStep(content).run(**signals)


def test_seek_needs_one_place(content):
    for place in ({}, {"time": 1.0, "sample": 3}):
        with pytest.raises(InputError, match="either a time or a sample"):
            PlanStep(content).seek(**place)


def test_the_line_is_the_last_that_began(content):
    step = PlanStep(content)
    for time, line in ((0.0, 1), (0.2499, 1), (0.25, 5), (0.4, 5), (0.5, 2), (3.0, 2)):
        step.seek(time)
        assert step.line == line
    assert PlanStep(plan_bytes(plan_feedrate(load_curve("teardrop"), LIMITS))).line == 0


def test_a_snapshot_continues_identically(content):
    rng = np.random.default_rng(0)
    step = PlanStep(content, 1e-3)
    override = rng.random(2000)
    step.run(1000, override[:1000])
    kept = step.snapshot()
    first, _ = step.run(1000, override[1000:])
    step.restore(kept)
    second, _ = step.run(1000, override[1000:])
    assert same_bits(first.ravel(), second.ravel())
    with pytest.raises(InputError, match="snapshot has"):
        step.restore(kept[:-1])


def test_what_lies_outside_0_and_1_counts_as_the_nearer_end(content):
    for asked, meant in ((1.7, 1.0), (np.inf, 1.0), (-3.0, 0.0), (np.nan, 0.0)):
        found, expected = (PlanStep(content).run(300, value)[0] for value in (asked, meant))
        assert same_bits(found.ravel(), expected.ravel())


def test_a_start_at_any_rate_is_at_once(content):
    step = PlanStep(content)
    step.step(0.25)
    assert (step.rate, step.rate_slope) == (0.25, 0.0)
    assert step.time == 0.25 * step.period


def test_held_for_ever_says_so(content):
    with pytest.raises(InputError, match="held for ever"):
        PlanStep(content).samples(override=0.0)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf, 1e-12])
def test_periods_that_are_none_are_refused(content, period):
    with pytest.raises(InputError, match=r"period = .* must be > 0 and finite"):
        PlanStep(content, period)


# ---- as a controller compiles it -------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", ["-O0", "-O2", "-O3"])
def test_it_builds_without_a_word_and_calls_nothing_but_memcpy_and_sqrt(tmp_path, level):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    made = tmp_path / "step.o"
    # Copied out of the project: three files are all that a controller takes.
    for name in ("step.h", "step.c", "step_inline.h"):
        shutil.copy(PROJECT / "interp" / name, tmp_path)
    done = subprocess.run(
        [compiler, *FREE, level, "-c", str(tmp_path / "step.c"), "-o", str(made)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    listed = subprocess.run(["nm", "-u", str(made)], capture_output=True, text=True, check=True).stdout
    assert set(listed.replace("U ", "").split()) <= {"memcpy", "sqrt", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


def test_it_builds_for_a_cortex_m(tmp_path, capsys):
    compiler = shutil.which("arm-none-eabi-gcc")
    if compiler is None:
        pytest.skip("needs arm-none-eabi-gcc")
    made = tmp_path / "step.o"
    machine = ["-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard"]
    subprocess.run(
        [compiler, *FREE, *machine, "-O2", "-c", str(PROJECT / "interp" / "step.c"), "-o", str(made)], check=True
    )
    row = subprocess.run(["arm-none-eabi-size", str(made)], capture_output=True, text=True, check=True).stdout
    text, data, bss = map(int, row.splitlines()[1].split()[:3])
    with capsys.disabled():
        print(f"\nstep.c on a Cortex-M7: {text} bytes of code and constants, {data + bss} of data")
    assert text < 16_000
    assert data + bss == 0

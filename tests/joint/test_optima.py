"""The oracle by IPOPT against closed forms, and the optima kept of it."""

import json

import pytest
from joint_reference import GRIDS, OPTIMA, cases, optimum, polygon, solve_reference, stopping_motion

CASES = cases()
KEPT = json.loads(OPTIMA.read_text(encoding="utf-8"))


@pytest.mark.parametrize(("length", "off"), [(0.05, 1e-5), (1.0, 1e-5), (20.0, 2e-4)])
def test_the_oracle_finds_the_closed_form_of_a_single_line(length, off):
    run = polygon([[0.0, 0.0], [0.6 * length, 0.8 * length]], 1e-3)
    motion, used = solve_reference(run, GRIDS[1], passes=1)
    assert used < 1.05
    assert motion.duration == pytest.approx(stopping_motion(run).duration, rel=off)


def test_the_optima_kept_are_those_of_the_cases():
    assert set(KEPT) == set(CASES)
    for name, run in CASES.items():
        if not run.legs.curved.any():
            assert 0.7 < KEPT[name]["seconds"] / stopping_motion(run).duration < 0.995, name


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_ipopt_finds_the_optimum_again(name):
    assert optimum(CASES[name])[0] == pytest.approx(KEPT[name]["seconds"], rel=2e-5)

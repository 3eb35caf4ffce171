"""The joint solver against IPOPT on small runs, and the oracle itself against closed forms."""

import json

import pytest
from joint_reference import GRIDS, OPTIMA, cases, optimum, polygon, solve_reference, stopping_motion

from benchmarks.joint import SYNTHETIC
from benchmarks.motion_check import defects
from planner.joint import exact_stop
from planner.joint.solve import solve_run

CASES = cases()
KEPT = json.loads(OPTIMA.read_text(encoding="utf-8"))
SAME = 2e-4  # of the time
GRID = 1.5e-3  # of the time: what more segments than those of long runs would save


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


@pytest.mark.parametrize("name", CASES)
def test_the_solver_finds_the_optimum_of_ipopt(name, monkeypatch):
    """On more segments or its own within 2e-4, either way; on those of long runs it is above by what fewer cost."""
    run, wanted = CASES[name], KEPT[name]["seconds"]
    usual = solve_run(run)
    found = [usual.duration]
    for segments in ((24, 12), (exact_stop._PER_ZONE, exact_stop._PER_MIDDLE)):
        monkeypatch.setattr(exact_stop, "_PER_ZONE_OF_FEW", segments[0])
        monkeypatch.setattr(exact_stop, "_PER_MIDDLE_OF_FEW", segments[1])
        motion = solve_run(run)
        assert defects(run, motion) == []
        found.append(motion.duration)
    assert defects(run, usual) == []
    assert min(found[:2]) == pytest.approx(wanted, rel=SAME)  # as IPOPT's is the best of several grids
    assert -SAME < found[0] / wanted - 1.0 < SAME
    assert -SAME < found[2] / wanted - 1.0 < GRID


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("raster of 15 corners, 20 mm lines", (3.255, 2.983, 2.645)),
        ("octagon", (1.3506, 1.1883, 0.8825)),
        ("sawtooth of 10 legs", (2.4156, 2.2300, 2.2234)),
    ],
)
def test_times_that_an_earlier_solver_found(name, known):
    """With rows at the nodes alone, and as many passes as it took."""
    for tolerance, seconds in zip((1e-3, 1e-2, 5e-2), known, strict=True):
        assert solve_run(polygon(SYNTHETIC[name], tolerance)).duration == pytest.approx(seconds, rel=GRID)

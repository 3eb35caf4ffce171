"""The bound of every motion within the tolerance of a program."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import PROGRAMS, drives
from program_blocks import line, polyline, program

from planner import plan_feedrate
from planner.joint.bound import time_of_way
from planner.programs.path import any_path
from planner.programs.path.any_path import any_path_bound
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))


@pytest.mark.parametrize(("name", "least"), [("zigzag", 0.993), ("slots", 0.90)])
def test_it_is_below_every_plan_and_near_the_fastest(name, least):
    source = read_program(PROGRAMS / f"{name}.ngc")
    bound = any_path_bound(source, 0.01, LIMITS)
    for path in ("joint", "separate"):
        made = program_path(source, 0.01, LIMITS, path=path)
        time = plan_feedrate(made.curve, LIMITS.for_curve(made.curve)).duration
        assert bound <= time
        if path == "joint":
            assert bound >= least * time


def test_stops_are_counted():
    corner = [[0, 0], [12, 0], [12, 12]]
    through = polyline(corner)
    stopped = replace(through, stop_after=np.array([True, False]))
    alone = any_path_bound(program(line(12, 0)), 0.01, LIMITS)
    assert any_path_bound(stopped, 0.01, LIMITS) == pytest.approx(2.0 * alone, rel=1e-9)
    assert any_path_bound(through, 0.01, LIMITS) < 2.0 * alone
    rest = np.zeros((2, 1))
    wanted = time_of_way(np.array([12.0]), np.array([[100.0], [1000.0], [20000.0]]), rest, rest)
    assert alone == pytest.approx(float(wanted[0]), rel=1e-9)


def test_a_tolerance_of_nothing_is_bounded_too():
    one = program(line(12, 0))
    exact = replace(one, tolerance=np.zeros(1))
    assert any_path_bound(exact, None, LIMITS) == pytest.approx(any_path_bound(one, 0.01, LIMITS), rel=1e-9)


def test_where_none_is_known(monkeypatch):
    source = read_program(PROGRAMS / "zigzag.ngc")
    assert math.isnan(any_path_bound(source, 0.01, LIMITS.without_jerk()))
    monkeypatch.setattr(any_path, "MAX_BLOCKS", 38)
    assert math.isnan(any_path_bound(source, 0.01, LIMITS))

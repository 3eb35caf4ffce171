"""The benchmark of path and feed as one problem: its cases, its verdict, and the command on two of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from benchmarks import joint
from benchmarks.joint import GOALS, SYNTHETIC, TOLERANCES, Made, Polygons, Row

GOOD = Made(9.0, 9.0, 0.1, 0.1, 0.1, True, 0.009, ())
SLOW = Made(10.0, 10.0, 0.6, 0.3, 0.3, True, 0.009, ())
ROW = Row("part", 0.01, 10, GOOD, SLOW, 8.5)


def turns(points):
    step = np.diff(points, axis=0)
    step /= np.linalg.norm(step, axis=1)[:, None]
    return np.rad2deg(np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1.0, 1.0)))


def test_the_synthetic_programs_are_what_their_names_say():
    for name, corners, degrees in (
        ("octagon", 7, 45.0),
        ("sawtooth of 135 degrees", 15, 135.0),
        ("sawtooth of 10 legs", 9, 135.0),
        ("raster of 15 corners", 15, 90.0),
        ("raster of 15 corners, 20 mm lines", 15, 90.0),
        ("raster of 101 corners", 101, 90.0),
    ):
        np.testing.assert_allclose(turns(SYNTHETIC[name]), np.full(corners, degrees), atol=1e-6)
    for name, line in (("raster of 15 corners", 12.0), ("raster of 101 corners", 20.0)):
        lengths = np.linalg.norm(np.diff(SYNTHETIC[name], axis=0), axis=1)
        np.testing.assert_allclose(lengths, np.where(np.arange(lengths.size) % 2, 0.5, line))
    np.testing.assert_allclose(np.linalg.norm(SYNTHETIC["octagon"], axis=1), 5.0)


def test_every_goal_can_be_loaded_and_has_a_value_for_every_tolerance():
    for goal in GOALS:
        assert len(joint.load(goal.program)) > 5
        assert all(len(must) == len(TOLERANCES) for must in (goal.seconds, goal.less) if must is not None)


def test_random_polygons_are_as_asked_for_and_the_same_again():
    drawn = [joint.random_polygon(seed) for seed in range(200)]
    lengths = np.concatenate([np.linalg.norm(np.diff(points, axis=0), axis=1) for points, _ in drawn])
    angles = np.concatenate([turns(points) for points, _ in drawn])
    tolerances = np.array([tolerance for _, tolerance in drawn])
    for value, low, high in ((lengths, 0.2, 50.0), (angles, 5.0, 179.0), (tolerances, 1e-3, 5e-2)):
        assert low <= value.min() < 1.2 * low
        assert 0.9 * high < value.max() <= high * (1.0 + 1e-9)
    assert {points.shape[1] for points, _ in drawn} == {2, 3}
    np.testing.assert_array_equal(joint.random_polygon(7)[0], drawn[7][0])


def test_a_program_of_a_polygon_runs_along_it():
    points, _ = joint.random_polygon(3)
    program = joint.polygon_program(points)
    np.testing.assert_allclose(program.end[-len(points) + 1 :, : points.shape[1]], points[1:], atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "met"),
    [
        ({}, True),
        ({"seconds": 9.0}, True),
        ({"seconds": 8.999}, False),
        ({"less": 0.099}, True),
        ({"less": 0.101}, False),
        ({"cpu": 0.26}, True),
        ({"cpu": 0.24}, False),
        ({"joint": replace(GOOD, within=False)}, False),
    ],
)
def test_a_row_that_misses_says_so(changed, met):
    row = replace(ROW, **changed)
    assert row.met == met
    said = Console(width=200, record=True)
    with said.capture() as shown:
        said.print(joint.table_of([row]))
    assert ("MISSED" in shown.get() or "NO" in shown.get()) == (not met)


def test_a_gain_is_counted_from_the_better_of_the_separate_plans():
    assert replace(ROW, separate=replace(SLOW, finer_seconds=9.5)).gain == pytest.approx(1.0 - 9.0 / 9.5)


@pytest.mark.parametrize(
    "wrong",
    [
        replace(ROW, joint=replace(GOOD, within=False)),
        replace(ROW, joint=replace(GOOD, seconds=10.002)),
        replace(ROW, proven=9.01),
    ],
)
def test_one_wrong_polygon_is_enough(wrong):
    assert Polygons([ROW] * 9, []).met
    assert not Polygons([*[ROW] * 9, wrong], []).met
    assert not Polygons([ROW] * 9, ["seed 5: no path"]).met
    assert not Polygons([replace(ROW, joint=replace(GOOD, seconds=9.5))] * 9, []).met


def test_the_command_on_two_cases(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(joint, "TOLERANCES", (1e-3, 1e-2))
    file = tmp_path / "joint.json"
    assert joint.main(["--only", "octagon", "--polygons", "1", "--output", str(file)]) == 0
    said = capsys.readouterr().out
    assert "octagon" in said
    assert "1 random polygons: median gain" in said
    facts = json.loads(file.read_text())
    assert [(row["program"], row["tolerance"], row["met"]) for row in facts["programs"]] == [
        ("octagon", 1e-3, True),
        ("octagon", 1e-2, True),
    ]
    for row in (*facts["programs"], *facts["polygons"]):
        assert 0.5 * row["joint"]["seconds"] < row["proven"] <= row["joint"]["seconds"]
        assert row["joint"]["within"]
        assert row["joint"]["deviation"] <= row["tolerance"]

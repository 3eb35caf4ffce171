"""Curves by name: whatever names one, the curve is the one its own reader makes, and a table of it is believed again."""

from __future__ import annotations

import numpy as np
import pytest
from cases import PROGRAMS

import feedplan
from feedplan.job import load_job_of_table
from planner import (
    CATALOG,
    InputError,
    Limits,
    load_curve,
    load_limits,
    plan_feedrate,
    read_points,
    read_program,
    read_table,
    write_table,
)
from planner.geometry.catalog import read_curve
from planner.geometry.tolerance import PathTolerance
from planner.programs.path.smooth_path import program_path

MILL = load_limits("mill")
SLOTS = PROGRAMS / "slots.ngc"
SLOW = Limits(20.0, [50.0] * 3, [300.0] * 3, [4000.0] * 3)


@pytest.mark.parametrize("name", CATALOG)
def test_a_named_curve_is_that_of_the_catalog(name):
    assert load_curve(name, scale=2.0).fingerprint == read_curve(name, scale=2.0).fingerprint


@pytest.mark.parametrize("suffix", [".ngc", ".NC", ".tap", ".gcode", ".cnc", ".eia", ".txt"])
@pytest.mark.parametrize(("tolerance", "limits"), [(None, None), (0.02, None), (0.02, SLOW)])
def test_a_program_is_its_path(tmp_path, suffix, tolerance, limits):
    file = tmp_path / f"part{suffix}"
    file.write_bytes(SLOTS.read_bytes())
    curve = load_curve(file, tolerance=tolerance, limits=limits)
    kind = "separate" if limits is None else "joint"
    path = program_path(read_program(SLOTS), tolerance, MILL if limits is None else limits, path=kind)
    assert curve.fingerprint == path.curve.fingerprint
    assert np.array_equal(curve.feed_caps.feed, path.curve.feed_caps.feed)
    assert curve.name == file.name
    assert curve.made_within == PathTolerance(tolerance, machine="mill" if limits is None else "", path=kind)


def test_limits_weigh_in_the_corners():
    assert load_curve(SLOTS, limits=SLOW).fingerprint != load_curve(SLOTS).fingerprint


def test_one_number_for_every_axis_serves_a_program():
    every = Limits(20.0, 50.0, 300.0, 4000.0)
    assert load_curve(SLOTS, limits=every).fingerprint == load_curve(SLOTS, limits=SLOW).fingerprint


@pytest.mark.parametrize(("tolerance", "weighed"), [(None, False), (0.02, False), (0.02, True)])
def test_a_table_written_from_python_is_believed_without_saying_how(tmp_path, tolerance, weighed):
    """Planned with other limits than those that weighed the path, where none were given."""
    curve = load_curve(SLOTS, tolerance=tolerance, limits=SLOW if weighed else None)
    limits = SLOW.for_curve(curve)
    profile = plan_feedrate(curve, limits)
    write_table(tmp_path / "table.csv", profile, limits)
    job = load_job_of_table(tmp_path / "table.csv", SLOTS)
    assert job.curve.fingerprint == curve.fingerprint
    again = read_table(tmp_path / "table.csv", job.curve)
    assert again.origin.tolerance == profile.origin.tolerance
    assert job.judge(again).ok


def test_points_within_a_tolerance(tmp_path):
    angle = np.linspace(0.0, 3.0, 60)
    file = tmp_path / "points.csv"
    np.savetxt(file, 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), delimiter=",")
    assert load_curve(file).fingerprint == read_points(file, 1e-3).fingerprint
    assert load_curve(file, tolerance=0.5).fingerprint == read_points(file, 0.5).fingerprint


@pytest.mark.parametrize(
    ("source", "options", "said"),
    [
        ("teardrop", {"tolerance": 0.1}, "is for part programs and points; teardrop is exact"),
        ("teardrop", {"tools": "tool.tbl"}, "tools = 'tool.tbl' is for part programs, .ngc, .nc"),
        ("teardrop", {"ignore": ["A"]}, r"ignore = \['A'\] is for part programs, .ngc, .nc"),
        (SLOTS, {"scale": 2.0}, "scale = 2.0 is not for .*slots.ngc; it must be 1"),
        (SLOTS, {"tolerance": -1.0}, "tolerance = -1.0 must be a number > 0"),
        ("nope.ngc", {}, "nope.ngc: cannot be read"),
        ("nope.xyz", {}, "neither a .json, .toml, .dxf, .csv or .ngc file nor a name"),
        (7, {}, "source is an int; it must be the path of a file"),
    ],
)
def test_refuses(source, options, said):
    with pytest.raises(InputError, match=said):
        load_curve(source, **options)


def test_is_the_same_for_both_packages():
    assert feedplan.load_curve is load_curve

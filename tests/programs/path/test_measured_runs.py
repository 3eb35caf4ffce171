"""The deviation of paths with joint runs: every run by itself, and what is beside them."""

from dataclasses import replace

import numpy as np
import pytest
from cases import drives
from program_blocks import line, program

from planner.programs.path import smooth_path
from planner.programs.path.measured_runs import MeasuredPath
from planner.programs.path.smooth_path import program_path

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))
TOLERANCE, STEP = 0.02, 0.005
BESIDE = 0.6 * STEP / TOLERANCE  # of the step, the share that the line leaves out


@pytest.fixture
def measured(monkeypatch):
    """What was measured of a path last, and its runs."""
    found = []
    usual = MeasuredPath.largest

    def seen(path, runs, places, widest):
        found.append((path, runs))
        return usual(path, runs, places, widest)

    monkeypatch.setattr(smooth_path.MeasuredPath, "largest", seen)

    def measure(source, **options):
        path = program_path(source, TOLERANCE, LIMITS, **options)
        return path, *found[-1]

    return measure


def bent():
    """A corner, a stop, a line with a step of 5 um, which is absorbed, a stop, and a line."""
    stepped = [line(25.0, 15.0), line(25.0, 15.0 + STEP), line(40.0, 15.0 + STEP, stop=True)]
    return program(line(15.0, 0.0), line(15.0, 15.0, stop=True), *stepped, line(40.0, 0.0))


def distance(points, corners):
    """Of points from a polyline, (n,)."""
    a, b = corners[:-1], corners[1:]
    along = np.einsum("nkd,kd->nk", points[:, None] - a, b - a) / np.sum((b - a) ** 2, axis=1)
    nearest = a + np.clip(along, 0.0, 1.0)[..., None] * (b - a)
    return np.sqrt(np.sum((points[:, None] - nearest) ** 2, axis=2)).min(axis=1)


def test_each_run_is_measured_by_itself_and_the_largest_is_that_of_the_path(measured):
    path, whole, runs = measured(bent())
    shares = [whole.share(run) for run in runs]
    assert path.counts["joint"] == len(runs) == 3
    assert [run.exact for run in runs] == [False, True, True]
    # The corner leaves the blocks by all of the tolerance; the line by its step; the last one not at all.
    u = np.linspace(*path.curve.edges[[0, np.searchsorted(path.curve.edges, path.curve.stops[0])]], 40_001)
    points = path.curve.derivatives(u, 0)[0][:, :2]
    away = distance(points, np.array([[0.0, 0.0], [15.0, 0.0], [15.0, 15.0]])).max()
    from_vertex = distance(np.array([[15.0, 0.0]]), points).max()
    assert shares[0] == pytest.approx(max(away, from_vertex) / TOLERANCE, rel=1e-5)
    assert shares[1] == pytest.approx(BESIDE, rel=1e-3)
    assert shares[2] == 0.0
    assert path.deviation_share == max(shares)


def test_a_line_of_several_blocks_is_known_but_for_rounding(measured):
    _, whole, runs = measured(bent())
    (start, end, tolerance) = whole.written.lines[0]
    moved = replace(whole, written=replace(whole.written, lines=[(start - 1e-12, end + 1e-12, tolerance)]))
    for one in (whole, moved):
        assert len(one.places_of_run(runs[1])) == 1
        assert one.places_of_run(runs[0]) == [
            (0.0, 15.0, TOLERANCE),
            (15.0, 30.0, TOLERANCE),
        ]
        assert one.places_of_run(runs[2]) == []
        assert one.share(runs[1]) == pytest.approx(BESIDE, rel=1e-3)


def test_what_was_not_found_is_no_run_but_its_lines_are_measured(measured):
    path, whole, runs = measured(bent(), path="separate")
    assert runs == []
    _, _, found = measured(bent())
    left = [replace(run, part=None) for run in found]
    assert [whole.share(run) for run in left] == [0.0, 0.0, 0.0]
    assert whole.largest(left, [], 0.0)[1] == pytest.approx(BESIDE, rel=1e-3)
    assert path.deviation_share <= 1.0

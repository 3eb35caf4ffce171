"""Target positions of drives: read back as counts, they are the samples to half an increment, at every row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interp import replay
from planner import BrokenLimitError, InputError, Samples, check, load_curve, load_limits, plan_feedrate
from planner.output.cyclic_positions import interpolation_time, write_cyclic_positions


def read(file):
    """Header and columns of the file, by nothing of ours."""
    lines = file.read_text().splitlines()
    header = dict(line[2:].split(" = ", 1) for line in lines if line.startswith("#"))
    rows = [line.split(",") for line in lines if not line.startswith("#")]
    return header, {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


@pytest.fixture(scope="module", params=["butterfly-nurbs", "flank"])
def planned(request):
    curve = load_curve(request.param)
    limits = load_limits("five-axis" if "A" in curve.axes else "mill").for_curve(curve)
    return curve, limits, plan_feedrate(curve, limits)


def counts_of(curve):
    return {
        axis: (1e4 if unit == "mm" else 2.0**20) * (-1.0) ** k
        for k, (axis, unit) in enumerate(zip(curve.axes, curve.axis_units, strict=True))
    }


@pytest.fixture(scope="module")
def written(planned, tmp_path_factory):
    curve, limits, profile = planned
    samples = replay(curve, profile, 1e-3)
    file = tmp_path_factory.mktemp("csp") / "drives.csv"
    report = check(curve, limits, samples)
    rows = write_cyclic_positions(file, profile, samples, counts_of(curve), report=report, velocity_offset=True)
    header, columns = read(file)
    assert rows == len(samples) == int(header["rows"])
    return samples, header, columns


def quantised(curve, samples, columns):
    counts = np.array([columns[f"{axis}_607A"] for axis in curve.axes], dtype=np.int64).T
    return counts / np.array([counts_of(curve)[axis] for axis in curve.axes])


class TestCounts:
    def test_each_row_is_within_half_an_increment(self, planned, written):
        curve, (samples, _, columns) = planned[0], written
        for axis in curve.axes:
            assert all(str(int(cell)) == cell for cell in columns[f"{axis}_607A"])
        half = [0.5 / abs(each) for each in counts_of(curve).values()]
        off = np.abs(quantised(curve, samples, columns) - samples.position)
        assert (off.max(axis=0) <= np.array(half) * (1.0 + 1e-9)).all()
        assert off.max(axis=0)[0] > 0.49 * 2 * half[0]  # rounded, not cut
        assert np.array_equal(np.array(columns["t_s"], dtype=float), samples.t)

    def test_what_rounding_does_to_differences_is_what_the_header_says(self, planned, written):
        """The counts through the check: each difference is off by no more, and the jerk by much more than the limit."""
        curve, limits, _ = planned
        samples, header, columns = written
        position = quantised(curve, samples, columns)
        T = samples.period
        for j, (axis, unit) in enumerate(zip(curve.axes, curve.axis_units, strict=True)):
            for order, (name, suffix) in enumerate((("velocity", "s"), ("acceleration", "s2"), ("jerk", "s3")), 1):
                bound = float(header[f"rounding_{name}_{axis}_{unit}_{suffix}"])
                assert bound == pytest.approx(2.0 ** (order - 1) / (abs(counts_of(curve)[axis]) * T**order))
                noise = np.abs(np.diff(position[:, j] - samples.position[:, j], order)).max() / T**order
                assert noise <= bound * (1.0 + 1e-6)
                assert noise > 0.2 * bound or name == "jerk" or np.ptp(samples.position[:, j]) < 1.0
        report = check(curve, limits, Samples(T, samples.t, samples.u, position, axes=curve.axes))
        exact = check(curve, limits, samples)
        assert exact.ok
        used = {(row.limit, row.axis): row.ratio for row in report.rows}
        for row in exact.rows:
            if row.limit == "jerk" and row.axis in curve.axes:
                unit = curve.axis_units[curve.axes.index(row.axis)]
                bound = float(header[f"rounding_jerk_{row.axis}_{unit}_s3"])
                assert used[row.limit, row.axis] <= row.ratio + bound / row.allowed * (1.0 + 1e-6)

    def test_the_velocity_offset_is_that_of_the_plan(self, planned, written):
        curve, _, profile = planned
        samples, _, columns = written
        t = np.minimum(samples.t, profile.duration)
        step = 1e-6
        inner = (t > step) & (t < profile.duration - step)
        q = [curve.derivatives(profile.at(t[inner] + h).u, 0)[0] for h in (step, -step)]
        slope = (q[0] - q[1]) / (2.0 * step)
        for j, axis in enumerate(curve.axes):
            factor = counts_of(curve)[axis]
            offset = np.array(columns[f"{axis}_60B1"], dtype=np.int64)[inner]
            assert np.abs(offset - factor * slope[:, j]).max() <= 0.5 + 1e-5 * abs(factor)
            assert columns[f"{axis}_60B1"][0] == columns[f"{axis}_60B1"][-1] == "0"

    def test_without_it_there_is_no_such_column(self, planned, tmp_path):
        curve, limits, profile = planned
        samples = replay(curve, profile)
        file = tmp_path / "drives.csv"
        write_cyclic_positions(file, profile, samples, counts_of(curve), report=check(curve, limits, samples))
        assert list(read(file)[1]) == ["t_s", *(f"{axis}_607A" for axis in curve.axes)]


class TestInterpolationTime:
    @pytest.mark.parametrize(
        ("period", "found"),
        [
            (1e-3, (1, -3)),
            (2.5e-4, (25, -5)),
            (1.25e-4, (125, -6)),
            (2e-3, (2, -3)),
            (0.1, (1, -1)),
            (62.5e-6, None),
            (3.1e-5, (31, -6)),
        ],
    )
    def test_value_and_power(self, period, found):
        if found is None:  # 625 does not fit into a byte
            with pytest.raises(
                InputError, match=r"period = 6\.25e-05 s is no interpolation time of a drive \(0x60C2\)"
            ):
                interpolation_time(period)
        else:
            assert interpolation_time(period) == found
            assert found[0] * 10.0 ** found[1] == pytest.approx(period, rel=1e-12)


class TestRefusals:
    def refused(self, planned, tmp_path, error, message, counts=None, **changes):
        curve, limits, profile = planned
        samples = replace(replay(curve, profile), **changes)
        report = check(curve, limits, replay(curve, profile))
        file = tmp_path / "drives.csv"
        with pytest.raises(error, match=message):
            write_cyclic_positions(file, profile, samples, counts_of(curve) | (counts or {}), report=report)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        ("value", "message"),
        [
            (0.0, r"\|counts per mm of Y\| = 0\.0 must be a number > 0"),
            (np.inf, "counts per mm of Y = inf must be finite"),
            (np.nan, r"\|counts per mm of Y\| = nan must be a number > 0"),
            (1e9, r"Y = -?[\d.e+-]+ mm at t = [\d.]+ s makes -?\d+ increments; 0x607A holds -2147483648 to 2147483647"),
        ],
    )
    def test_counts(self, planned, tmp_path, value, message):
        self.refused(planned, tmp_path, InputError, message, {"Y": value})

    def test_an_axis_without_counts(self, planned, tmp_path):
        curve, limits, profile = planned
        samples = replay(curve, profile)
        with pytest.raises(InputError, match="counts per mm of Y are missing; give them for each of the axes X Y"):
            write_cyclic_positions(
                tmp_path / "a.csv", profile, samples, {"X": 1.0}, report=check(curve, limits, samples)
            )

    def test_a_period_that_no_drive_can_have(self, planned, tmp_path):
        self.refused(planned, tmp_path, InputError, "0x60C2", period=1.0 / 3000.0)

    def test_samples_that_break_a_limit(self, planned, tmp_path):
        curve, limits, profile = planned
        samples = replay(curve, profile)
        report = check(curve, limits.scaled("velocity", 0.01), samples)
        assert not report.ok
        with pytest.raises(BrokenLimitError, match="not written: the plan as sampled BREAKS ITS LIMITS"):
            write_cyclic_positions(tmp_path / "a.csv", profile, samples, counts_of(curve), report=report)
        assert list(tmp_path.iterdir()) == []

"""Feedrate tables: what is written comes back bit by bit, and nothing else comes back at all."""

from __future__ import annotations

import dataclasses
import os
import zipfile

import numpy as np
import pytest
from cases import drives
from check_plans import with_columns
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motions import plan_along, scurve
from table_lines import CIRCLE, COLUMNS, LIMITS, first_row, same_bits, small_plan, with_cell

from planner import (
    InputError,
    Limits,
    Samples,
    check,
    load_curve,
    load_limits,
    read_table,
    table_limits,
    write_table,
)
from planner.geometry.nurbs import NurbsCurve
from planner.geometry.tolerance import PathTolerance
from planner.law import TimeLaw
from planner.origin import Origin
from planner.output.table import write_samples
from planner.profile import make_profile
from planner.status import Claim, Status, Work

MILL = drives()
# Two parabolas: the tangent goes on where they join, the curvature jumps.
BENDS = NurbsCurve([[0, 0], [10, 0], [15, 5], [15, 25]], [0, 0, 0, 0.5, 1, 1, 1], 2, name="bends")
SUFFIXES = pytest.mark.parametrize("suffix", [".csv", ".npz"])


@st.composite
def profiles(draw):
    """Plans from nodes of any size that a law can have, double nodes among them."""
    count = draw(st.integers(2, 9))
    steps = draw(st.lists(st.floats(1e-3, 1e6), min_size=count - 1, max_size=count - 1))
    inner = draw(st.lists(st.floats(0.0, 1.0), min_size=count - 2, max_size=count - 2))
    u = np.concatenate([[0.0], np.sort(inner), [1.0]])
    t = np.concatenate([[0.0], np.cumsum(steps)])
    double = draw(st.integers(0, t.size - 2))
    if double:
        t, u = np.insert(t, double, t[double]), np.insert(u, double, u[double])
    some = st.floats(-1e6, 1e6, allow_subnormal=True)
    rates, accelerations = (np.array(draw(st.lists(some, min_size=t.size, max_size=t.size))) for _ in range(2))
    profile = make_profile(
        CIRCLE,
        LIMITS,
        TimeLaw(t, u, rates, accelerations),
        method=draw(st.sampled_from(["optimal", "nlp", ""])),
        lower_bound=draw(st.one_of(st.just(np.nan), st.floats(0.0, float(t[-1])))),
    )
    shares, machines = st.just(1.0) | st.floats(0.1, 0.9), st.sampled_from(["", "mill"])
    tolerance = st.builds(PathTolerance, st.none() | st.floats(1e-6, 1.0), shares, machines)
    origin = Origin(LIMITS.period, draw(st.booleans()), False, draw(st.none() | tolerance))
    notes = draw(st.lists(st.text(st.characters(codec="utf-8")), max_size=2))
    return dataclasses.replace(
        profile, origin=origin, status=draw(st.sampled_from(Status)), notes=tuple(notes), work=Work(iterations=7)
    )


class TestRoundTrip:
    @SUFFIXES
    @settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(profile=profiles())
    def test_any_numbers_come_back_bit_by_bit(self, tmp_path, suffix, profile):
        path = tmp_path / f"table{suffix}"
        write_table(path, profile, LIMITS)
        found = read_table(path, CIRCLE)
        assert same_bits(found, profile)
        assert np.array_equal(found.lower_bound, profile.lower_bound, equal_nan=True)
        assert (found.method, found.limit_names, found.curve) == (profile.method, profile.limit_names, CIRCLE)
        assert (found.origin, found.status, found.notes) == (profile.origin, profile.status, profile.notes)
        assert found.claim is (Claim.NONE if np.isnan(profile.lower_bound) else Claim.TABLE)
        assert found.checked.startswith(("every limit holds", "BREAKS"))
        assert found.work == Work()

    @SUFFIXES
    def test_numbers_too_small_for_their_digits_come_back(self, tmp_path, suffix):
        t, u = np.array([0.0, 1.0, 2.0, 2993.0, 2994.0]), np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        rates = np.array([0.0, 0.0, 0.0, 2.22507386e-309, 0.0])
        profile = make_profile(CIRCLE, LIMITS, TimeLaw(t, u, rates, np.zeros(5)), method="optimal")
        assert 0.0 < abs(profile.jerk[2]) < 1e-308
        path = tmp_path / f"table{suffix}"
        write_table(path, profile, LIMITS)
        assert same_bits(read_table(path, CIRCLE), profile)

    @SUFFIXES
    @pytest.mark.parametrize(("name", "machine"), [("butterfly-nurbs", "mill"), ("flank", "five-axis")])
    def test_a_plan_through_breaks_comes_back(self, tmp_path, name, machine, suffix):
        curve = load_curve(name)
        limits = load_limits(machine).for_curve(curve)
        profile = plan_along(curve, scurve(curve.length, 20.0, 100.0, 2000.0), limits)
        path = tmp_path / f"table{suffix}"
        write_table(path, profile, limits)
        found = read_table(path, load_curve(name))
        assert same_bits(found, profile)
        assert found.limit_names == profile.limit_names
        assert found.duration == profile.duration
        assert found.shares() == profile.shares()

    @SUFFIXES
    def test_limits_come_back_with_their_infinities(self, tmp_path, plan, suffix):
        path = tmp_path / f"table{suffix}"
        write_table(path, plan, LIMITS)
        found = table_limits(path)
        for name in ("feed", "chord_error", "period", "tangential_acceleration", "tangential_jerk"):
            assert getattr(found, name) == getattr(LIMITS, name), name
        for name in ("velocity", "acceleration", "jerk"):
            assert getattr(found, name).tolist() == getattr(LIMITS, name).tolist(), name
        assert found.axes == ("X", "Y")

    @SUFFIXES
    def test_the_same_plan_gives_the_same_bytes(self, tmp_path, plan, suffix):
        one, other = tmp_path / f"one{suffix}", tmp_path / f"other{suffix}"
        write_table(one, plan, LIMITS)
        os.utime(one, (0, 0))
        write_table(other, small_plan(), LIMITS)
        assert one.read_bytes() == other.read_bytes()

    def test_the_archive_holds_no_time_of_writing(self, tmp_path, plan):
        write_table(tmp_path / "table.npz", plan, LIMITS)
        with zipfile.ZipFile(tmp_path / "table.npz") as archive:
            assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}

    def test_numpy_opens_the_archive(self, tmp_path, plan):
        write_table(tmp_path / "table.npz", plan, LIMITS)
        with np.load(tmp_path / "table.npz") as archive:
            assert archive["t_s"].tolist() == plan.t.tolist()
            assert str(archive["header"]).startswith("# format = feedplan-table 2\n")


class TestContent:
    def test_columns_name_axis_and_unit(self, tmp_path):
        curve = load_curve("flank")
        limits = load_limits("five-axis").for_curve(curve)
        profile = plan_along(curve, scurve(curve.length, 20.0, 100.0, 2000.0), limits)
        write_table(tmp_path / "table.csv", profile, limits)
        lines = (tmp_path / "table.csv").read_text().splitlines()
        at = first_row(lines) - 1
        assert lines[at].split(",") == [
            "t_s", "u", "s_mm", "X_mm", "Y_mm", "Z_mm", "A_rad", "C_rad", "feed_mm_s", "acceleration_mm_s2",
            "jerk_mm_s3", "binding", "u_rate", "u_acceleration",
        ]  # fmt: skip
        assert "# limit_jerk_C_rad_s3 = 1.5" in lines[:at]
        assert "# limit_feed_mm_s = inf" in lines[:at]
        assert f"# curve_hash = {curve.fingerprint}" in lines[:at]
        assert f"# duration_s = {profile.duration!r}" in lines[:at]
        row = lines[at + 8].split(",")
        assert [float(cell) for cell in row[3:8]] == curve.derivatives(profile.u[7], 0)[0].tolist()
        assert row[11] == profile.limit_names[profile.binding[7]]

    def test_samples_hold_time_parameter_and_axes(self, tmp_path):
        u = np.linspace(0.0, 1.0, 5)
        samples = Samples(0.5, 0.5 * np.arange(5), u, CIRCLE.derivatives(u, 0)[0])
        write_samples(tmp_path / "samples.csv", CIRCLE, samples, check(CIRCLE, LIMITS, samples))
        lines = (tmp_path / "samples.csv").read_text().splitlines()
        at = first_row(lines)
        assert lines[at - 1] == "t_s,u,X_mm,Y_mm"
        assert "# period_s = 0.5" in lines[:at]
        assert any(line.startswith("# verdict = BREAKS ITS LIMITS: ") for line in lines[:at])
        found = np.array([[float(cell) for cell in line.split(",")] for line in lines[at:]])
        assert np.array_equal(found, np.column_stack([samples.t, u, samples.position]))

    def test_samples_are_not_taken_for_a_plan(self, tmp_path):
        u = np.array([0.0, 1.0])
        samples = Samples(1.0, u, u, CIRCLE.derivatives(u, 0)[0])
        write_samples(tmp_path / "samples.csv", CIRCLE, samples, check(CIRCLE, LIMITS, samples))
        with pytest.raises(InputError, match="is no feedrate table"):
            read_table(tmp_path / "samples.csv", CIRCLE)

    def test_a_name_without_suffix_is_csv(self, tmp_path, plan):
        write_table(tmp_path / "table", plan, LIMITS)
        assert same_bits(read_table(tmp_path / "table", CIRCLE), plan)


class TestDamage:
    @pytest.mark.parametrize(("suffix", "step"), [(".csv", 1), (".npz", 17)])
    def test_every_truncation_is_refused(self, tmp_path, suffix, step):
        write_table(tmp_path / f"whole{suffix}", small_plan(2), LIMITS)
        whole = (tmp_path / f"whole{suffix}").read_bytes()
        cut = tmp_path / f"cut{suffix}"
        for size in [*range(0, len(whole) - 100, step), *range(len(whole) - 100, len(whole))]:
            cut.write_bytes(whole[:size])
            with pytest.raises(InputError):
                read_table(cut, CIRCLE)

    @settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(place=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
    def test_a_damaged_archive_is_refused_or_harmless(self, tmp_path, plan, place, flip):
        path = tmp_path / "table.npz"
        write_table(path, plan, LIMITS)
        content = bytearray(path.read_bytes())
        content[int(place * len(content))] ^= flip
        path.write_bytes(content)
        try:
            found = read_table(path, CIRCLE)
        except InputError:
            return
        assert same_bits(found, plan)

    def test_a_missing_row_is_noticed(self, table):
        path, lines = table
        path.write_text("".join(lines[:-1]))
        with pytest.raises(InputError, match=r"table\.csv: 13 rows, but the header says 14; the table is cut off"):
            read_table(path, CIRCLE)

    @pytest.mark.parametrize(
        ("column", "text", "message"),
        [
            ("feed_mm_s", "12,5", r":LINE: 12 cells; a row must have 11"),
            ("feed_mm_s", "12.5.1", r':LINE: feed_mm_s: "12\.5\.1" must be a number'),
            ("u", "", r':LINE: u: "" must be a number'),
            ("jerk_mm_s3", "nan", r":LINE: jerk_mm_s3 = nan must be finite"),
            ("u_rate", "-inf", r":LINE: u_rate = -inf must be finite"),
            ("t_s", "-1.0", r":LINE: t_s = -1\.0 must be greater than 0\.5\d+, the one before"),
            ("binding", "jerk Q", r':LINE: binding: "jerk Q" must be one of none, feed, chord error,'),
            ("u", "1.5", r":LINE: u = 1\.5 must lie within \[0\.0, 1\.0\], the domain of circle"),
            ("u", "0.01", r":LINE: X_mm = .* disagrees with the time law"),
            ("feed_mm_s", "50.0", r":LINE: feed_mm_s = 50\.0 disagrees with the time law, which gives \d+\.\d+; "),
            ("X_mm", "0.0", r":LINE: X_mm = 0\.0 disagrees with the time law, which gives \d+\.\d+; "),
            ("s_mm", "0.0", r":LINE: s_mm = 0\.0 disagrees with the time law"),
        ],
    )
    def test_a_bad_cell_is_named_with_its_line(self, table, column, text, message):
        path, lines = table
        message = message.replace("LINE", str(first_row(lines) + 4))
        path.write_text("".join(with_cell(lines, 3, column, text)))
        with pytest.raises(InputError, match=message):
            read_table(path, CIRCLE)

    def test_the_archive_names_the_row(self, tmp_path, plan):
        feed = plan.feed.copy()
        feed[3] += 1.0
        write_table(tmp_path / "table.npz", dataclasses.replace(plan, feed=feed), LIMITS)
        with pytest.raises(InputError, match=r"table\.npz: row 4: feed_mm_s = .* disagrees with the time law"):
            read_table(tmp_path / "table.npz", CIRCLE)

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            (
                "# format = feedplan-table 2",
                "# format = feedplan-table 7",
                'format version "7" is not read; .* version 2',
            ),
            ("# format = feedplan-table 2", "# form = 1", "is no feedrate table; one starts with"),
            ("# curve_hash = ", "# curve_hash = 0", r"the curve circle \(hash 0.*\), not for circle \(hash "),
            ("# limit_names", "# names", 'the header line "# limit_names = ..." is missing'),
            ("# rows = 14", "# rows = 15", "14 rows, but the header says 15"),
            ("# lower_bound_s = nan", "# lower_bound_s = soon", 'lower_bound_s = "soon"; it must be a number'),
            ("# notes = []", "# notes = [", "notes = .; it must be a JSON list"),
            (",u_rate,", ",rate,", 'the column "u_rate" is missing; the columns are t_s, u, '),
        ],
    )
    def test_a_bad_header_is_named(self, table, old, new, message):
        path, lines = table
        text = "".join(lines)
        assert text.count(old) == 1
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            read_table(path, CIRCLE)

    def test_limits_of_a_table_must_be_limits(self, table):
        path, lines = table
        path.write_text("".join(lines).replace("limit_jerk_X_mm_s3 = 20000.0", "limit_jerk_X_mm_s3 = -1.0"))
        with pytest.raises(InputError, match=r"table\.csv: jerk\[0\] = -1\.0"):
            table_limits(path)

    def test_a_table_that_ends_early_is_refused(self, tmp_path, plan):
        short = with_columns(plan, **{name: getattr(plan, name)[:-2] for name in COLUMNS})
        write_table(tmp_path / "table.csv", short, LIMITS)
        with pytest.raises(InputError, match=r"the rows run from u = 0\.0 to 0\.\d+; circle runs from 0\.0 to 1\.0"):
            read_table(tmp_path / "table.csv", CIRCLE)

    def test_a_jump_at_one_time_is_refused(self, tmp_path, plan):
        t = plan.t.copy()
        t[5] = t[4]
        write_table(tmp_path / "table.csv", with_columns(plan, t=t), LIMITS)
        lines = (tmp_path / "table.csv").read_text().splitlines()
        with pytest.raises(
            InputError, match=rf":{first_row(lines) + 6}: t_s = (\S+) must be greater than \1, the one before"
        ):
            read_table(tmp_path / "table.csv", CIRCLE)

    def test_another_curve_is_refused_and_both_are_named(self, table):
        path, _ = table
        with pytest.raises(InputError, match=r"is for the curve circle .*not for circle .*and the scale"):
            read_table(path, load_curve("circle", scale=2.0))
        with pytest.raises(InputError, match=r"is for the curve circle .*not for teardrop"):
            read_table(path, load_curve("teardrop"))

    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            ("missing.csv", None, "cannot be read"),
            ("image.csv", b"\x89PNG\r\n\xff\xfe", "is not text"),
            ("empty.csv", b"", "is no feedrate table"),
            ("empty.npz", b"", "is not a whole NPZ file"),
            ("table.xlsx", b"", r"the suffix \"\.xlsx\" must be \.csv or \.npz"),
        ],
    )
    def test_other_files_are_refused(self, tmp_path, name, content, message):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_table(tmp_path / name, CIRCLE)

    def test_another_archive_is_refused(self, tmp_path):
        np.savez(tmp_path / "other.npz", a=np.zeros(3))
        with pytest.raises(InputError, match="is no feedrate table"):
            read_table(tmp_path / "other.npz", CIRCLE)
        np.savez(tmp_path / "pickle.npz", header=np.array([{"format": 1}], dtype=object))
        with pytest.raises(InputError, match="header cannot be read"):
            read_table(tmp_path / "pickle.npz", CIRCLE)


class TestWholeOrNothing:
    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("missing/table.csv", "there is no directory"),
            ("folder.csv", "it is a directory"),
            ("file/table.csv", "there is no directory"),
            ("table.txt", "must be .csv or .npz"),
        ],
    )
    def test_an_output_that_cannot_be_written_leaves_nothing(self, tmp_path, plan, name, message):
        (tmp_path / "folder.csv").mkdir()
        (tmp_path / "file").write_text("kept")
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(InputError, match=message):
            write_table(tmp_path / name, plan, LIMITS)
        assert sorted(tmp_path.rglob("*")) == before
        assert (tmp_path / "file").read_text() == "kept"

    def test_only_an_ordinary_file_is_replaced(self, tmp_path, plan):
        pipe = tmp_path / "pipe.csv"
        os.mkfifo(pipe)
        with pytest.raises(InputError, match="not an ordinary file"):
            write_table(pipe, plan, LIMITS)
        assert pipe.is_fifo()

    @pytest.mark.parametrize("step", ["replace", "open"])
    def test_a_failure_keeps_the_older_file(self, tmp_path, plan, monkeypatch, step):
        path = tmp_path / "table.csv"
        path.write_text("older")

        def fail(*_args, **_kwargs):
            raise PermissionError(13, "Permission denied")

        if step == "replace":
            monkeypatch.setattr(os, "replace", fail)
        else:
            monkeypatch.setattr("builtins.open", fail)
        with pytest.raises(InputError, match=r"table\.csv: cannot be written \(Permission denied\)"):
            write_table(path, plan, LIMITS)
        monkeypatch.undo()
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]

    def test_an_interrupt_leaves_nothing(self, tmp_path, plan, monkeypatch):
        def interrupt(*_args, **_kwargs):
            raise KeyboardInterrupt

        monkeypatch.setattr("planner.files.columns._csv", interrupt)
        with pytest.raises(KeyboardInterrupt):
            write_table(tmp_path / "table.csv", plan, LIMITS)
        assert list(tmp_path.iterdir()) == []

    def test_a_link_stays_a_link(self, tmp_path, plan):
        (tmp_path / "real.csv").write_text("older")
        (tmp_path / "table.csv").symlink_to("real.csv")
        write_table(tmp_path / "table.csv", plan, LIMITS)
        assert (tmp_path / "table.csv").is_symlink()
        assert same_bits(read_table(tmp_path / "real.csv", CIRCLE), plan)

    def test_the_file_is_readable_for_those_the_umask_allows(self, tmp_path, plan):
        old = os.umask(0o022)
        try:
            write_table(tmp_path / "table.csv", plan, LIMITS)
        finally:
            os.umask(old)
        assert (tmp_path / "table.csv").stat().st_mode & 0o777 == 0o644

    def test_a_plan_that_is_not_finite_is_not_written(self, tmp_path, plan):
        jerk = plan.jerk.copy()
        jerk[4] = np.nan
        with pytest.raises(InputError, match=r"not written: jerk_mm_s3\[4\] = nan must be finite"):
            write_table(tmp_path / "table.csv", dataclasses.replace(plan, jerk=jerk), LIMITS)
        assert list(tmp_path.iterdir()) == []

    def test_limits_of_another_machine_are_refused(self, tmp_path, plan):
        other = Limits(50.0, [100.0] * 3, [1000.0] * 3, [20000.0] * 3, axes="XZU")
        with pytest.raises(InputError, match="3 axes"):
            write_table(tmp_path / "table.csv", plan, other)
        write_table(tmp_path / "table.csv", plan, load_limits("mill"))  # has the axes, and one more
        assert table_limits(tmp_path / "table.csv") == load_limits("mill").for_curve(plan.curve)

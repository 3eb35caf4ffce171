"""Feedrate tables: what is written comes back bit by bit, and nothing else comes back at all."""

from __future__ import annotations

import dataclasses
import io
import os
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from cases import drives
from check_plans import with_columns
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motions import plan_along, scurve
from table_lines import first_row, sealed

from planner import (
    FeedrateProfile,
    InputError,
    Limits,
    Samples,
    certify,
    check,
    load_curve,
    load_limits,
    plan_feedrate,
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
from planner.verify.implied_columns import Nodes

COLUMNS = ("t", "u", "u_rate", "u_acceleration", "s", "feed", "acceleration", "jerk", "binding")
CIRCLE = load_curve("circle")
LIMITS = Limits(100.0, [250.0, 300.0], [1000.0, np.inf], [20000.0, 1e-3], chord_error=1e-3, period=2e-3)
MILL = drives()
# Two parabolas: the tangent goes on where they join, the curvature jumps.
BENDS = NurbsCurve([[0, 0], [10, 0], [15, 5], [15, 25]], [0, 0, 0, 0.5, 1, 1, 1], 2, name="bends")
SUFFIXES = pytest.mark.parametrize("suffix", [".csv", ".npz"])


def small_plan(count=12):
    """Nodes on the circle, and the double one at its knot."""
    motion = scurve(CIRCLE.length, 100.0, 1000.0, 20000.0)
    return plan_along(CIRCLE, motion, LIMITS, np.linspace(0.0, motion.duration, count))


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture
def table(tmp_path, plan):
    """A table on disk, and its lines."""
    path = tmp_path / "table.csv"
    write_table(path, plan, LIMITS)
    return path, path.read_text().splitlines(keepends=True)


def with_cell(lines, row, column, text):
    """The lines with one cell replaced; row 0 is the first."""
    at = first_row(lines) + row
    cells = lines[at].rstrip("\n").split(",")
    cells[lines[first_row(lines) - 1].rstrip("\n").split(",").index(column)] = text
    return [*lines[:at], ",".join(cells) + "\n", *lines[at + 1 :]]


def same_bits(one: FeedrateProfile, other: FeedrateProfile) -> bool:
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes()
        and getattr(one, name).dtype == getattr(other, name).dtype
        for name in COLUMNS
    )


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


@pytest.fixture(scope="module")
def teardrop():
    """A real plan, which has all kinds of limits binding, and its limits."""
    curve = load_curve("teardrop")
    limits = load_limits("mill").for_curve(curve)
    return plan_feedrate(curve, limits, intervals=80), limits


class TestTruth:
    """Nothing in a table is believed that can be known: neither with the seals as they were nor with new ones."""

    def test_a_seal_that_fits_is_read(self, table, plan):
        path, lines = table
        path.write_text("".join(sealed(lines)))
        assert sealed(lines) == lines
        assert same_bits(read_table(path, CIRCLE), plan)

    @pytest.mark.parametrize("resealed", [False, True])
    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            ("duration_s", "1.0", r"duration_s = 1\.0; the rows end at t_s = "),
            ("lower_bound_s", "1e9", r"lower_bound_s = 1000000000\.0; it must be nan, or lie within \[0, "),
            ("lower_bound_s", "inf", "lower_bound_s = inf"),
            ("lower_bound_s", "-1.0", "lower_bound_s = -1"),
            ("lower_bound_s", "1_0", 'lower_bound_s = "1_0"; it must be a number'),
            ("limit_feed_mm_s", "\u0661\u0660\u0660", "limit_feed_mm_s = .*; it must be a number"),
            ("units", "inch", 'units = "inch"; it must be "mm, rad, s'),
            ("time_law", "linear", 'time_law = "linear"'),
            ("exact_stop", "maybe", 'exact_stop = "maybe"; it must be yes or no'),
            ("verdict", "good", 'verdict = "good"; it must begin with'),
            ("limit_names", "none", 'limit_names = "none"; it must be "none, feed'),
            ("limit_jerk_X_mm_s3", "2.0", 'binding = ".*" disagrees with the time law: of .* % is used there'),
            ("axes", "Y X", 'axes = "Y X"; it must be "X Y"'),
            ("notes", "[1]", "must be a JSON list of texts"),
        ],
    )
    def test_a_false_header_line_is_refused(self, tmp_path, teardrop, key, value, message, resealed):
        profile, limits = teardrop
        path = tmp_path / "t.csv"
        write_table(path, profile, limits)
        lines = path.read_text().splitlines(keepends=True)
        at = next(i for i, line in enumerate(lines) if line.startswith(f"# {key} = "))
        lines[at] = f"# {key} = {value}\n"
        # names of limits are needed to make the seal
        path.write_text("".join(sealed(lines) if resealed and key not in {"limit_names", "axes"} else lines))
        with pytest.raises(InputError, match=message):
            read_table(path, profile.curve)

    @pytest.mark.parametrize("planted", ["swapped", "jerk", "binding", "position", "second"])
    @pytest.mark.parametrize("suffix", [".csv", ".npz"])
    def test_false_columns_are_refused_and_checked(self, tmp_path, teardrop, planted, suffix):
        """Written by whoever has the library: the seals are right, the columns are not."""
        profile, limits = teardrop
        path = tmp_path / f"t{suffix}"
        some = {
            "swapped": {"acceleration": profile.jerk, "jerk": profile.acceleration},
            "jerk": {"jerk": profile.jerk * 1.05},
            "binding": {"binding": np.where(profile.binding == 1, 0, profile.binding).astype(np.int8)},
            "position": {"s": profile.s * (1.0 + 1e-6)},
            "second": {"acceleration": profile.acceleration * (1.0 + 1e-6)},
        }[planted]
        false = with_columns(profile, **some)
        write_table(path, false, limits)
        with pytest.raises(InputError, match="disagrees with the time law"):
            read_table(path, profile.curve)
        row = check(profile.curve, limits, false).row("binding limit" if planted == "binding" else "table columns")
        assert not row.ok
        assert check(profile.curve, limits, profile).ok

    def test_every_other_name_of_the_limit_that_binds_is_found(self, teardrop):
        """Names are changed one node at a time: another passes only where as much of its limit is used."""
        profile, limits = teardrop
        at = Nodes.of(profile.curve, profile).shares(limits)
        changed = 0
        for node in range(0, profile.t.size, 2):
            used = np.array([at[name][0][node] for name in profile.limit_names])
            for name in np.flatnonzero(used < used[profile.binding[node]] - 2e-3):
                binding = profile.binding.copy()
                binding[node] = name
                false = dataclasses.replace(profile, binding=binding)
                assert Nodes.of(profile.curve, false).misnamed(limits).tolist() == [node]
                changed += 1
        assert changed > 300

    @pytest.mark.parametrize(
        ("column", "row", "message"),
        [("jerk_mm_s3", 5, "rows_sha256 differs"), ("u_acceleration", 7, "rows_sha256 differs"), ("t_s", 9, ".")],
    )
    def test_the_last_digit_counts(self, table, column, row, message):
        path, lines = table
        at = lines[first_row(lines) - 1].rstrip("\n").split(",").index(column)
        value = float(lines[first_row(lines) + row].rstrip("\n").split(",")[at])
        path.write_text("".join(with_cell(lines, row, column, repr(float(np.nextafter(value, 1e9))))))
        with pytest.raises(InputError, match=message):
            read_table(path, CIRCLE)

    @pytest.mark.parametrize("text", ["1_0", "\u0661", " 1.0", "1e5 ", "0x1p3", "Infinity", "1,0"])
    def test_what_python_takes_for_a_number_is_none(self, table, text):
        path, lines = table
        path.write_text("".join(with_cell(lines, 3, "feed_mm_s", text)))
        with pytest.raises(InputError, match=r"must be a number|cells"):
            read_table(path, CIRCLE)

    def test_what_is_said_twice_is_refused(self, table):
        path, lines = table
        path.write_text("".join(["# format = feedplan-table 2\n", *lines]))
        with pytest.raises(InputError, match=r'"# format = ..." is given twice; leave one'):
            read_table(path, CIRCLE)
        at = first_row(lines) - 1
        twice = [line.rstrip("\n") + f",{line.rstrip(chr(10)).split(',')[5]}\n" for line in lines[at:]]
        path.write_text("".join([*lines[:at], *twice]))
        with pytest.raises(InputError, match='the column "feed_mm_s" is given twice'):
            read_table(path, CIRCLE)

    def test_what_is_unknown_is_refused(self, table):
        path, lines = table
        path.write_text("".join(["# path_tolerance = 3\n", *lines]))
        for reader in (lambda: read_table(path, CIRCLE), lambda: table_limits(path)):
            with pytest.raises(InputError, match=r'"# path_tolerance = ..." is unknown'):
                reader()

    def test_a_changed_limit_is_seen_without_the_rows(self, table):
        path, lines = table
        path.write_text("".join(lines).replace("limit_feed_mm_s = 100.0", "limit_feed_mm_s = 200.0"))
        with pytest.raises(InputError, match="header_sha256 differs"):
            table_limits(path)

    def test_an_older_table_says_what_to_do(self, table):
        path, lines = table
        path.write_text("".join(lines).replace("feedplan-table 2", "feedplan-table 1"))
        with pytest.raises(InputError, match=r'version "1" is not read; .* plan again to write it'):
            read_table(path, CIRCLE)

    @pytest.mark.parametrize("shape", ["(1000000000000,)", "(13,)", "(14, 1)", "()", "(-1,)"])
    def test_a_shape_is_not_believed(self, tmp_path, plan, shape):
        write_table(tmp_path / "t.npz", plan, LIMITS)
        with zipfile.ZipFile(tmp_path / "t.npz") as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        assert b"(14,)" in members["u.npy"]
        members["u.npy"] = members["u.npy"].replace(b"(14,)", shape.encode())
        with zipfile.ZipFile(tmp_path / "t.npz", "w") as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        with pytest.raises(InputError, match=r"t\.npz: u "):
            read_table(tmp_path / "t.npz", CIRCLE)

    def test_a_compressed_archive_is_refused_before_it_grows(self, tmp_path, plan):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("header.npy", bytes(50_000_000))
        (tmp_path / "t.npz").write_bytes(buffer.getvalue())
        with pytest.raises(InputError, match="is compressed, or larger than the file"):
            read_table(tmp_path / "t.npz", CIRCLE)

    def test_the_bound_of_a_plan_read_back_is_that_of_the_plan(self, tmp_path):
        profile = plan_feedrate(BENDS, MILL, exact_stop=True, intervals=400)
        write_table(tmp_path / "t.csv", profile, MILL)
        found = read_table(tmp_path / "t.csv", BENDS)
        assert certify(BENDS, MILL, found) == certify(BENDS, MILL, profile)

    def test_stops_and_ends_that_are_claimed_must_be_there(self, tmp_path):
        plain = plan_feedrate(BENDS, MILL, intervals=400, end_feed=20.0)
        for origin, message in (
            (Origin(exact_stop=True), "does not stop at u = 0.5, "),
            (Origin(periodic=True), "periodic = yes, but"),
        ):
            write_table(tmp_path / "t.csv", dataclasses.replace(plain, origin=origin), MILL)
            with pytest.raises(InputError, match=message):
                read_table(tmp_path / "t.csv", BENDS)

    def test_a_plan_slowed_as_a_whole_says_so(self, tmp_path, teardrop):
        """What binds is what did before, and the table says by which factor: another factor is another name somewhere."""
        profile, limits = teardrop
        k = 1.2
        nodes = (profile.t * k, profile.u, profile.u_rate / k, profile.u_acceleration / k**2)
        slowed = np.where(np.arange(profile.t.size) < 20, 1.0, k)
        plan = make_profile(profile.curve, limits, TimeLaw(*nodes), method="", slowed=slowed)
        assert plan.slowed == ((0, 1.0), (20, k))
        assert (plan.binding[20:] == profile.binding[20:]).mean() > 0.98
        path = tmp_path / "t.csv"
        write_table(path, plan, limits)
        found = read_table(path, profile.curve)
        assert found.slowed == plan.slowed
        assert check(profile.curve, limits, found).row("binding limit").ok
        for slowed, message in (
            (((0, 1.0),), 'binding = ".*" disagrees'),
            (((0, 0.5),), "factors of at least 1"),
            (((1, k),), "rows increasing from 0"),
        ):
            false = dataclasses.replace(plan, slowed=slowed)
            write_table(path, false, limits)
            with pytest.raises(InputError, match=message):
                read_table(path, profile.curve)

    @pytest.mark.parametrize(
        ("word", "status"),
        [
            *((status.value, status) for status in Status),
            ("slowed down by 0.21 %", Status.SLOWED),
            ("stalled: the Newton system is singular", Status.SINGULAR),
            ("stalled: the step length vanished", Status.NO_STEP),
            ("stalled: 200 iterations", Status.TOO_MANY),
            ("done", None),
        ],
    )
    def test_the_status_of_tables_written_before_is_understood(self, tmp_path, teardrop, word, status):
        profile, limits = teardrop
        write_table(tmp_path / "t.csv", dataclasses.replace(profile, status=SimpleNamespace(value=word)), limits)
        assert f"# status = {word}\n" in (tmp_path / "t.csv").read_text()
        if status is not None:
            assert read_table(tmp_path / "t.csv", profile.curve).status is status
        else:
            with pytest.raises(InputError, match='status = "done"; it must be one of optimal, feasible'):
                read_table(tmp_path / "t.csv", profile.curve)

    def test_a_plan_that_breaks_a_limit_is_marked(self, tmp_path, teardrop):
        profile, limits = teardrop
        for tight, verdict in ((limits, "every limit holds"), (limits.with_feed(50.0), "BREAKS ITS LIMITS: ")):
            write_table(tmp_path / "t.csv", profile, tight)
            assert f"# verdict = {verdict}" in (tmp_path / "t.csv").read_text()


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

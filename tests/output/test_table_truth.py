"""What a table claims is computed again: whoever edits one is found out, seals or not."""

from __future__ import annotations

import dataclasses
import io
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from cases import drives
from check_plans import with_columns
from table_lines import CIRCLE, LIMITS, first_row, same_bits, sealed, with_cell

from planner import (
    InputError,
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
from planner.law import TimeLaw
from planner.origin import Origin
from planner.profile import make_profile
from planner.status import Status
from planner.verify.implied_columns import Nodes

MILL = drives()
# Two parabolas: the tangent goes on where they join, the curvature jumps.
BENDS = NurbsCurve([[0, 0], [10, 0], [15, 5], [15, 25]], [0, 0, 0, 0.5, 1, 1, 1], 2, name="bends")
SUFFIXES = pytest.mark.parametrize("suffix", [".csv", ".npz"])


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

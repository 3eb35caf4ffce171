"""Certificates on disk: bit by bit, written whole, and nothing read that is none."""

import dataclasses
import io
import json
import zipfile

import numpy as np
import pytest
from certificates import line_certificate, smooth_certificate
from table_lines import sealed

from feedplan.cli import app
from planner import InputError, load_curve, load_limits, plan_feedrate, write_table
from planner.errors import FeedrateError
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.output.certificate_file import read_certificate, write_certificate
from planner.verify.certificate import verify_bound

ARRAYS = ("knots", "ends", "sigma", "u", "jerk", "acceleration")


@pytest.fixture
def corner():
    """Two sections, two axes."""
    curve = NurbsCurve([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0]], [0.0, 0.0, 40.0, 70.0, 70.0], 1, name="corner")
    certificate = smooth_certificate(curve, seed=1, jerk=0.01, acceleration=1e-3)
    return curve, Limits(50.0, [100.0] * 2, [1000.0] * 2, [2e4] * 2), certificate


@pytest.fixture
def file(tmp_path, corner):
    path = tmp_path / "bound.npz"
    write_certificate(path, corner[2])
    return path


def members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: np.lib.format.read_array(archive.open(name)) for name in archive.namelist()}


def rewritten(path, compression=zipfile.ZIP_STORED, **changes):
    """The file with other members; bytes are taken as they are."""
    found = members(path) | {f"{name}.npy": value for name, value in changes.items()}
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, value in found.items():
            if isinstance(value, bytes):
                archive.writestr(name, value)
            elif value is not None:
                data = io.BytesIO()
                np.lib.format.write_array(data, value)
                archive.writestr(name, data.getvalue())
    return path


class TestRoundTrip:
    def test_every_number_comes_back(self, file, corner):
        found, wrote = read_certificate(file), corner[2]
        for name in ("jerk_names", "acceleration_names", "bound", "fingerprint", "periodic"):
            assert getattr(found, name) == getattr(wrote, name)
        assert len(found.sections) == len(wrote.sections) == 2
        for a, b in zip(found.sections, wrote.sections, strict=True):
            for field in dataclasses.fields(a):
                np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))
        curve, limits, _ = corner
        assert verify_bound(curve, limits, found) == verify_bound(curve, limits, wrote)

    def test_the_same_certificate_gives_the_same_bytes(self, file, tmp_path, corner):
        write_certificate(tmp_path / "again.npz", corner[2])
        assert (tmp_path / "again.npz").read_bytes() == file.read_bytes()

    def test_numpy_reads_it(self, file):
        with np.load(file) as found:
            assert set(found) == {"header", *ARRAYS}
            assert json.loads(found["header"].tobytes())["format"] == "feedplan-certificate 1"

    def test_nothing_is_left_of_a_file_that_cannot_be_written(self, tmp_path, corner):
        with pytest.raises(InputError, match=r"must be \.npz"):
            write_certificate(tmp_path / "bound.csv", corner[2])
        with pytest.raises(InputError, match="there is no directory"):
            write_certificate(tmp_path / "no" / "bound.npz", corner[2])
        assert list(tmp_path.iterdir()) == []


class TestRefusals:
    def refused(self, path, match):
        with pytest.raises(InputError, match=match) as error:
            read_certificate(path)
        assert str(path) in str(error.value)

    def test_what_is_no_file(self, tmp_path):
        self.refused(tmp_path / "none.npz", "cannot be read")
        self.refused(tmp_path, "must be .npz")
        text = tmp_path / "text.npz"
        text.write_text("# format = feedplan-table 1\n")
        self.refused(text, "not a whole NPZ file")

    def test_cut_off_at_any_byte(self, file):
        whole = file.read_bytes()
        for size in range(0, len(whole), 97):
            file.write_bytes(whole[:size])
            self.refused(file, "whole NPZ file|cannot be read")

    def test_a_table_is_no_certificate(self, tmp_path):
        curve = load_curve("circle")
        limits = load_limits("mill").for_curve(curve)
        write_table(tmp_path / "plan.npz", plan_feedrate(curve, limits, intervals=60), limits)
        self.refused(tmp_path / "plan.npz", "is no certificate")

    @pytest.mark.parametrize("name", ARRAYS)
    def test_shapes(self, file, name):
        values = members(file)[f"{name}.npy"]
        self.refused(rewritten(file, **{name: np.concatenate([values, values], axis=-1)}), name)
        self.refused(rewritten(file, **{name: values.astype(np.float32)}), f"{name} is float32")
        self.refused(rewritten(file, **{name: np.asfortranarray(np.ones((3, 3)))}), "rows|must be")
        self.refused(rewritten(file, **{name: b"nonsense"}), f"{name} cannot be read")

    @pytest.mark.parametrize("name", ARRAYS)
    def test_a_missing_array(self, file, name):
        self.refused(rewritten(file, **{name: None}), "is no certificate")

    def test_objects_are_not_unpickled(self, file):
        data = io.BytesIO()
        np.lib.format.write_array(data, np.array([print], dtype=object))
        self.refused(rewritten(file, sigma=data.getvalue()), "sigma is object")

    def test_promises_of_size_are_not_allocated(self, file):
        data = io.BytesIO()
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
        np.lib.format.write_array_header_1_0(data, header)
        whole = file.read_bytes()
        self.refused(rewritten(file, sigma=data.getvalue()), "needs another number")
        file.write_bytes(whole)
        self.refused(rewritten(file, zipfile.ZIP_DEFLATED, sigma=np.zeros(10**6)), "compressed")

    @pytest.mark.parametrize("knots", [[0, 0], [-5, 60], [2**62, 2**62], [1, 49]])
    def test_numbers_of_knots(self, file, knots):
        self.refused(rewritten(file, knots=np.array(knots)), "knots must give")

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("format", "feedplan-certificate 2"),
            ("curve_hash", 5),
            ("bound_s", "5"),
            ("bound_s", float("inf")),
            ("bound_s", True),
            ("periodic", 0),
            ("jerk_names", "jerk X"),
            ("acceleration_names", [1]),
            ("acceleration_names", None),
        ],
    )
    def test_the_header(self, file, key, value):
        header = json.loads(members(file)["header.npy"].tobytes()) | {key: value}
        raw = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        self.refused(rewritten(file, header=raw), key)
        self.refused(rewritten(file, header=raw[:-3]), "no JSON")

    def test_no_flipped_bit_is_a_traceback_or_a_better_bound(self, file, corner):
        """A change that reads well still proves no more than is true: it is refused, or proves what it claims."""
        curve, limits, certificate = corner
        plan = plan_feedrate(curve, limits, intervals=400).duration
        whole, rng = bytearray(file.read_bytes()), np.random.default_rng(11)
        read = 0
        for _ in range(400):
            damaged = bytearray(whole)
            for at in rng.integers(len(whole), size=rng.integers(1, 4)):
                damaged[at] ^= 1 << rng.integers(8)
            file.write_bytes(damaged)
            try:
                report = verify_bound(curve, limits, read_certificate(file))
            except FeedrateError:
                continue
            read += 1
            assert not report.proved > plan
        assert verify_bound(curve, limits, certificate).proved > 0.0
        # zip's own sums find most
        assert 0 < read < 100


class TestCommand:
    @pytest.fixture
    def run(self, capsys):
        def command(*arguments):
            capsys.readouterr()
            with pytest.raises(SystemExit) as stop:
                app([str(argument) for argument in arguments], prog_name="feedplan")
            out, err = capsys.readouterr()
            return stop.value.code or 0, " ".join(out.split()), err

        return command

    @pytest.fixture
    def planned(self, tmp_path):
        """A straight line, its plan, and the certificate of its optimum."""
        length, velocity, acceleration, jerk = 100.0, 120.0, 1000.0, 2e4
        table = {
            "degree": 1,
            "control_points": [[0.0, 0.0], [length, 0.0]],
            "knots": [0.0, 0.0, length, length],
        }
        source = tmp_path / "line.json"
        source.write_text(json.dumps({"type": "nurbs", "name": "line", "axes": ["X", "Y"]} | table))
        curve = load_curve(str(source))
        limits = Limits(1000.0, [velocity] * 2, [acceleration] * 2, [jerk] * 2)
        plan = dataclasses.replace(plan_feedrate(curve, limits, intervals=300), lower_bound=0.9)
        write_table(tmp_path / "plan.csv", plan, limits)
        certificate = line_certificate(curve, length, velocity, acceleration, jerk)
        write_certificate(tmp_path / "bound.npz", certificate)
        return tmp_path / "plan.csv", source, tmp_path / "bound.npz", certificate

    def test_proved(self, run, planned):
        table, source, file, certificate = planned
        code, out, _ = run("check", table, source, "--certificate", file)
        assert code == 0
        assert f"lower bound {certificate.bound:.6g} s; the gap is at most" in out
        assert "proved by the certificate" in out
        assert "no plan of line from rest to rest that keeps these limits takes less than 1.00333333 s" in out
        code, out, _ = run("check", table, source, "--certificate", file, "--json")
        facts = json.loads(out)
        assert code == 0
        assert facts["lower_bound_is"] == "proved by the certificate"
        assert facts["certificate"]["proved_s"] == pytest.approx(certificate.bound, rel=1e-12)
        assert facts["lower_bound_s"] == facts["certificate"]["proved_s"]
        assert facts["certificate"]["ok"] is True

    def test_planned_and_checked(self, run, tmp_path):
        table, file = tmp_path / "plan.npz", tmp_path / "bound.npz"
        code, out, _ = run("plan", "teardrop", "--intervals", "200", "-o", table, "--certificate", file)
        assert code == 0
        assert "proved by the certificate" in out
        code, out, _ = run("check", table, "teardrop", "--certificate", file, "--json")
        facts = json.loads(out)
        assert code == 0
        proof = facts["certificate"]
        assert proof["claimed_s"] <= proof["proved_s"] * (1.0 + 1e-9)
        assert proof["proved_s"] == pytest.approx(facts["duration_s"], rel=1e-3)
        code, _, err = run("plan", "teardrop", "--method", "toppra", "--certificate", file)
        assert code == 2
        assert "the method toppra gives none" in err
        assert run("plan", "teardrop", "--certificate", tmp_path / "bound.csv")[0] == 2

    def test_only_claimed(self, run, planned):
        table, source, _, _ = planned
        code, out, _ = run("check", table, source)
        assert code == 0
        assert "is the table's claim, not checked" in " ".join(out.split())
        facts = json.loads(run("check", table, source, "--json")[1])
        assert facts["lower_bound_is"] == "claimed by the table, not verified"
        assert "certificate" not in facts

    def test_a_claim_that_does_not_hold(self, run, planned):
        table, source, file, certificate = planned
        write_certificate(file, dataclasses.replace(certificate, bound=1.0035))
        code, out, _ = run("check", table, source, "--certificate", file)
        assert code == 1
        assert "NOT PROVED the certificate proves 1.00333333 s, not the 1.0035 s that it claims" in out
        assert "OK" not in out
        code, out, _ = run("check", table, source, "--certificate", file, "--json")
        assert (code, json.loads(out)["ok"]) == (1, False)

    def test_a_table_that_claims_more(self, run, planned):
        table, source, file, _ = planned
        lines = table.read_text().replace("lower_bound_s = 0.9", "lower_bound_s = 1.00334").splitlines(keepends=True)
        table.write_text("".join(sealed(lines)))
        code, out, _ = run("check", table, source, "--certificate", file)
        assert code == 1
        assert "not the 1.00334 s that the table claims" in out

    def test_limits_of_another_machine_prove_another_bound(self, run, planned, tmp_path):
        table, source, file, _ = planned
        machine = tmp_path / "faster.toml"
        axis = "velocity_mm_s = 240.0\nacceleration_mm_s2 = 2000.0\njerk_mm_s3 = 1e5\n"
        machine.write_text("feed_mm_s = 1000.0\n" + "".join(f'[[axis]]\nname = "{name}"\n{axis}' for name in "XY"))
        code, out, _ = run("check", table, source, "--machine", machine, "--certificate", file)
        assert code == 1
        assert "NOT PROVED" in out

    def test_bad_files(self, run, planned):
        table, source, file, certificate = planned
        write_certificate(file, dataclasses.replace(certificate, fingerprint="0" * 32))
        code, out, err = run("check", table, source, "--certificate", file)
        assert (code, out) == (2, "")
        assert "the certificate is for another curve" in err
        assert run("check", table, source, "--certificate", table)[0] == 2
        assert run("check", table, source, "--certificate", file.with_name("none.npz"))[0] == 2

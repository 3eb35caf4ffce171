"""Machine files, good and bad."""

import json

import numpy as np
import pytest
from doc_pages import DOCS, key_tables

from planner import CurveError, InputError, Limits, load_limits
from planner.machine.machine_file import EXAMPLE_MACHINES

PLAIN = {"feed": 100, "velocity": [250, 200], "acceleration": [1000, 800], "jerk": [2e4, 1e4]}


def limits(**changes):
    return Limits(**(PLAIN | changes))


HEAD = {"feed_mm_s": 100.0, "chord_error_mm": 0.001, "period_s": 0.002}
X = {"name": "X", "velocity_mm_s": 250.0, "acceleration_mm_s2": 1000, "jerk_mm_s3": 20000.0}
A = {"name": "A", "velocity_rad_s": 0.4, "acceleration_rad_s2": 0.5, "jerk_rad_s3": 1.5}
HEAD_KEYS = ", ".join(row[0] for row in key_tables(DOCS / "format-machine.md")["machine"])


def toml(value):
    """Literal of a value; text in quotes is taken as it is."""
    if isinstance(value, float):
        return repr(value)
    return value[1:] if isinstance(value, str) and value.startswith("=") else json.dumps(value)


@pytest.fixture
def write(tmp_path):
    """Write a machine file from its head and its axes."""

    def write_file(head, *axes):
        lines = [f"{key} = {toml(value)}" for key, value in head.items()]
        for axis in axes:
            lines += ["[[axis]]", *(f"{key} = {toml(value)}" for key, value in axis.items())]
        path = tmp_path / "machine.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        return path

    return write_file


def without(table, key):
    return {name: value for name, value in table.items() if name != key}


BAD_FILES = {
    "feed zero": ((HEAD | {"feed_mm_s": 0}, X), "feed_mm_s = 0 must be a number > 0; use inf"),
    "feed negative": ((HEAD | {"feed_mm_s": -5.0}, X), "feed_mm_s = -5.0 must be a number > 0; use inf"),
    "feed nan": ((HEAD | {"feed_mm_s": "=nan"}, X), "feed_mm_s = nan must be"),
    "feed a text": ((HEAD | {"feed_mm_s": "100"}, X), "feed_mm_s = '100' must be a number > 0"),
    "feed a truth value": ((HEAD | {"feed_mm_s": True}, X), "feed_mm_s = True must be a number > 0"),
    "feed a date": ((HEAD | {"feed_mm_s": "=1979-05-27"}, X), "feed_mm_s = datetime.* must be a number > 0"),
    "feed a list": ((HEAD | {"feed_mm_s": [1]}, X), r"feed_mm_s = \[1\] must be a number > 0"),
    "feed beyond doubles": ((HEAD | {"feed_mm_s": 10**400}, X), "feed_mm_s = 1000.* must be a number > 0"),
    "feed missing": ((without(HEAD, "feed_mm_s"), X), f'"feed_mm_s" is missing; the keys are {HEAD_KEYS}'),
    "feed in km/h": (
        (without(HEAD, "feed_mm_s") | {"feed_km_h": 6}, X),
        f'toml:3: unknown key "feed_km_h"; the keys are {HEAD_KEYS}, or the like in other units',
    ),
    "feed twice": ((HEAD | {"feed_mm_min": 6000}, X), 'toml:4: "feed_mm_min" says again what is given in another unit'),
    "feed in mm/min zero": (
        (without(HEAD, "feed_mm_s") | {"feed_mm_min": 0}, X),
        "toml:3: feed_mm_min = 0 must be a number > 0; use inf",
    ),
    "period zero": ((HEAD | {"period_s": 0}, X), "period_s = 0 must be a finite number > 0"),
    "period infinite": ((HEAD | {"period_s": np.inf}, X), "period_s = inf must be a finite number > 0"),
    "period in minutes": ((without(HEAD, "period_s") | {"period_min": 1}, X), 'toml:3: unknown key "period_min"'),
    "period in ms infinite": (
        (without(HEAD, "period_s") | {"period_ms": np.inf}, X),
        "period_ms = inf must be a finite",
    ),
    "unknown key": ((HEAD | {"speed": 1}, X), f'unknown key "speed"; the keys are {HEAD_KEYS}'),
    "no axes": ((HEAD,), r'one "\[\[axis\]\]" table for each axis'),
    "axis a number": ((HEAD | {"axis": 5},), r'one "\[\[axis\]\]" table for each axis'),
    "axis a list": ((HEAD | {"axis": [1]},), r'one "\[\[axis\]\]" table for each axis'),
    "axis without name": ((HEAD, without(X, "name")), r'"axis\[0\].name" is missing; the keys are name, velocity'),
    "axis unknown": ((HEAD, X | {"name": "Q"}), r"axis\[0\].name = 'Q' must be one of X, Y, Z, A, B, C, U, V, W"),
    "axis lower case": ((HEAD, X | {"name": "x"}), r"axis\[0\].name = 'x' must be one of X"),
    "axis a number's name": ((HEAD, X | {"name": 1}), r"axis\[0\].name = 1 must be one of X"),
    "axis twice": ((HEAD, X, A, X), 'toml:15: axis "X" is given twice'),
    "jerk missing": (
        (HEAD, X, without(A, "jerk_rad_s3")),
        r'"axis\[1\] \(A\).jerk_rad_s3" is missing, jerk of axis A; write it there, or give jerk_rad_s3 \(--jerk-rad-s3\)',
    ),
    "jerk zero": (
        (HEAD, X | {"jerk_mm_s3": 0}),
        r"toml:8: axis\[0\] \(X\).jerk_mm_s3 = 0 must be a number > 0; use inf",
    ),
    "velocity negative": (
        (HEAD, X, A | {"velocity_rad_s": -1.0}),
        r"toml:11: axis\[1\] \(A\).velocity_rad_s = -1.0 must be",
    ),
    "linear axis in rad": (
        (HEAD, without(X, "velocity_mm_s") | {"velocity_rad_s": 1.0}),
        r'unknown key "axis\[0\] \(X\).velocity_rad_s"; the keys are name, velocity_mm_s, acceleration_mm_s2, jerk',
    ),
    "rotary axis in mm": (
        (HEAD, A | {"velocity_mm_s": 1.0}),
        r'unknown key "axis\[0\] \(A\).velocity_mm_s"; the keys are name, velocity_rad_s, acceleration_rad_s2',
    ),
    "unknown key of an axis": ((HEAD, X | {"backlash_mm": 0.1}), r'unknown key "axis\[0\] \(X\).backlash_mm"'),
}


class TestMachineFiles:
    def test_values_and_defaults(self, write):
        machine = load_limits(write(HEAD, A, X))
        assert (machine.feed, machine.chord_error, machine.period) == (100.0, 0.001, 0.002)
        assert machine.axes == ("A", "X")
        assert machine.velocity.tolist() == [0.4, 250.0]
        assert machine.acceleration.tolist() == [0.5, 1000.0]
        assert machine.jerk.tolist() == [1.5, 20000.0]
        bare = load_limits(write({"feed_mm_s": 5}, X))
        assert (bare.chord_error, bare.period) == (np.inf, 1e-3)
        assert (bare.tangential_acceleration, bare.tangential_jerk) == (np.inf, np.inf)

    def test_infinity_means_no_limit(self, write):
        free = dict.fromkeys(without(HEAD, "period_s"), np.inf) | {"tangential_jerk_mm_s3": np.inf}
        machine = load_limits(write(free, X | {"jerk_mm_s3": np.inf}))
        assert (machine.feed, machine.jerk[0], machine.tangential_jerk) == (np.inf, np.inf, np.inf)

    def test_order_of_the_keys_does_not_matter(self, write):
        shuffled = dict(reversed(X.items()))
        assert load_limits(write(HEAD, shuffled)).velocity.tolist() == [250.0]

    @pytest.mark.parametrize(("tables", "message"), BAD_FILES.values(), ids=BAD_FILES.keys())
    def test_bad_file_is_refused_by_its_key(self, write, tables, message):
        path = write(*tables)
        with pytest.raises(InputError, match=message) as caught:
            load_limits(path)
        assert str(caught.value).startswith(str(path))
        assert not isinstance(caught.value, CurveError)

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (b"", '"feed_mm_s" is missing'),
            (b"feed_mm_s = = 1", "toml:1: not a valid TOML file"),
            (b"feed_mm_s = 1\nfeed_mm_s = 2", r"toml: not a valid TOML file \(Cannot overwrite"),
            (bytes(range(256)), "is not text in UTF-8"),
            (b"a = " + b"[" * 100_000, "not a valid TOML file"),
            (b"feed_mm_s = " + b"9" * 5000, "not a valid TOML file"),
            (b'{"feed_mm_s": 1}', "not a valid TOML file"),
        ],
    )
    def test_file_that_is_no_toml(self, tmp_path, content, message):
        path = tmp_path / "machine.toml"
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            load_limits(path)

    def test_missing_file_directory_and_other_things(self, tmp_path):
        with pytest.raises(InputError, match=r"none.toml: cannot be read \(No such file"):
            load_limits(tmp_path / "none.toml")
        with pytest.raises(InputError, match="is not a file"):
            load_limits(tmp_path)
        with pytest.raises(InputError, match="the example machines are mill, four-axis, five-axis"):
            load_limits("lathe")
        for other in (None, 5, b"mill", ["mill"]):
            with pytest.raises(InputError, match="must be the path of a file"):
                load_limits(other)
        with pytest.raises(InputError, match="null byte"):
            load_limits("a\0b")

    def test_example_machines(self):
        assert EXAMPLE_MACHINES == ("mill", "four-axis", "five-axis")
        mill, four, five = (load_limits(name) for name in EXAMPLE_MACHINES)
        assert four.axes == ("X", "Y", "Z", "A")
        assert four.velocity[:3].tolist() == mill.velocity.tolist()
        rotary = [row[3] for row in (four.velocity, four.acceleration, four.jerk)]
        assert np.rad2deg(rotary) == pytest.approx([180, 1000, 2e4])
        assert mill.axes == ("X", "Y", "Z")
        assert (mill.feed, mill.chord_error, mill.period) == (100.0, 1e-3, 1e-3)
        assert (mill.velocity[0], mill.acceleration[1], mill.jerk[2]) == (250.0, 1000.0, 20000.0)
        # Ma et al. 2022, section 4.3
        assert five.axes == ("X", "Y", "Z", "A", "C")
        assert five.velocity.tolist() == [100, 100, 100, 0.4, 0.8]
        assert five.acceleration.tolist() == [500, 500, 500, 0.5, 0.5]
        assert five.jerk.tolist() == [3000, 3000, 3000, 1.5, 1.5]
        assert (five.chord_error, five.period) == (0.000125, 0.002)

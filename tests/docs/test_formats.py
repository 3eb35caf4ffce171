"""The pages on file formats list the keys, columns and arrays that the code writes and reads: all of them, and no other."""

from __future__ import annotations

import json
import math
import re
import tomllib
from contextlib import suppress
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from cases import PROGRAMS, PROJECT
from doc_pages import DOCS, blocks, key_tables

import feedplan.cli.plan
import feedplan.progress
from feedplan.cli import app
from feedplan.exports import EXPORT_SUFFIXES
from planner import load_curve, load_limits, plan_feedrate, write_table
from planner.errors import InputError
from planner.geometry import catalog
from planner.machine.machine_file import read_machine
from planner.machine.machine_toml import HEAD_KEYS, LENGTHS, PROGRAM_KEYS, axis_keys, unit_keys
from planner.output.table import _KEYS
from planner.output.table_header import OPTIONAL_KEYS
from planner.plan import Method
from planner.programs.reading.language import G_WORDS, M_WORDS, NUMBER_LETTERS
from planner.quantity import QUANTITIES
from planner.status import Status

SLOTS = str(PROGRAMS / "slots.ngc")
STOPS = str(PROGRAMS / "stops.ngc")
ALWAYS = "always"
TABLES = (
    ("teardrop", "XY"),
    ("flank", "XYZAC"),
    ("slots", "XY"),
    ("slowed", "XY"),
    ("weighed", "XY"),
    ("sided", "XY"),
    ("reserved", "XY"),
)


def rows(page, name):
    """A table of keys on a page."""
    return key_tables(DOCS / f"{page}.md")[name]


def names(page, name):
    """The first column of it."""
    found = [row[0] for row in rows(page, name)]
    assert len(found) == len(set(found)), f"{page}: a key is listed twice"
    return found


def agree(page, table, found):
    """A page lists what the files have between them; what it says is always there is what they have in common."""
    listed = {row[0]: row[1] for row in rows(page, table)}
    assert set().union(*found) == set(listed), f"{page}, {table}"
    assert set.intersection(*found) == {key for key, when in listed.items() if when == ALWAYS}, f"{page}, {table}"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Files and JSON of every kind; between them they have every key."""
    folder = tmp_path_factory.mktemp("files")
    points = folder / "points.csv"
    points.write_text("0,0\n10,1\n20,4\n30,9\n40,16\n")
    mill = (PROJECT / "planner" / "data" / "machines" / "mill.toml").read_text(encoding="utf-8")
    (folder / "rapids.toml").write_text(mill.replace("period_s", "rapid_mm_s = 150.0\nperiod_s"))

    def run(*words, status=0):
        with pytest.raises(SystemExit) as stop:
            app([str(word) for word in words], prog_name="feedplan")
        assert (stop.value.code or 0) == status

    run("plan", "teardrop", "--certificate", folder / "bound.npz", "-o", folder / "teardrop.csv", "--intervals", 100)
    run("plan", "flank", "-o", folder / "flank.csv", "--intervals", 100)
    (folder / "pocket.ngc").write_text("G21 G17 G90\nG1 X9 F900\nY9\nX0\nY0\nM2\n")
    run("plan", folder / "pocket.ngc", "--side", "inside", "-o", folder / "sided.csv")
    run("plan", SLOTS, "--machine", folder / "rapids.toml", "-o", folder / "slots.csv", "--program", folder / "out.ngc",
        "--lines", folder / "slots-lines.csv")  # fmt: skip
    run("time", STOPS, "-o", folder / "stops-lines.csv")
    run("replay", folder / "teardrop.csv", "teardrop", "-o", folder / "teardrop-samples.csv")
    run("replay", folder / "flank.csv", "flank", "-o", folder / "flank-samples.csv")
    curve = load_curve("teardrop")
    limits = load_limits("mill").for_curve(curve)
    plan = replace(plan_feedrate(curve, limits, intervals=100), slowed=((0, 1.5),))
    write_table(folder / "slowed.csv", plan, limits)
    reserved = plan_feedrate(curve, limits, intervals=100, override_reserve=0.05)
    write_table(folder / "reserved.csv", reserved, limits)
    part = load_curve(SLOTS)
    write_table(folder / "weighed.csv", plan_feedrate(part, load_limits("mill").for_curve(part)), limits)
    return folder


@pytest.fixture
def json_of(capsys):
    """What a command prints as JSON, as a set of dotted keys."""

    def command(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit):
            app([str(word) for word in (*words, "--json")], prog_name="feedplan")
        return json.loads(capsys.readouterr().out)

    return command


def header(file):
    """Keys of the header of a CSV file, in their order."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return [line[2:].partition(" = ")[0] for line in lines if line.startswith("#")]


def columns(file):
    """Names of its columns."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return next(line for line in lines if not line.startswith("#")).split(",")


def spelled(keys, axes):
    """Keys with every axis and its unit put in."""
    out = []
    for key in keys:
        if "{axis}" not in key:
            out.append(key)
            continue
        out += [key.replace("{axis}", axis).replace("{unit}", "rad" if axis in "ABC" else "mm") for axis in axes]
    return out


def generic(keys, axes):
    """The other way round: keys of an axis, and those of a machine's limits, under the name that the page gives them."""
    unit = r"rad|mm"
    single = {f"limit_{key}" for key in names("format-machine", "machine")} - {"limit_rapid_mm_s"}
    assert single <= set(keys)
    keys = [key for key in keys if key not in single]
    return {"limit_{key}"} | {
        re.sub(rf"(^|_)({'|'.join(axes)})_({unit})(?=_|$)", r"\1{axis}_{unit}", key) for key in keys
    }


def test_columns_of_the_table(files):
    """In their order, for two and for five axes."""
    for name, axes in (("teardrop", "XY"), ("flank", "XYZAC"), ("slots", "XY")):
        assert columns(files / f"{name}.csv") == spelled(names("format-table", "columns"), axes)


def test_header_of_the_table(files):
    """Every line that any table has, and which all of them have."""
    found = [generic(header(files / f"{name}.csv"), axes) for name, axes in TABLES]
    agree("format-table", "header", found)
    assert {*_KEYS, *OPTIONAL_KEYS} <= set(names("format-table", "header"))


def test_words_of_the_status():
    """The words that the page explains are those of the enumeration."""
    assert set(names("format-table", "status")) == {status.value for status in Status}


def test_methods():
    """The page lists every method, and so does the command."""
    methods = get_args(Method)
    said = next(row[2] for row in rows("format-table", "header") if row[0] == "method")
    assert said == ", ".join(f"`{method}`" for method in methods)
    assert tuple(method.value for method in feedplan.cli.plan.MethodName) == methods


def test_samples(files):
    """Columns in their order, and the lines of the header."""
    for name, axes in (("teardrop", "XY"), ("flank", "XYZAC")):
        assert columns(files / f"{name}-samples.csv") == spelled(names("format-samples", "columns"), axes)
        assert header(files / f"{name}-samples.csv") == names("format-samples", "header")


def test_line_times(files):
    """With and without the column that only ``feedplan time`` writes."""
    assert columns(files / "stops-lines.csv") == names("format-line-times", "columns")
    listed = {row[0]: row[-1] for row in rows("format-line-times", "columns")}
    assert columns(files / "slots-lines.csv") == [
        key for key, said in listed.items() if "`feedplan time` only" not in said
    ]
    with pytest.raises(SystemExit):
        app(["windows", STOPS, "-o", str(files / "lines.npz")], prog_name="feedplan")
    assert columns(files / "lines.lines.csv") == [key for key, said in listed.items() if "`feedplan" not in said]
    agree("format-line-times", "header", [set(header(files / f"{name}-lines.csv")) for name in ("slots", "stops")])


def test_certificate(files):
    """Arrays, and keys of the header in one of them."""
    with np.load(files / "bound.npz") as archive:
        assert list(archive) == names("format-certificate", "arrays")
        assert list(json.loads(archive["header"].tobytes())) == names("format-certificate", "header")


def test_plan_of_windows(files):
    """Arrays of the plan of a long program."""
    with pytest.raises(SystemExit):
        app(["windows", STOPS, "-o", str(files / "long.npz")], prog_name="feedplan")
    with np.load(files / "long.npz") as archive:
        assert set(archive) == set(names("format-windows", "arrays"))
        assert str(archive["format"]) in next(row[2] for row in rows("format-windows", "arrays") if row[0] == "format")


@pytest.mark.parametrize("kind", list(catalog._KEYS))
def test_keys_of_a_curve(kind):
    """Of each type, and the remarks that may stand beside them."""
    assert set(names("format-curve", kind)) == set(catalog._KEYS[kind])
    assert set(names("format-curve", "remarks")) == set(catalog._REMARKS)


def test_keys_of_a_machine():
    """Those by which the file is read, what is needed and what is taken where it is left out."""
    keys = {"machine": HEAD_KEYS, "linear axis": axis_keys("mm"), "rotary axis": axis_keys("rad")}
    for name, known in keys.items():
        assert names("format-machine", name) == list(known)
    for key, said, *_ in rows("format-machine", "machine"):
        assert said == ("needed" if math.isnan(HEAD_KEYS[key]) else f"{HEAD_KEYS[key]:g}")


def test_example_of_a_machine_has_every_key():
    """The TOML block of the page shows all keys of its tables."""
    text = next(block.text for block in blocks(DOCS / "format-machine.md") if block.language == "toml")
    table = tomllib.loads(text)
    shown = set(table) - {"axis"} | {key for axis in table["axis"] for key in axis}
    assert shown == {key for name in ("machine", "linear axis", "rotary axis") for key in names("format-machine", name)}


def test_every_key_of_an_ini_file_counts(tmp_path):
    """The INI block shows the keys of the list, and each of them changes the limits or is needed."""
    text = next(block.text for block in blocks(DOCS / "format-machine.md") if block.language == "ini")
    file = tmp_path / "machine.ini"
    file.write_text(text)
    whole = load_limits(file)
    section, lines = "", text.splitlines()
    shown = set()
    for k, line in enumerate(lines):
        if line.startswith("["):
            section = line
        if "=" not in line:
            continue
        shown.add(f"{section}{line.split(' = ')[0]}".replace("[AXIS_Y]", "[AXIS_X]"))
        without = [*lines[:k], *lines[k + 1 :]]
        if section == "[KINS]":
            without.append("[KINS]\nKINEMATICS = 5axiskins")  # the default is trivkins, which the block says too
        if "ANGULAR" in line or "SERVO" in line:
            continue  # a block of linear axes, and of the default period
        file.write_text("\n".join(without))
        with suppress(InputError):  # it is needed
            assert load_limits(file) != whole, f"{section}{line} changes nothing"
    assert shown == set(names("format-machine", "ini"))


def test_units_and_the_table_of_programs():
    """Every unit of a key is listed, and every key of the table in its first unit."""
    assert names("format-machine", "units") == [unit for units in LENGTHS.values() for unit in units]
    for unit, example in rows("format-machine", "units"):
        for key in re.findall(r"`(\w+)`", example):
            assert f"_{unit}" in key
            assert key in {
                other for known in (*HEAD_KEYS, *axis_keys("mm"), *axis_keys("rad")) for other in unit_keys(known)
            }
    stems = {key if key.endswith("_s") else key.rpartition("_")[0] or key for key in PROGRAM_KEYS}
    assert {key.removesuffix("_mm") for key in names("format-machine", "program")} == stems


@pytest.mark.parametrize(
    ("table", "file", "own"),
    [
        ("klipper", "printer.cfg", {"square_corner_velocity", "minimum_cruise_ratio"}),
        ("grbl", "grbl.txt", {"$11", "$12", "$800"}),
    ],
)
def test_every_key_of_a_controller_counts(tmp_path, table, file, own):
    """The block of the page has the keys of the list, and each of them changes the limits, or what the model goes by."""
    text = next(block.text for block in blocks(DOCS / "format-machine.md") if block.remark == f"file: {file}")
    lines = text.splitlines(keepends=True)
    shown = {}
    for k, line in enumerate(lines):
        shown[re.split("[:=]", line)[0]] = "".join([*lines[:k], *lines[k + 1 :]])
    path = tmp_path / file
    path.write_text(text)
    whole = load_limits(path)
    for key in set(names("format-machine", table)) - own:
        path.write_text(shown[key])
        with suppress(InputError):
            assert load_limits(path) != whole, f"{key} changes nothing"
    path.write_text(text)
    words = read_machine(path).setup.controller
    for key in own - {"$800"}:  # of a grblHAL alone
        path.write_text(shown[key])
        assert read_machine(path).setup.controller != words, f"{key} changes nothing"
    assert read_machine(path).limits == whole


def test_words_of_a_program():
    """G and M words and letters that are read, each with its number as it is written."""

    def word(letter, code):
        return f"{letter}{code / 10:g}" if letter == "G" else f"{letter}{code}"

    assert set(names("format-program", "G")) == {word("G", code) for code in G_WORDS}
    assert set(names("format-program", "M")) == {word("M", code) for code in M_WORDS}
    assert set(names("format-program", "letters")) == set(NUMBER_LETTERS)


def test_json_of_the_verdict(files, json_of):
    """Of a curve, a program with stops, one of passes side by side, points, a table with its certificate."""
    passes = "".join(f"G1 X{60 * (k % 2)} Y{k}\nG1 Y{k + 1}\n" for k in range(4))
    (files / "passes.ngc").write_text(f"G21 G90 G17\nF3000\n{passes}M2\n")
    agree_json(
        "verdict",
        [
            json_of("plan", files / "passes.ngc", "--tolerance-mm", 0.02),
            json_of("plan", "teardrop", "--intervals", 100),
            json_of("plan", STOPS, "-o", files / "stops.csv"),
            json_of("plan", STOPS, "--program", files / "stops.ngc"),
            json_of("plan", files / "points.csv", "--tolerance-mm", 0.01),
            json_of("check", files / "teardrop.csv", "teardrop", "--certificate", files / "bound.npz"),
        ],
    )


def test_json_of_many_programs(json_of):
    """Of the time of several, and of a sweep, whose limits have a key each."""
    many = json_of("time", STOPS, "--jobs", "1")
    swept = json_of("sweep", STOPS, "--jobs", "1", "--scale", "velocity=2")
    for row in swept["programs"]:
        row["scale_*"] = row.pop("scale_velocity")
    agree_json("batch", [many, swept])


def test_files_of_controllers(files):
    """Columns and headers of every format that has them, and which formats and suffixes there are."""
    listed = {row[0]: tuple(re.findall(r"`(\.\w+)`", row[1])) for row in rows("format-export", "formats")}
    assert listed == EXPORT_SUFFIXES
    table = files / "flank.csv"
    counts = ("--counts-per-mm", "1000", "--counts-per-rad", "1000", "--velocity-offset")
    steps = ("--steps-per-mm", "100", "--steps-per-rad", "100", "--format", "steps")
    for name, words in (("drives", counts), ("pulses", steps)):
        with pytest.raises(SystemExit) as stop:
            app(["export", str(table), "flank", *words, "-o", str(files / f"{name}.csv")], prog_name="feedplan")
        assert not stop.value.code
    listed = names("format-export", "csp columns")
    assert columns(files / "drives.csv") == [
        *spelled(listed[:1], "XYZAC"),
        *spelled(listed[1:2], "XYZAC"),
        *spelled(listed[2:], "XYZAC"),
    ]
    assert header(files / "drives.csv") == spelled(names("format-export", "csp header"), "XYZAC")
    found = header(files / "pulses.csv")
    assert found[-1] == "end"
    assert found[:-1] == spelled(names("format-export", "steps header"), "XYZAC")


def test_json_of_a_file_for_a_controller(files, json_of):
    """Each format has keys of its own."""
    table, steps = files / "teardrop.csv", ("--steps-per-mm", "100")
    exports = [("c.csv", "--counts-per-mm", "10"), ("r.yaml",), ("s.steps", *steps), ("p.fpr",)]
    agree_json("export", [json_of("export", table, "teardrop", "-o", files / name, *words) for name, *words in exports])


def test_json_of_times(json_of):
    """Beside its own keys, those of the program in the verdict."""
    found = json_of("time", STOPS)
    program = found["program"]
    assert {f"program.{key}" for key in dotted(program) if key != "file"} == {
        key for key in names("format-json", "verdict") if key.startswith("program.")
    }
    within = json_of("time", STOPS, "--tolerances-um", "5,50")["tolerances"]
    found["program"] = {"file": program["file"]}
    elsewhere = json_of("time", STOPS, "--controller", "klipper,grbl")["controllers"]
    others = json_of("time", STOPS, "--path", "separate"), json_of("time", STOPS, "--costs")
    assert "saved_by_one_percent_s" in others[0]
    more = [{**facts, "program": found["program"]} for facts in others]
    agree_json("time", [found, {**found, "tolerances": within}, {**found, "controllers": elsewhere}, *more])


def test_json_of_other_commands(files, json_of):
    """A program written, a long program, a comparison with the optimum and one without."""
    curves = ("teardrop", STOPS, files / "points.csv")
    tolerance = "--tolerance-mm", 0.01
    agree_json("ngc", [json_of("ngc", curve, *tolerance, "-o", files / "written.ngc") for curve in curves])
    windows = json_of("windows", STOPS, "-o", files / "windows.npz")
    agree_json("windows", [windows])
    for key, unit in {"duration": "s", "dwell": "s", "length": "mm", "deviation": "mm", "joint_feed": "mm_s",
                      "joint_acceleration": "mm_s2"}.items():  # fmt: skip
        assert windows[key] == windows[f"{key}_{unit}"]
    assert windows["planning_s"] == windows["planning_time_s"]
    agree_json("compare", [json_of("compare", "teardrop", "--methods", "scurve"),
                           json_of("compare", "teardrop", "--methods", "scurve,optimal")])  # fmt: skip


def test_json_of_the_named_curves(json_of):
    """A key for each curve, and its facts."""
    found = json_of("curves")
    assert tuple(found) == catalog.CATALOG
    agree_json("curves", [{"{curve}": facts} for facts in found.values()])


def agree_json(table, found):
    """As ``agree``, of nested keys, all ratios as one; a list without entries has those that the page names."""
    listed = set(names("format-json", table))
    sets = []
    for facts in found:
        shares = r"^((?:\w+\[\]\.)?(?:held_back_by|saved_by_one_percent_s))\..*"
        keys = {re.sub(shares, r"\1.{limit}", key) for key in dotted(facts)}
        keys = {re.sub(r"^checks\.(plan|samples)\[\]", "checks.{which}[]", key) for key in keys}
        keys = {re.sub(r"\.breaks\.G\d$", ".breaks.{order}", key) for key in keys}
        ratios = {f"methods[].{quantity.key}_ratio" for quantity in QUANTITIES}
        if ratios <= keys:
            keys = keys - ratios | {"methods[].{limit}_ratio"}
        sets.append({key for key in keys if key in listed or not any(one.startswith(f"{key}.") for one in listed)})
    agree("format-json", table, sets)


def dotted(value, prefix=""):
    """Keys of nested JSON; an entry of a list as [], also where it has none."""
    if isinstance(value, dict):
        return set().union(*(dotted(item, f"{prefix}.{key}" if prefix else key) for key, item in value.items()))
    if isinstance(value, list) and value:
        return set().union(*(dotted(item, f"{prefix}[]") for item in value))
    return {f"{prefix}[]"} if isinstance(value, list) else {prefix}

"""Limits from times of programs, against models whose limits are known; lists of times, and what is wrong with them."""

import numpy as np
import pytest

from planner.calibration.calibrated_machine import calibrated_limits
from planner.calibration.controller_times import calibrate_times
from planner.calibration.cycle_times import fit_times
from planner.calibration.times_list import is_times_list, read_times_list
from planner.controllers.known import known_controller
from planner.errors import InputError
from planner.machine.limits import Limits
from planner.machine.program_setup import ProgramSetup
from planner.programs.reading.reader import read_program
from planner.quantity import ACCELERATION, VELOCITY

AXES = ("X", "Y", "Z")
TRUE = Limits(500.0, [150.0, 120.0, 60.0], [900.0, 700.0, 400.0], [1e9] * 3, axes=AXES)
START = Limits(500.0, [250.0] * 3, [500.0] * 3, [1e9] * 3, axes=AXES)


def moves_of(seed, directions, count=30, size=80.0):
    """Displacements (count, 3) of a program's moves from rest to rest."""
    random = np.random.default_rng(seed)
    chosen = np.array(directions, dtype=float)[random.integers(0, len(directions), count)]
    return chosen * size * random.uniform(0.05, 1.0, (count, 1))


def seconds_of(programs, feed=np.inf):
    """Times of trapezoids from rest to rest: the closed form."""

    def seconds(limits):
        found = []
        for moves in programs:
            length = np.linalg.norm(moves, axis=1)
            with np.errstate(divide="ignore"):
                unit = np.abs(moves) / length[:, None]
                a, v = (
                    np.min(np.where(unit > 0, row / unit, np.inf), axis=1)
                    for row in (limits.acceleration, limits.velocity)
                )
            v = np.minimum(v, feed)
            short = length < v * v / a
            found.append(np.sum(np.where(short, 2.0 * np.sqrt(length / a), length / v + v / a)))
        return np.array(found)

    return seconds


RICH = [moves_of(k, np.concatenate([np.eye(3), np.random.default_rng(k).normal(size=(2, 3))])) for k in range(10)]


def values(fit, quantity, known=True):
    return {row.axis: row.value for row in fit.limits if row.quantity is quantity and row.known is known}


def require_true(fit):
    """What is said to be known is within three standard errors of the truth."""
    known = [row for row in fit.limits if row.known]
    assert known
    for row in known:
        truth = getattr(TRUE, row.quantity.key)[AXES.index(row.axis)]
        assert abs(np.log(row.value / truth)) < 3.0 * row.spread


def test_rich_times_give_every_limit_back():
    model = seconds_of(RICH)
    fit = fit_times(model, model(TRUE), START, AXES)
    assert list(values(fit, ACCELERATION).values()) == pytest.approx([900.0, 700.0, 400.0], rel=0.03)
    assert list(values(fit, VELOCITY).values()) == pytest.approx([150.0, 120.0, 60.0], rel=0.03)
    assert fit.misfit < 1e-3
    assert fit.singular_values.min() > 0.01


def test_other_programs_are_predicted():
    model = seconds_of(RICH)
    fit = fit_times(model, model(TRUE) * np.random.default_rng(1).normal(1.0, 0.003, 10), START, AXES)
    other = seconds_of([moves_of(k, np.random.default_rng(k).normal(size=(6, 3))) for k in range(50, 70)])
    error = np.abs(other(calibrated_limits(START, fit.limits)) / other(TRUE) - 1.0)
    assert np.median(error) < 0.01


def test_a_velocity_above_every_feed_is_not_told_and_stays():
    model = seconds_of(RICH, feed=40.0)
    fit = fit_times(model, model(TRUE), START, AXES)
    assert values(fit, VELOCITY) == {}
    assert all("do not depend" in row.why for row in fit.limits if row.quantity is VELOCITY)
    assert calibrated_limits(START, fit.limits).velocity.tolist() == [250.0] * 3
    require_true(fit)


def test_limits_that_only_count_together_are_not_known():
    """Short moves of Z and one along X and Y each: velocity is not reached; of one program only a mean is told."""
    programs = [moves_of(1, np.eye(3)[:2], size=2.0)]
    model = seconds_of(programs)
    fit = fit_times(model, model(TRUE), START, ("X", "Y"))
    assert values(fit, ACCELERATION) == {}
    assert all(row.joint for row in fit.limits if row.quantity is ACCELERATION)
    assert fit.misfit < 0.01


def test_as_many_limits_as_programs_fit_any_times_and_none_is_known():
    model = seconds_of(RICH[:5])
    fit = fit_times(model, model(TRUE), START, AXES)
    assert not any(row.known for row in fit.limits)


def test_a_program_that_waits_is_left_out():
    model = seconds_of(RICH)
    measured = model(TRUE)
    measured[3] *= 1.4
    fit = fit_times(model, measured, START, AXES)
    assert np.flatnonzero(~fit.used).tolist() == [3]
    assert fit.misfit < 1e-3
    require_true(fit)


# ---- lists -----------------------------------------------------------------------------------------------------------


def text_of(seed):
    points = np.cumsum(moves_of(seed, np.eye(3), 12), axis=0)
    return "G21 G90 G61 F3000\n" + "\n".join(f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f}" for x, y, z in points) + "\nM2\n"


@pytest.fixture
def folder(tmp_path):
    for k in range(6):
        (tmp_path / f"{k}.ngc").write_text(text_of(k))
    return tmp_path


def listed(folder, rows, head="program,seconds"):
    text = "\n".join([head, *rows]) + "\n"
    assert is_times_list(text)
    return read_times_list(text, folder / "times.csv", ProgramSetup())


def test_a_controller_is_calibrated_from_a_list(folder):
    grbl = known_controller("grbl")
    programs = [read_program(folder / f"{k}.ngc", start=(0, 0, 0)) for k in range(6)]
    seconds = [grbl.motion(program, grbl.on_limits(TRUE)).duration for program in programs]
    timed = listed(folder, [f"{k}.ngc,{s:.4f}" for k, s in enumerate(seconds)])
    found = calibrate_times(timed, START, "grbl", lambda _text, _share: None)
    assert found.controller == "grbl"
    assert found.fit.misfit < 0.002
    assert found.fit.predicted == pytest.approx(seconds, rel=0.005)


@pytest.mark.parametrize(
    ("rows", "head", "said"),
    [
        (["0.ngc,12"], "program,hours", "once each are needed: program and seconds"),
        (["0.ngc,12,3"], "program,seconds", "times.csv:2: 3 cells; a row must have 2"),
        (["0.ngc,fast"], "program,seconds", '"fast" must be a number > 0'),
        (["0.ngc,-3"], "program,seconds", "must be a number > 0"),
        (["0.ngc,nan"], "program,seconds", "must be a number > 0"),
        (["0.ngc,3", "0.ngc,4"], "program,seconds", "times.csv:3: 0.ngc is listed twice"),
        (["no.ngc,3"], "program,seconds", "no.ngc"),
        ([], "program,seconds", "lists no program"),
    ],
)
def test_lists_that_are_wrong(folder, rows, head, said):
    with pytest.raises(InputError, match=said.replace("(", "\\(")):
        listed(folder, rows, head)


def test_times_in_another_unit(folder):
    timed = listed(folder, ["0.ngc,12000", "1.ngc,13000"])
    with pytest.raises(InputError, match="is the time in seconds"):
        calibrate_times(timed, START, "grbl", lambda _text, _share: None)


def test_a_program_that_changes_tools_is_left_out_and_one_is_too_few(folder):
    (folder / "tools.ngc").write_text("T1 M6\n" + text_of(1))
    timed = listed(folder, ["0.ngc,12", "tools.ngc,40"])
    with pytest.raises(InputError, match="1 programs to go by"):
        calibrate_times(timed, START, "grbl", lambda _text, _share: None)


def test_a_controller_that_is_not_known(folder):
    timed = listed(folder, ["0.ngc,12", "1.ngc,13"])
    with pytest.raises(InputError, match="must be one of"):
        calibrate_times(timed, START, "fanuc", lambda _text, _share: None)

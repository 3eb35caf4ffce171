"""Every public function that takes a curve, limits, a plan or samples says which of them is something else."""

import re
from functools import cache
from pathlib import Path

import pytest

import feedplan as fp
from planner.output.plots import plot_plan
from planner.output.table import write_samples

PROGRAM = Path(__file__).parents[1] / "data/programs/slots.ngc"
LIMITS = fp.Limits(100, 250, 1000, 20000, chord_error=1e-3)
CURVE = fp.load_curve("circle")
GIVEN = {
    "curve": CURVE,
    "limits": LIMITS,
    "file": "never-written.csv",
    "position": [[0.0, 0.0]],
    "program": fp.read_program(PROGRAM),
    "path": None,
}


@cache
def made(name):
    """What the functions want, by the name of the parameter."""
    if name in GIVEN:
        return GIVEN[name]
    if name in ("profile", "plan"):
        return fp.plan_feedrate(CURVE, LIMITS, intervals=40)
    if name == "samples":
        return fp.replay(CURVE, made("profile"))
    return fp.check(CURVE, LIMITS, made("profile"))


CALLS = {
    "plan_feedrate": (fp.plan_feedrate, ("curve", "limits")),
    "feedrate_limits": (lambda curve, limits: fp.feedrate_limits(curve, limits, 0.5), ("curve", "limits")),
    "check": (fp.check, ("curve", "limits", "plan")),
    "certify": (fp.certify, ("curve", "limits", "profile")),
    "greedy": (lambda curve, limits: fp.greedy(curve, limits, 3), ("curve", "limits")),
    "replay": (fp.replay, ("curve", "profile")),
    "replay_form": (lambda curve, profile: fp.replay_form(curve, profile, "V(t)"), ("curve", "profile")),
    "InterpolatorTable": (fp.InterpolatorTable.from_profile, ("profile",)),
    "TaylorTable": (fp.TaylorTable.from_profile, ("profile",)),
    "write_table": (lambda profile, limits: fp.write_table("never.csv", profile, limits), ("profile", "limits")),
    "read_table": (lambda curve: fp.read_table("never.csv", curve), ("curve",)),
    "write_samples": (lambda *given: write_samples("never.csv", *given), ("curve", "samples", "report")),
    "write_ngc": (lambda curve, plan: fp.write_ngc("never.ngc", curve, plan, tolerance=0.01), ("curve", "plan")),
    "plot_plan": (plot_plan, ("curve", "limits", "profile")),
    "interpolate_shape": (lambda curve: fp.interpolate_shape(curve, "bell", 1e-3), ("curve",)),
    "interpolate_constant": (lambda curve: fp.interpolate_constant(curve, 10.0, 1e-3), ("curve",)),
    "interpolate_adaptive": (fp.interpolate_adaptive, ("curve", "limits")),
    "filter_axes": (lambda samples: fp.filter_axes(samples, "half-sine", 0.1), ("samples",)),
    "contour_error": (fp.contour_error, ("curve", "position")),
    "for_curve": (LIMITS.for_curve, ("curve",)),
    "program_path": (lambda program, limits: fp.program_path(program, 0.01, limits), ("program", "limits")),
    "line_times": (fp.line_times, ("program", "path", "profile")),
}
CHECKED = {"curve", "limits", "plan", "profile", "samples", "report", "program", "path"}


def every_place():
    for name, (_, parameters) in CALLS.items():
        for place, parameter in enumerate(parameters):
            if parameter in CHECKED and (name, parameter) != ("line_times", "profile"):
                yield name, place, parameter


@pytest.mark.parametrize("wrong", [None, "circle", [1.0, 2.0], object, "swapped"])
@pytest.mark.parametrize(("name", "place", "parameter"), list(every_place()))
def test_a_wrong_argument_is_named(name, place, parameter, wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, parameters = CALLS[name]
    given = [made(p) for p in parameters]
    given[place] = made("samples" if parameter == "curve" else "curve") if wrong == "swapped" else wrong
    with pytest.raises(fp.InputError, match=rf"^{parameter} is (a|the class) \w+; it must be a \w+"):
        function(*given)
    assert not list(tmp_path.iterdir())


def test_swapped_arguments_say_what_is_wanted():
    with pytest.raises(fp.InputError, match=re.escape("curve is a Limits; it must be a Curve, as load_curve returns")):
        fp.plan_feedrate(LIMITS, CURVE)
    with pytest.raises(fp.InputError, match="limits is a FeedrateProfile; it must be a Limits, as load_limits returns"):
        fp.check(CURVE, made("profile"), LIMITS)


def test_one_number_for_every_axis_serves_at_every_door():
    per_axis = LIMITS.on(CURVE)
    profile = made("profile")
    assert profile.limits == per_axis
    assert profile.t.tobytes() == fp.plan_feedrate(CURVE, per_axis, intervals=40).t.tobytes()
    assert str(fp.check(CURVE, LIMITS, profile)) == str(fp.check(CURVE, per_axis, profile))
    assert fp.certify(CURVE, LIMITS, profile, intervals=100) == fp.certify(CURVE, per_axis, profile, intervals=100)
    assert fp.greedy(CURVE, LIMITS, 3).samples.u.tobytes() == fp.greedy(CURVE, per_axis, 3).samples.u.tobytes()

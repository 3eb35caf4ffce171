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


NO_PATHS = {
    "load_curve": fp.load_curve,
    "load_limits": fp.load_limits,
    "plan_and_check": fp.plan_and_check,
    "read_certificate": fp.read_certificate,
    "read_dxf": fp.read_dxf,
    "read_points": lambda path: fp.read_points(path, 0.01),
    "read_program": fp.read_program,
    "read_table": lambda path: fp.read_table(path, CURVE),
    "save_plot": lambda path: fp.save_plot(path, None),
    "table_limits": fp.table_limits,
    "write_certificate": lambda path: fp.write_certificate(path, None),
    "write_ngc": lambda path: fp.write_ngc(path, CURVE, made("profile"), tolerance=0.01),
    "write_report": lambda path: fp.write_report(path, verdict()),
    "write_samples": lambda path: write_samples(path, CURVE, made("samples"), made("report")),
    "write_table": lambda path: fp.write_table(path, made("profile"), LIMITS),
    "plan_program": lambda path: fp.plan_program("part.ngc", LIMITS, output=path),
}


@cache
def verdict():
    return fp.plan_and_check(CURVE, LIMITS, bound=False, intervals=40)


@pytest.mark.parametrize("wrong", [None, 0, 3.5, b"teardrop", ["teardrop"], LIMITS])
@pytest.mark.parametrize("name", NO_PATHS)
def test_what_is_no_path_is_named(name, wrong):
    """A number would be an open file of the process: 0 is standard input, and would be waited for."""
    with pytest.raises(fp.InputError, match=r"^(path|source|output) is an? \w+; it must be the path of a file$"):
        NO_PATHS[name](wrong)


@pytest.mark.parametrize("wrong", [None, "bound.npz", CURVE])
def test_what_is_no_certificate_is_named(wrong, tmp_path):
    file = tmp_path / "bound.npz"
    said = r"^certificate is a \w+; it must be a Certificate, as certify\(\.\.\.\)\.certificate"
    for call in (
        lambda: fp.verify_bound(CURVE, LIMITS, wrong),
        lambda: fp.verify_plan_bound(CURVE, LIMITS, wrong, made("profile")),
        lambda: fp.write_certificate(file, wrong),
    ):
        with pytest.raises(fp.InputError, match=said):
            call()
    assert not file.exists()
    certificate = fp.certify(CURVE, LIMITS, made("profile"), intervals=100).certificate
    with pytest.raises(fp.InputError, match="plan is a Limits"):
        fp.verify_plan_bound(CURVE, LIMITS, certificate, LIMITS)


@pytest.mark.parametrize("wrong", [0.3, [0.3], "yes", None, 1])
def test_a_switch_is_true_or_false(wrong):
    for name in ("exact_stop", "periodic"):
        with pytest.raises(fp.InputError, match=rf"^{name} = .* must be True or False$"):
            fp.plan_feedrate(CURVE, LIMITS, **{name: wrong})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: made("profile")("0.1"), "t = '0.1' must be a number or an array of numbers"),
        (lambda: made("profile")([0.1, "a"]), "t = .* must be a number"),
        (lambda: made("profile")(None), "t = None must be a number"),
        (lambda: fp.plan_feedrate(CURVE, LIMITS, budget="10"), "budget = '10' s must be > 0"),
        (lambda: fp.load_curve(PROGRAM, tolerance="x"), "tolerance = 'x' must be a number > 0"),
        (lambda: fp.write_table("never.csv", made("profile"), LIMITS, report=3), "report is an int"),
        (lambda: fp.write_report(verdict(), "never.html"), "verdict is a str; it must be a Verdict"),
        (lambda: fp.plot_plan(CURVE, LIMITS, made("profile"), LIMITS), "samples is a Limits"),
        (lambda: fp.plot_plan(CURVE, LIMITS, made("profile"), None, 3), "report is an int"),
        (lambda: fp.save_plot("never.png", 3), "figure is an int; it must be a Figure, as plot_plan returns"),
    ],
)
def test_what_is_wrong_is_named(call, message):
    with pytest.raises(fp.InputError, match=message):
        call()

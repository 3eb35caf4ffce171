"""The compiled loops of the literature against the same loops in plain Python, bit by bit."""

from __future__ import annotations

import re
from dataclasses import fields
from itertools import product

import classic_reference as classic
import greedy_reference as plain
import numpy as np
import pytest
from cases import PROJECT
from greedy_cases import CUSP, REPAIRED, limits
from motions import plan_along, scurve
from tables import random_feed, random_pieces, random_state, same_bits

from interp import greedy
from interp.literature import greedy_layout
from interp.literature.feedshapes import SHAPES, FeedShape
from interp.literature.forms import FORMS, replay_form
from interp.literature.greedy_run import GreedyRun
from planner import load_curve
from planner.compiled import core
from planner.errors import StalledError
from planner.geometry.curve import AXES
from planner.geometry.formula import FormulaCurve
from planner.machine.limits import Limits

SEEDS = range(12)


# ---- feed shapes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", SHAPES)
def test_the_feed_of_a_shape_has_the_bits_of_plain_python(kind):
    shape = FeedShape(kind, 40.0, 80.0, 0.3)
    edges = [0.0, shape.ramp, shape.fall, shape.duration, 0.5 * shape.ramp]
    t = np.concatenate([np.linspace(-0.01, shape.duration + 0.01, 400), edges, np.nextafter(edges, -1.0)])
    expected = np.empty(t.size), np.empty(t.size)
    classic.shape_feed(shape.array, t, *expected)
    assert all(map(same_bits, shape.at(t), expected))


@pytest.mark.parametrize(("seed", "order", "kind"), list(product(SEEDS, (1, 2), SHAPES)))
def test_a_shaped_run_has_the_bits_of_plain_python(seed, order, kind):
    rng = np.random.default_rng(seed)
    pieces, dim = random_pieces(rng, tip=seed % 3 == 0)
    end = float(pieces[-2, 0].sum() if pieces.shape[2] == 2 else pieces[-2, 0, :2].sum())
    shape, count = FeedShape(kind, 3.0, 80.0, 0.02).array, 40
    results = []
    for run in (
        lambda *out: core.feedshape_run(order, shape, pieces, dim, *pieces.shape[1:], 2e-3, end, count, *out),
        lambda *out: classic.shaped_run(order, shape, pieces, 2e-3, end, *out),
    ):
        out = np.zeros(count), np.empty(count), np.empty(count), np.empty((count, dim))
        run(*out)
        results.append(out)
    assert all(map(same_bits, *results))
    assert np.unique(results[0][0]).size > 3


# ---- forms ---------------------------------------------------------------------------------------------------------


class PlainForms:
    """``form_run`` in plain Python, as the core has it."""

    quintic_run, taylor_run = core.quintic_run, core.taylor_run

    def __init__(self):
        self.steps = 0

    def form_run(self, form, order, feed, course, pieces, duration, state, count, u, positions):
        assert u.size == count
        with np.errstate(all="ignore"):
            taken = classic.form_run(form, order, feed, course, pieces, duration, state, u, positions)
        self.steps += taken
        return taken


@pytest.mark.parametrize(
    "form", [form for form in FORMS if form not in ("quintic", "Taylor 1", "Taylor 2", "Taylor 3")]
)
@pytest.mark.parametrize("name", ["circle", "flank"])
def test_a_form_has_the_bits_of_plain_python(monkeypatch, name, form):
    curve = load_curve(name)
    motion = scurve(curve.length, 60.0, 400.0, 6000.0)
    profile = plan_along(curve, motion, times=np.linspace(0.0, motion.duration, 300))
    period = motion.duration / 70.3
    found = replay_form(curve, profile, form, period)
    replaced = PlainForms()
    monkeypatch.setattr("interp.literature.forms.core", replaced)
    expected = replay_form(curve, profile, form, period)
    assert same_bits(found.u, expected.u)
    assert same_bits(found.position, expected.position)
    assert replaced.steps >= 60


@pytest.mark.parametrize(("seed", "form"), list(product(SEEDS, (1, 2))))
def test_a_form_has_the_bits_of_plain_python_on_any_table(seed, form):
    rng = np.random.default_rng(seed)
    pieces, dim = random_pieces(rng, tip=seed % 3 == 0)
    state, feed = random_state(rng, pieces, dim, last=25), random_feed(rng)
    expected = np.empty(40), np.empty(40 * dim), state.copy()
    with np.errstate(all="ignore"):
        taken = classic.form_run(form, 3, feed, np.empty((0, 7)), pieces, 0.05, expected[2], *expected[:2])
    found = np.empty(40), np.empty(40 * dim), state.copy()
    arguments = feed, np.empty((0, 7)), pieces, 0.05
    assert core.form_run(form, 3, *arguments, found[2], 40, *found[:2]) == taken > 0
    assert same_bits(found[0][:taken], expected[0][:taken])
    assert same_bits(found[1][: taken * dim], expected[1][: taken * dim])
    assert same_bits(found[2], expected[2])


# ---- look-ahead ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "error"), list(product(SEEDS, (np.inf, 0.1))))
def test_look_ahead_has_the_bits_of_plain_python(seed, error):
    rng = np.random.default_rng(seed)
    pieces, dim = random_pieces(rng, tip=seed % 3 == 0)
    sizes, end = (dim, *pieces.shape[1:]), float(pieces[-2, 0, :2].sum())
    numbers = np.array([2000.0, 1e6, error, 3e-3])
    room = 300

    def points(run):
        u, feed, lengths = np.zeros(room), np.empty(room), np.empty(room)
        with np.errstate(all="ignore"):
            count = run(u, feed, lengths)
        size = max(count, 0) or room
        return count, u[:size], feed[:size], lengths[: size - 1]

    found = points(lambda *out: core.lookahead_points(numbers, pieces, *sizes, end, room, *out))
    expected = points(lambda *out: classic.adaptive_points(numbers, pieces, dim, end, *out))
    assert found[0] == expected[0] > 1
    assert all(map(same_bits, found[1:], expected[1:]))
    _, u, feed, lengths = found
    squares = feed**2
    squares[-1] = 0.0
    braked = squares.copy(), squares.copy()
    looked = core.lookahead_brake(2e5, lengths.size, lengths, braked[0])
    assert looked == classic.look_ahead(2e5, lengths, braked[1])
    assert same_bits(*braked)
    for rule, order in product((0, 1), (1, 2)):
        outs = [(np.empty(room), np.empty(room), np.empty((room, dim))) for _ in range(2)]
        course = u, braked[0], lengths, pieces
        count = core.lookahead_run(rule, order, u.size, *course, *sizes, 2e-3, 50.0, room, *outs[0])
        with np.errstate(all="ignore"):
            assert count == classic.adaptive_run(rule, order, *course, 2e-3, 50.0, *outs[1])
        size = count if count > 0 else room
        for one, other in zip(*outs, strict=True):
            assert same_bits(one[:size], other[:size])


# ---- Algorithms 1 to 4 ---------------------------------------------------------------------------------------------


class PlainGreedy:
    """The loops in plain Python, as the core has them."""

    def __init__(self):
        self.points = 0

    def greedy_compat_run(self, *arguments):
        own, error, rest = arguments[:6], arguments[6:12], arguments[12:]
        return self._run(plain.compat_run, own[:2] + own[4:5] + error[:2] + error[4:5], rest)

    def greedy_physical_run(self, *arguments):
        own, rest = arguments[:6], arguments[6:]
        return self._run(plain.physical_run, own[:2] + own[4:5], rest)

    def _run(self, loop, paths, rest):
        velocity, acceleration, settings, state, room, u, feed = rest
        assert u.size == feed.size == room
        with np.errstate(all="ignore"):
            code = loop(*paths, velocity, acceleration, settings, state, u, feed)
        self.points += int(state[greedy_layout.COUNT])
        return code

    def greedy_along(self, breaks, coefficients, pieces, powers, rational, dim, count, u, feed, *rest):
        assert (pieces, dim + 1, powers) == coefficients.shape
        assert count == u.size
        with np.errstate(all="ignore"):
            plain.along(breaks, coefficients, rational, u, np.empty(0) if feed is None else feed, *rest)

    def greedy_chord_errors(self, breaks, coefficients, pieces, powers, rational, dim, count, u, out):
        assert (pieces, dim + 1, powers) == coefficients.shape
        assert count == u.size
        plain.chord_errors(breaks, coefficients, rational, u, out)


HELIX = FormulaCurve({"X": "5*cos(4*u)", "Y": "5*sin(4*u)", "Z": "2*u + 0.3*sin(9*u)"}, (0.0, 1.0), name="helix")
RUNS = {
    "compat, as published": ("teardrop", {}),
    "compat, in pieces, rational": ("butterfly-nurbs", {"step_feed": "planned", "error_curve": "own"}),
    "compat, the wrong bend": ("butterfly", {"step_feed": "planned"}),
    "compat, repaired": ("butterfly", REPAIRED),
    "compat, a circle": ("circle", {"error_curve": "own"}),
    "physical": ("teardrop", {"mode": "physical"}),
    "physical, in pieces, rational": ("butterfly-nurbs", {"mode": "physical"}),
    "physical, soft": ("butterfly-nurbs", {"mode": "physical", "braking": "soft"}),
    "physical, three axes": ("helix", {"mode": "physical"}),
}


def coarse(curve, seconds, *, within=3e-3):
    """Limits for which a run takes about fifty steps a second."""
    feed, period = curve.length / seconds, 2e-2
    return Limits(
        feed, [feed] * curve.dim, [8.0 * feed] * curve.dim, [1e3 * feed] * curve.dim, within * feed * period, period
    )


def numbers(run):
    """All arrays of a run, by name."""
    found = {field.name: getattr(run, field.name) for field in fields(GreedyRun)}
    arrays = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    return arrays | {"u": run.samples.u, "position": run.samples.position}


def outcome(curve, allowed, algorithm, options):
    """The arrays of a run, or what it says where it stops."""
    try:
        return numbers(greedy(curve, allowed, algorithm, max_steps=400, **options))
    except StalledError as error:
        return str(error)


@pytest.mark.parametrize("algorithm", [1, 2, 3, 4])
@pytest.mark.parametrize("variant", ["theta", "root"])
@pytest.mark.parametrize("case", RUNS)
def test_a_greedy_run_has_the_bits_of_plain_python(monkeypatch, case, variant, algorithm):
    name, options = RUNS[case]
    curve = HELIX if name == "helix" else load_curve(name)
    options = options | {"variant": variant}
    # each step of the published push-up takes thousands of trials
    allowed = coarse(curve, 0.6 if (variant, algorithm) == ("theta", 4) else 2.0)
    found = outcome(curve, allowed, algorithm, options)
    replaced = PlainGreedy()
    for module in ("greedy", "greedy_run"):
        monkeypatch.setattr(f"interp.literature.{module}.core", replaced)
    expected = outcome(curve, allowed, algorithm, options)
    assert replaced.points > 10
    assert isinstance(found, dict) == isinstance(expected, dict)
    if isinstance(found, str):
        assert found == expected
    else:
        assert [name for name in expected if not same_bits(found[name], expected[name])] == []


@pytest.mark.parametrize(("seed", "degree"), list(product(SEEDS, (1, 2, 5))))
def test_chord_errors_have_the_bits_of_plain_python(seed, degree):
    # on straight lines too, where the error is nothing but rounding
    rng = np.random.default_rng(seed)
    pieces, dim = int(rng.integers(1, 5)), int(rng.integers(2, 5))
    breaks = np.linspace(0.0, 1.0, pieces + 1)
    coefficients = rng.normal(0.0, 10.0, (pieces, dim + 1, degree + 1))
    coefficients[:, dim] = 0.05 * rng.uniform(-1.0, 1.0, (pieces, degree + 1))
    coefficients[:, dim, 0] = 1.0
    u = np.sort(rng.uniform(-0.01, 1.05, 50))
    u[20] = u[19]
    for rational in (False, True):
        found, expected = np.empty(49), np.empty(49)
        core.greedy_chord_errors(breaks, coefficients, pieces, degree + 1, rational, dim, u.size, u, found)
        with np.errstate(all="ignore"):
            plain.chord_errors(breaks, coefficients, rational, u, expected)
        assert same_bits(found, expected)
        assert found[19] == 0.0
        assert np.count_nonzero(found) > 20


@pytest.mark.parametrize("mode", ["compat", "physical"])
@pytest.mark.parametrize("algorithm", [1, 3])
def test_a_stall_is_that_of_plain_python(monkeypatch, mode, algorithm):
    found = outcome(CUSP, limits(), algorithm, {"mode": mode})
    replaced = PlainGreedy()
    monkeypatch.setattr("interp.literature.greedy.core", replaced)
    monkeypatch.setattr("interp.literature.greedy_run.core", replaced)
    assert found == outcome(CUSP, limits(), algorithm, {"mode": mode})
    assert isinstance(found, str)


def test_what_is_shared_is_the_same_in_both_languages():
    text = (PROJECT / "interp" / "literature" / "greedy_inline.h").read_text(encoding="utf-8")
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    enums = [re.findall(r"\b[A-Z_]{1,}\b", inside) for inside in re.findall(r"enum \{(.*?)\}", text, re.DOTALL)]
    assert [len(names) for names in enums] == [
        7,
        greedy_layout.SETTINGS,
        greedy_layout.STATE,
        greedy_layout.COLUMNS + 1,
        1,
    ]
    for names in enums[:4]:
        assert [getattr(greedy_layout, name) for name in names] == list(range(len(names)))
    assert f"enum {{ MOST_AXES = {len(AXES)} }}" in text

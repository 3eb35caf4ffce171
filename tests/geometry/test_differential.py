"""Derivatives turned into others, against numbers of fifty digits; and that these find an error in any term.

The planner and its check both take these formulas, so that neither can find an error in them: this file does.
"""

import re
from functools import cache
from pathlib import Path
from types import ModuleType

import mpmath
import numpy as np

from planner.compiled import core
from planner.geometry import differential

SOURCE = Path(differential.__file__).read_text(encoding="utf-8")
AT = (0.37, -0.8, 1.45)  # times
DIGITS = 1e-13  # of the largest term


def curve(u):
    """A curve in space that bends, twists and changes its speed."""
    return [mpmath.exp(0.4 * u) + u, mpmath.sin(1.3 * u), 0.2 * u**3 - mpmath.cos(u)]


def other(u):
    """Another, so that the length of one is not that of the other."""
    return [mpmath.cos(0.7 * u) * u, mpmath.exp(-0.3 * u), u**2 / (2 + u)]


def law(t):
    return 0.9 * t + 0.3 * mpmath.sin(2 * t) + 0.05 * t**3


def derivatives(f, at, count=4):
    """Derivatives 0.. of a function with a list of values (or one value): (count, dim)."""
    with mpmath.workdps(50):
        many = isinstance(f(mpmath.mpf(at)), list)
        dim = len(f(mpmath.mpf(at))) if many else 1
        parts = [mpmath.taylor((lambda x, j=j: f(x)[j]) if many else f, at, count - 1) for j in range(dim)]
        found = [[float(part[k] * mpmath.factorial(k)) for part in parts] for k in range(count)]
    return np.array(found)


def speed_of(f):
    def speed(u):
        return mpmath.sqrt(sum(mpmath.diff(lambda x, j=j: f(x)[j], u) ** 2 for j in range(3)))

    return speed


def by_length(f, u, length_of):
    """First three derivatives of f with respect to the arc length of a curve: d/ds = (d/du) / |C'|, three times."""
    with mpmath.workdps(60):
        speed = speed_of(length_of)
        s = [mpmath.taylor(speed, u, 3)[k] / (k + 1) for k in range(3)]  # s - s0 = sum s_k (u - u0)^(k + 1)
        inverse = [1 / s[0], -s[1] / s[0] ** 3, (2 * s[1] ** 2 - s[0] * s[2]) / s[0] ** 5]  # reversion of the series
        rows = []
        for j in range(3):
            _, a, b, c = mpmath.taylor(lambda x, j=j: f(x)[j], u, 3)
            x, y, z = inverse
            rows.append([a * x, 2 * (a * y + b * x**2), 6 * (a * z + 2 * b * x * y + c * x**3)])
        return np.array([[float(row[k]) for row in rows] for k in range(3)])


def off(found, exact):
    """Difference against the size of the numbers, largest over the rows."""
    return max(np.abs(np.asarray(a) - np.asarray(b)).max() / np.abs(b).max() for a, b in zip(found, exact, strict=True))


@cache
def exact(t):
    """Everything that the formulas start from and lead to, of two curves at a time t."""
    u, *rates = derivatives(law, t)[:, 0]
    speeds = derivatives(speed_of(curve), u, 3)[:, 0]
    passed = derivatives(lambda x: other(law(x)), t)[1:]
    along = derivatives(lambda x: speed_of(curve)(law(x)) * mpmath.diff(law, x), t, 3)[:, 0]
    lengths = by_length(other, u, curve), by_length(curve, u, curve)
    inverse = by_length(lambda x: [x, x, x], u, curve)[:, 0]
    return rates, derivatives(curve, u), derivatives(other, u), speeds, passed, along, lengths, inverse


def errors(rules: ModuleType) -> dict[str, float]:
    """By how much each formula of a module like ``differential`` is off, worst of several places."""
    worst: dict[str, float] = {}
    for t in AT:
        rates, d, q, speeds, passed, along, lengths, inverse = exact(t)
        x = rates[0] ** 2, rates[1], rates[2] / rates[0]
        kappa = np.linalg.norm(np.cross(d[1], d[2])) / np.linalg.norm(d[1]) ** 3
        triple = tuple(np.array(value) for value in speeds)
        found = {
            "chain_rule": off(rules.chain_rule(q[1], q[2], q[3], *rates), passed),
            "acceleration_terms": off([np.einsum("kj,k->j", rules.acceleration_terms(q[1], q[2]), x[:2])], [passed[1]]),
            "jerk_terms": off([np.einsum("kj,k->j", rules.jerk_terms(q[1], q[2], q[3]), x) * rates[0]], [passed[2]]),
            "speed_derivatives": off(rules.speed_derivatives(d), speeds),
            "rates_along": off(rules.rates_along(d, *rates), along),
            "rates_of_parameter": off(rules.rates_of_parameter(triple, *along), rates),
            "inverse_derivatives": off(rules.inverse_derivatives(triple), inverse),
            "along_length": off(rules.along_length(q, triple), lengths[0]),
            "arc_derivatives": off(rules.arc_derivatives(d)[1:], lengths[1]),
            "curvature_vector": off([rules.curvature_vector(q, d)], [lengths[0][1]]),
            "curvature": off([rules.curvature(d)], [kappa]),
        }
        worst = {name: max(value, worst.get(name, 0.0)) for name, value in found.items()}
    return worst


def changed(source: str, at: int, old: str, new: str) -> ModuleType:
    module = ModuleType("changed")
    exec(compile(source[:at] + new + source[at + len(old) :], "changed", "exec"), module.__dict__)
    return module


def formulas(source: str) -> list[int]:
    """Where the code of the functions stands: outside docstrings and comments."""
    text = re.sub(r'"""[\s\S]*?"""|#.*', lambda match: " " * len(match[0]), source)
    start = text.index("def chain_rule")
    return [at for at in range(start, len(text)) if text[at] != " "]


def mutations(source: str) -> list[tuple[int, str, str]]:
    """Every factor, sign and power of the formulas, changed one at a time."""
    swaps = {" + ": " - ", " - ": " + ", "3.0": "2.0", "**2": "**3", "**3": "**2", "**5": "**4"}
    inside = set(formulas(source))
    found = [(m.start(), m[0], swaps[m[0]]) for m in re.finditer(r" [+-] |3\.0|\*\*[235]", source)]
    return [item for item in found if item[0] + 1 in inside]


class TestOracle:
    def test_every_formula_agrees_with_fifty_digits(self):
        worst = errors(differential)
        assert {name for name in dir(differential) if callable(getattr(differential, name)) and name[0].islower()} == {
            *worst, "dot", "norm",
        }  # fmt: skip
        assert max(worst.values()) < DIGITS, worst

    def test_it_finds_an_error_planted_in_any_term(self):
        places = mutations(SOURCE)
        missed = [
            SOURCE[at - 40 : at + 20]
            for at, a, b in places
            if not max(errors(changed(SOURCE, at, a, b)).values()) > 1e-6
        ]
        assert len(places) >= 30
        assert not missed

    def test_a_circle_and_a_helix_have_the_curvature_of_the_books(self):
        u = np.linspace(-3.0, 3.0, 13)
        radius, pitch = 2.5, 0.7
        zero = np.zeros_like(u)
        d = np.stack(
            [
                np.stack([radius * np.cos(u + k * np.pi / 2), radius * np.sin(u + k * np.pi / 2), line], axis=1)
                for k, line in enumerate((pitch * u, pitch + zero, zero, zero))
            ]
        )
        expected = radius / (radius**2 + pitch**2)
        np.testing.assert_allclose(differential.curvature(d), expected, rtol=1e-14)
        arc = differential.arc_derivatives(d)
        np.testing.assert_allclose(differential.norm(arc[1]), 1.0, rtol=1e-14)
        np.testing.assert_allclose(differential.norm(arc[2]), expected, rtol=1e-14)
        np.testing.assert_allclose(differential.norm(arc[3]), expected / np.sqrt(radius**2 + pitch**2), rtol=1e-13)

    def test_a_curve_at_rest_has_no_speed_and_no_curvature(self):
        d = np.zeros((4, 2, 3))
        d[2:] = 1.0
        assert all((part == 0.0).all() for part in differential.speed_derivatives(d))
        assert (differential.curvature(d) == 0.0).all()


class TestCompiled:
    def test_they_agree_with_the_arrays_on_random_numbers(self):
        rng = np.random.default_rng(5)
        q, u = rng.normal(size=(3, 200)), rng.normal(size=(3, 200))
        speeds = np.stack([np.abs(q[0]) + 0.1, q[1], q[2]])
        products = np.stack([speeds[0] ** 2, speeds[0] * q[1], speeds[0] * q[2] + q[1] ** 2])
        size = np.abs(q).max() * np.abs(u).max() ** 3
        for compute, arguments, expected in (
            (core.differential_chain_rule, (q, u), differential.chain_rule(*q, *u)),
            (core.differential_rates_along, (q, u), differential.chain_rule(*q, *u)),
            (core.differential_rates_of_parameter, (speeds, u), differential.rates_of_parameter(tuple(speeds), *u)),
            (core.differential_speed_derivatives, (products,), speeds),
        ):
            compute(200, *arguments, found := np.empty((3, 200)))
            for n in range(200):
                one = [part[n] for part in expected]
                np.testing.assert_allclose(found[:, n], one, rtol=1e-12, atol=1e-14 * size)

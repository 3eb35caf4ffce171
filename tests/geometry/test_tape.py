"""Tapes against fifty digits: every operation on values that bend, the sines, and what the recorder leaves out."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from planner.geometry.tape import Operation, Recorder

BLOCK = 32  # points that the compiled code works on at once


def inner(u):
    """A value that bends, so that every term of the chain rules counts: between 0.2 and 0.9 on [0, 1]."""
    return mpmath.mpf(0.2) + mpmath.mpf(0.5) * u + mpmath.mpf(0.15) * u**2 + mpmath.mpf(0.05) * u**3


def other(u):
    return mpmath.mpf(1.3) - mpmath.mpf(0.4) * u + mpmath.mpf(0.25) * u**3


FUNCTIONS = {
    Operation.SQRT: mpmath.sqrt, Operation.EXP: mpmath.exp, Operation.LOG: mpmath.log, Operation.SIN: mpmath.sin,
    Operation.COS: mpmath.cos, Operation.TAN: mpmath.tan, Operation.ASIN: mpmath.asin, Operation.ACOS: mpmath.acos,
    Operation.ATAN: mpmath.atan, Operation.SINH: mpmath.sinh, Operation.COSH: mpmath.cosh, Operation.TANH: mpmath.tanh,
}  # fmt: skip
BINARY = {
    "a + b": (lambda a, b: a + b, lambda a, b: a + b),
    "a - b": (lambda a, b: a - b, lambda a, b: a - b),
    "a * b": (lambda a, b: a * b, lambda a, b: a * b),
    "a / b": (lambda a, b: a / b, lambda a, b: a / b),
    "b ** a": (lambda a, b: b**a, lambda a, b: b**a),
    "2.5 ** a": (lambda a, b: b.recorder.expression(2.5) ** a, lambda a, b: mpmath.mpf(2.5) ** a),
    "a ** 2.5": (lambda a, b: a**2.5, lambda a, b: a ** mpmath.mpf(2.5)),
    "a ** 5": (lambda a, b: a**5.0, lambda a, b: a**5),
    "a ** 11": (lambda a, b: a**11.0, lambda a, b: a**11),
    "a ** -3": (lambda a, b: a**-3.0, lambda a, b: a**-3),
    "3 a": (lambda a, b: 3.0 * a, lambda a, b: 3 * a),
    "a / 3": (lambda a, b: a / 3.0, lambda a, b: a / 3),
    "3 / a": (lambda a, b: b.recorder.expression(3.0) / a, lambda a, b: 3 / a),
    "a - 3": (lambda a, b: a - 3.0, lambda a, b: a - 3),
    "3 - a": (lambda a, b: b.recorder.expression(3.0) - a, lambda a, b: 3 - a),
    "-a": (lambda a, b: -a, lambda a, b: -a),
    "sqrt(a a)": (lambda a, b: a.recorder.function(Operation.SQRT, a * a), lambda a, b: a),
    "sqrt of (-a)^2": (lambda a, b: a.recorder.function(Operation.SQRT, (-a) * (-a)), lambda a, b: a),
    "atan2(a, b)": (lambda a, b: a.recorder.function(Operation.ATAN2, a, b), mpmath.atan2),
    "atan2(a, -b)": (lambda a, b: a.recorder.function(Operation.ATAN2, a, -b), lambda a, b: mpmath.atan2(a, -b)),
}


def exact(function, u):
    """Value and three derivatives, by mpmath in 50 digits."""
    with mpmath.workdps(50):
        return [float(mpmath.diff(function, mpmath.mpf(float(u)), k)) for k in range(4)]


def jets(u):
    """Values and derivatives of both inner functions at u (n,), (4, n, 2)."""
    return np.array([[exact(inner, x), exact(other, x)] for x in u]).transpose(2, 0, 1)


def compared(record, function):
    recorder = Recorder(2)
    tape = recorder.tape([record(recorder.input(0), recorder.input(1))])
    u = np.array([0.0, 0.37, 0.8, 1.0])
    found = tape(jets(u), 3)[:, :, 0]
    expected = np.array([exact(lambda x: function(inner(x), other(x)), at) for at in u]).T
    assert np.abs(found - expected).max() <= 1e-14 * max(1.0, np.abs(expected).max())
    assert (tape(jets(u)[:1], 0)[0, :, 0] == found[0]).all()


@pytest.mark.parametrize("operation", FUNCTIONS, ids=lambda operation: operation.name)
def test_every_function_of_a_value_that_bends(operation):
    compared(lambda a, _: a.recorder.function(operation, a), lambda a, _: FUNCTIONS[operation](a))


@pytest.mark.parametrize("name", BINARY)
def test_every_operator_on_values_that_bend(name):
    compared(*BINARY[name])


def test_no_operation_is_left_out():
    tested = set(FUNCTIONS)
    for record, _ in BINARY.values():
        recorder = Recorder(2)
        tape = recorder.tape([record(recorder.input(0), recorder.input(1))])
        tested |= {Operation(code) for code in tape.steps[:, 0].tolist()}
    assert tested == set(Operation)


def sines(x):
    recorder = Recorder(1)
    u = recorder.input(0)
    tape = recorder.tape([recorder.function(Operation.SIN, u), recorder.function(Operation.COS, u)])
    return tape(np.stack([x, *np.zeros((3, x.size))])[:, :, None], 0)[0].T


@pytest.mark.parametrize("reach", [1e-9, 0.8, 10.0, 3e3, 4e5])
def test_sines_are_right_to_a_digit(reach):
    rng = np.random.default_rng(1)
    near = np.round(rng.uniform(-reach, reach, 100) / (0.5 * np.pi)) * 0.5 * np.pi  # as close to a zero as doubles come
    x = np.concatenate([rng.uniform(-reach, reach, 400), near, np.nextafter(near, np.inf), [0.0, reach, -reach]])
    x = np.clip(x, -reach, reach)
    for found, function in zip(sines(x), (mpmath.sin, mpmath.cos), strict=True):
        with mpmath.workdps(40):
            expected = [function(mpmath.mpf(float(at))) for at in x]
            apart = np.array(
                [float(abs(mpmath.mpf(float(one)) - two)) for one, two in zip(found, expected, strict=True)]
            )
        size = np.array([float(value) for value in expected])
        assert (apart <= 0.8 * np.spacing(np.abs(size))).all()


def test_sine_and_cosine_of_changing_operands_are_their_own():
    """Both of one operand are made at once and kept until another comes, also where it has the slot of the first."""
    recorder = Recorder(1)
    u, angles, results = recorder.input(0), [], []
    for k in range(1, 9):
        angle = (0.7 * k) * u + 0.1 * k
        results += [recorder.function(Operation.SIN, angle), recorder.function(Operation.COS, angle)]
        angles += [(0.7 * k, 0.1 * k)] * 2
    total = sum(results[1:], results[0])  # so that slots are given away and taken again
    results += [recorder.function(Operation.COS, total), recorder.function(Operation.COS, results[0])]
    x = np.linspace(-3.0, 3.0, 2 * BLOCK + 5)
    values = recorder.tape(results)(x[None, :, None], 3)
    expected = [
        [factor**order * (np.sin, np.cos)[k % 2](factor * x + shift + order * np.pi / 2.0) for order in range(4)]
        for k, (factor, shift) in enumerate(angles)
    ]
    assert values[:, :, :-2] == pytest.approx(np.moveaxis(np.array(expected), 0, -1), rel=1e-12, abs=1e-12)
    assert values[0, :, -2] == pytest.approx(np.cos(np.sum(expected, axis=0)[0]), rel=1e-12, abs=1e-12)
    assert values[0, :, -1] == pytest.approx(np.cos(np.sin(0.7 * x + 0.1)), rel=1e-12, abs=1e-12)


def test_sines_of_large_numbers_are_those_of_the_library_and_of_no_number_none():
    x = np.array([1e6, -3.7e12, 1e300, 0.5])
    assert (sines(x) == [np.sin(x), np.cos(x)]).all()
    assert np.isnan(sines(np.array([np.inf, np.nan, -np.inf, 1.0]))[:, :3]).all()


def angles(y, x):
    recorder = Recorder(2)
    tape = recorder.tape([recorder.function(Operation.ATAN2, recorder.input(0), recorder.input(1))])
    values = np.zeros((4, x.size, 2))
    values[0] = np.stack([y, x], axis=1)
    return tape(values, 0)[0, :, 0]


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_angles_are_right_to_two_digits(scale):
    """All round, and where the place beside which they are taken changes, on either side of it."""
    rng = np.random.default_rng(2)
    tangents = np.array([0.4375, 0.6875, 1.1875, 2.4375, 0.5, 1.0, 1.5])
    angle = np.concatenate([rng.uniform(-np.pi, np.pi, 600), np.arctan(tangents), [1e-17, -1e-9, 3.1415]])
    x, y = scale * np.cos(angle), scale * np.sin(angle)
    x = np.concatenate([x, np.full(21, scale), -np.full(21, scale)])
    beside = scale * np.concatenate([tangents, np.nextafter(tangents, 0.0), np.nextafter(tangents, 9.0)])
    y = np.concatenate([y, beside, -beside])
    found = angles(y, x)
    with mpmath.workdps(40):
        exact = [mpmath.atan2(mpmath.mpf(float(a)), mpmath.mpf(float(b))) for a, b in zip(y, x, strict=True)]
        apart = np.array([float(abs(mpmath.mpf(float(one)) - two)) for one, two in zip(found, exact, strict=True)])
    assert (apart <= 1.5 * np.spacing(np.abs(found))).all()


def test_angles_of_zeros_and_of_what_is_no_number_are_those_of_the_library():
    x = np.array([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1.0, 0.0, 1e-300, 1e300, -2.0])
    y = np.array([0.0, 0.0, -0.0, -0.0, 1.0, np.inf, 1.0, np.nan, -3.0, 1e-301, 1e300, np.inf])
    assert np.array_equal(angles(y, x), np.arctan2(y, x), equal_nan=True)
    # Each alone, for one of them sends its whole block to the library.
    each = np.concatenate([angles(y[[k]], x[[k]]) for k in range(x.size)])
    assert np.array_equal(each, np.arctan2(y, x), equal_nan=True)


@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 7])
def test_points_do_not_depend_on_the_points_beside_them(count):
    recorder = Recorder(2)
    a, b = recorder.input(0), recorder.input(1)
    c = recorder.function(Operation.SIN, a * b) / (a + b) + 2.0 * recorder.function(Operation.EXP, b)
    tape = recorder.tape([c, c * a, b])
    values = np.random.default_rng(count).uniform(0.5, 2.0, (4, count, 2))
    together = tape(values, 3)
    for k in range(count):
        assert (tape(values[:, [k]], 3)[:, 0] == together[:, k]).all()
    for order in range(3):
        assert (tape(values, order) == together[: order + 1]).all()


def test_equal_operations_are_done_once_and_constants_folded():
    recorder = Recorder(1)
    u = recorder.input(0)
    half = recorder.expression(1.0) / 2.0
    assert half.constant == 0.5
    assert recorder.function(Operation.SQRT, recorder.expression(9.0)).constant == 3.0
    assert (0.0 * u).constant == 0.0
    assert (u**0.0).constant == 1.0
    assert (u + 0.0).node == (u * 1.0).node == (u**1.0).node == u.node
    sine = recorder.function(Operation.SIN, u * half)
    again = recorder.function(Operation.SIN, 0.5 * u)
    assert sine.node == again.node
    assert recorder.tape([sine + again, sine]).steps.shape[0] == 3  # scale, sine, sum
    assert np.isnan((recorder.expression(0.0) / 0.0).constant)


def test_results_may_be_inputs_and_constants():
    recorder = Recorder(2)
    tape = recorder.tape([recorder.input(1), recorder.expression(7.0), recorder.input(1)])
    values = np.arange(8.0).reshape(4, 1, 2)
    assert tape(values, 3)[:, 0].tolist() == [[1.0, 7.0, 1.0], [3.0, 0.0, 3.0], [5.0, 0.0, 5.0], [7.0, 0.0, 7.0]]


def test_a_long_sum_takes_few_slots():
    recorder = Recorder(1)
    total = u = recorder.input(0)
    for k in range(500):
        total = total + recorder.function(Operation.SIN, u * (k + 2.0))
    tape = recorder.tape([total])
    assert tape.slots - tape.constants.size <= 6
    assert tape(np.array([[[0.3]], [[1.0]], [[0.0]], [[0.0]]]), 0)[0, 0, 0] == pytest.approx(
        0.3 + sum(np.sin(0.3 * (k + 2.0)) for k in range(500)), rel=1e-14
    )

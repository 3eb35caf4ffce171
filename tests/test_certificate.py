"""The verifier of lower bounds: closed forms, the identity behind its proof, and what it must refuse."""

import dataclasses
import itertools

import numpy as np
import pytest
from certificates import (
    arc_section,
    coefficients,
    line_certificate,
    line_section,
    pieces_of,
    smooth_certificate,
)
from scipy.optimize import linprog

from planner import InputError, check, load_curve, load_limits, plan_feedrate
from planner.certificate import Certificate, CertificateSection
from planner.check.atoms import _least, end_term, seam, sides
from planner.check.certificate import _Section, verify_bound, verify_plan_bound
from planner.check.pathspeeds import Bounds, path_points
from planner.check.quadrature import smallest
from planner.geometry.curve import FeedCaps
from planner.geometry.nurbs import NurbsCurve
from planner.limits import Limits

L, V, A, J = 100.0, 120.0, 1000.0, 2e4
INF = [np.inf, np.inf]


def line(length=L, axes=("X", "Y"), caps=None):
    """A straight line along the first axis."""
    curve = NurbsCurve([[0.0, 0.0], [length, 0.0]], [0.0, 0.0, length, length], 1, axes=axes, name="line")
    return curve if caps is None else CappedLine(length, caps)


class CappedLine(NurbsCurve):
    """A line with a feed cap of its own on each part."""

    def __init__(self, length, caps):
        super().__init__([[0.0, 0.0], [length, 0.0]], [0.0, 0.0, length, length], 1)
        object.__setattr__(self, "feed_caps", caps)

    def _candidate_breaks(self):
        return self.feed_caps.edges[1:-1]


def tangential(velocity=V, acceleration=A, jerk=J):
    return Limits(velocity, INF, INF, INF, tangential_acceleration=acceleration, tangential_jerk=jerk)


class TestStraightLine:
    """Rest to rest in seven phases: the multipliers of the optimum prove its time exactly."""

    @pytest.mark.parametrize("length", [100.0, 30.0])
    @pytest.mark.parametrize("jerk", [2e4, 4e5])
    def test_axis_limits(self, length, jerk):
        curve = line(length)
        certificate = line_certificate(curve, length, V, A, jerk)
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [jerk, np.inf])
        report = verify_bound(curve, limits, certificate)
        assert report.proved == pytest.approx(certificate.bound, rel=1e-12)
        assert report.ok
        assert report.allowance < 1e-12
        assert report.stops == ()

    def test_the_feed_in_place_of_the_velocity(self):
        certificate = line_certificate(line(), L, V, A, J)
        report = verify_bound(line(), Limits(V, INF, [A, np.inf], [J, np.inf]), certificate)
        assert report.proved == pytest.approx(certificate.bound, rel=1e-12)

    def test_tangential_limits(self):
        certificate = dataclasses.replace(
            line_certificate(line(), L, V, A, J),
            jerk_names=("tangential jerk",),
            acceleration_names=("tangential acceleration",),
        )
        report = verify_bound(line(), tangential(), certificate)
        assert report.proved == pytest.approx(certificate.bound, rel=1e-12)

    def test_a_rotary_axis(self):
        curve = line(axes=("A", "X"))
        certificate = dataclasses.replace(
            line_certificate(curve, L, V, A, J), jerk_names=("jerk A",), acceleration_names=("acceleration A",)
        )
        report = verify_bound(curve, Limits(1.0, [V, np.inf], [A, np.inf], [J, np.inf], axes=("A", "X")), certificate)
        assert report.proved == pytest.approx(certificate.bound, rel=1e-12)

    def test_a_corner_adds_up(self):
        curve = NurbsCurve([[0.0, 0.0], [L, 0.0], [L, L]], [0.0, 0.0, L, 2 * L, 2 * L], 1)
        (section,), total = line_certificate(line(), L, V, A, J).sections, line_section(L, V, A, J)[1]
        second = dataclasses.replace(section, u=section.u + np.array([[L], [0.0], [0.0]]))
        rows = [np.stack([s.jerk[0] * (k == 0), s.jerk[0] * (k == 1)]) for k, s in enumerate((section, second))]
        m_rows = [np.stack([s.acceleration[0] * (k == i) for i in range(2)]) for k, s in enumerate((section, second))]
        sections = tuple(
            dataclasses.replace(s, jerk=r, acceleration=m)
            for s, r, m in zip((section, second), rows, m_rows, strict=True)
        )
        names = ("jerk X", "jerk Y"), ("acceleration X", "acceleration Y")
        certificate = Certificate(sections, *names, 2 * total, curve.fingerprint, periodic=False)
        report = verify_bound(curve, Limits(1e6, [V, V], [A, A], [J, J]), certificate)
        assert report.proved == pytest.approx(2 * total, rel=1e-12)
        assert report.stops == ()

    def test_a_program_feed_counts_on_its_stretch(self):
        section, total = line_section(L, V, A, J)
        t3 = V / A + A / J
        edges = np.array([0.0, 0.5 * V * t3, L - 0.5 * V * t3, L])
        curve = line(caps=FeedCaps(edges, np.array([np.inf, V, np.inf])))
        certificate = Certificate((section,), ("jerk X",), ("acceleration X",), total, curve.fingerprint, False)
        limits = Limits(1e6, INF, [A, np.inf], [J, np.inf])
        assert verify_bound(curve, limits, certificate).proved == pytest.approx(total, rel=1e-12)
        # no cap, no bound: what held x back was the cap alone
        uncapped = line(caps=FeedCaps(edges, np.array([np.inf, 2.0 * V, np.inf])))
        assert verify_bound(uncapped, limits, certificate).proved < 0.95 * total

    @pytest.mark.parametrize("factor", [0.2, 3.0, 1e3])
    def test_the_unit_of_sigma_does_not_matter(self, factor):
        section, total = line_section(L, V, A, J)
        other = dataclasses.replace(
            section,
            sigma=section.sigma * factor,
            u=section.u / factor ** np.arange(3.0)[:, None],
            acceleration=section.acceleration / factor,
        )
        certificate = Certificate((other,), ("jerk X",), ("acceleration X",), total, line().fingerprint, False)
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])
        assert verify_bound(line(), limits, certificate).proved == pytest.approx(total, rel=1e-12)

    def test_too_large_multipliers_are_scaled_down_together(self):
        certificate = line_certificate(line(), L, V, A, J)
        (section,) = certificate.sections
        doubled = dataclasses.replace(section, jerk=2.0 * section.jerk, acceleration=2.0 * section.acceleration)
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])
        report = verify_bound(line(), limits, dataclasses.replace(certificate, sections=(doubled,)))
        assert report.scale == pytest.approx(0.5, rel=1e-12)
        assert report.proved == pytest.approx(certificate.bound, rel=1e-12)

    @pytest.mark.parametrize("row", ["jerk", "acceleration"])
    def test_another_multiplier_proves_less(self, row):
        certificate = line_certificate(line(), L, V, A, J)
        (section,) = certificate.sections
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])
        rng = np.random.default_rng(3)
        count = 0
        for _ in range(30):
            values = getattr(section, row).copy()
            k = rng.integers(values.size)
            values[0, k] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3.0, 0.0)
            changed = dataclasses.replace(certificate, sections=(dataclasses.replace(section, **{row: values}),))
            report = verify_bound(line(), limits, changed)
            assert report.proved <= certificate.bound * (1.0 + 1e-12)
            count += not report.ok
        assert count >= 25  # some changes are next to nothing

    def test_a_changed_claim_is_refused(self):
        certificate = line_certificate(line(), L, V, A, J)
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])
        report = verify_bound(line(), limits, dataclasses.replace(certificate, bound=certificate.bound * 1.00001))
        assert not report.ok
        assert report.refusal == "the certificate proves 1.00333333 s, not the 1.00334337 s that it claims"
        assert verify_bound(line(), limits, dataclasses.replace(certificate, bound=0.9 * certificate.bound)).ok


class TestEndsWithFeeds:
    """Motions with a constant acceleration or jerk between prescribed feeds."""

    def limits(self):
        return Limits(1e6, INF, [A, np.inf], [J, np.inf])

    def test_constant_acceleration_between_two_feeds(self):
        start, end = 40.0, 90.0
        total = (end - start) / A
        length = 0.5 * (start + end) * total
        u = np.array([[0.0, length], [start, end], [A, A]])
        section = CertificateSection(np.array([0.0, total]), u, np.zeros((0, 3)), np.ones((1, 2)), start, end, np.nan)
        curve = line(length)
        certificate = Certificate((section,), (), ("acceleration X",), total, curve.fingerprint, False)
        assert verify_bound(curve, self.limits(), certificate).proved == pytest.approx(total, rel=1e-12)
        # backwards in time: brake, with the opposite force
        u = np.array([[0.0, length], [end, start], [-A, -A]])
        section = dataclasses.replace(section, u=u, acceleration=-np.ones((1, 2)), start_feed=end, end_feed=start)
        certificate = dataclasses.replace(certificate, sections=(section,))
        assert verify_bound(curve, self.limits(), certificate).proved == pytest.approx(total, rel=1e-12)

    def test_constant_jerk_from_a_feed_and_an_acceleration(self):
        curve, section, total = arc_section(line, 40.0, 300.0, J, 0.03)
        certificate = Certificate((section,), ("jerk X",), (), total, curve.fingerprint, False)
        report = verify_bound(curve, self.limits(), certificate)
        assert report.proved == pytest.approx(total, rel=1e-12)
        assert "beginning with 300 mm/s^2" in report.statement
        # a free acceleration at the start is worth what the largest saves
        free = dataclasses.replace(section, start_acceleration=np.nan)
        paid = section.jerk[0, 0] * (A - 300.0) / J
        report = verify_bound(curve, self.limits(), dataclasses.replace(certificate, sections=(free,)))
        assert report.proved == pytest.approx(total - paid, rel=1e-12)


def motion(z):
    """Some x over z = sigma / length, and its first two derivatives."""
    return 1.3 + 0.5 * np.sin(3.0 * z + 1.0), 1.5 * np.cos(3.0 * z + 1.0), -4.5 * np.sin(3.0 * z + 1.0)


def turning(z):
    """The same with one period."""
    w = 2.0 * np.pi
    return 1.3 + 0.5 * np.sin(w * z), 0.5 * w * np.cos(w * z), -0.5 * w**2 * np.sin(w * z)


def both_sides(curve, limits, certificate, x_of, jumps=()):
    """Int l q_ddd / J dt + int m q_dd / A dsigma by third derivatives, and by parts as the verifier has it."""
    left = right = 0.0
    for k in range(len(certificate.sections)):
        section = _Section.of(curve, limits, certificate, k)
        parts, bounds = section.path.parts, Bounds.of(limits)
        i, r, weight = pieces_of(section)
        span = parts.sigma[-1] + parts.h[-1]
        x, x1, x2 = (value / span**n for n, value in enumerate(x_of((parts.sigma[i] + r * parts.h[i]) / span)))
        points = path_points(curve, limits, parts, i, r)
        u, u1, u2 = parts.coordinate(i, r)
        bend = 12.0 * np.diff(parts.slope[:, i], 2, axis=0)
        u3 = (bend[0] * (1 - r) ** 2 + 2 * r * (1 - r) * bend[1] + r**2 * bend[2]) / parts.h[i] ** 3
        d = curve.derivatives(u, 3)
        p = d[:, :, [unit == "mm" for unit in curve.axis_units]]
        v = np.linalg.norm(p[1], axis=-1)
        v1 = np.sum(p[1] * p[2], axis=-1) / v
        v2 = (np.sum(p[2] ** 2 + p[1] * p[3], axis=-1) - v1**2) / v
        q1, q2, q3 = (np.vstack([d[n + 1].T, tip]) for n, tip in enumerate((v, v1, v2)))
        third = q3 * u1**3 + 3.0 * q2 * u1 * u2 + q1 * u3
        first, second = points.first, points.second
        np.testing.assert_allclose(first, q1 * u1, rtol=1e-12, atol=1e-12 * np.abs(first).max())
        jerk = np.sqrt(x) * (third * x + 1.5 * second * x1 + 0.5 * first * x2)
        acceleration = second * x + 0.5 * first * x1
        l_row, m_row = parts.jerk_at(i, r)[0], parts.acceleration_at(i, r)[0]
        powers = (l_row * jerk / bounds.jerk[:, None]).sum(axis=0) / np.sqrt(x)
        powers += (m_row * acceleration / bounds.acceleration[:, None]).sum(axis=0)
        left += float(np.sum(weight * powers))
        right += float(np.sum(weight * section.path.terms(points, i, r)[1] * x))
        right += places_between(section, limits, x_of, span)
    return left, right


def places_between(section, limits, x_of, span):
    """The brackets at the places between pieces, for a motion whose x and x' are continuous there."""
    parts, path, at = section.path.parts, section.path, section.joins
    if at.size == 0:
        return 0.0
    before, after = sides(path, section.stretches, at, 1), sides(path, section.stretches, at + 1, 0)
    x, x1, _ = x_of(parts.sigma[at + 1] / span)
    ends = [
        path_points(path.curve, limits, parts, at + k, np.full(at.size, 1.0 - k), np.full(at.size, k == 0))
        for k in (0, 1)
    ]
    total = 0.0
    for n, (a, b) in enumerate(zip(before, after, strict=True)):
        speed2 = x[n] * np.sum(ends[0].first[:-1, n] ** 2)
        steps = (ends[1].second - ends[0].second)[:, n] * x[n] + 0.5 * (ends[1].first - ends[0].first)[:, n] * x1[
            n
        ] / span
        total += (a.pull - b.pull) * speed2 - float(np.dot(a.load, steps))
    return total


def limits_for(name):
    curve = load_curve(name)
    limits = load_limits("five-axis" if name == "flank" else "mill").for_curve(curve)
    return curve, Limits(
        limits.feed,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.chord_error,
        limits.period,
        900.0,
        15000.0,
        axes=limits.axes,
    )


class TestIdentity:
    """By parts twice, nothing is lost: for any motion and any multipliers both sides are equal."""

    @pytest.mark.parametrize("name", ["circle", "teardrop", "butterfly-nurbs", "flank", "hypotrochoid", "snailshell"])
    @pytest.mark.parametrize("seed", [0, 1])
    def test_from_rest_to_rest(self, name, seed):
        curve, limits = limits_for(name)
        left, right = both_sides(curve, limits, smooth_certificate(curve, seed=seed, knots=40), motion)
        assert left == pytest.approx(right, rel=1e-8)
        assert abs(left) > 1e-4

    @pytest.mark.parametrize("name", ["teardrop", "flank"])
    def test_with_feeds_at_the_ends(self, name):
        curve, limits = limits_for(name)
        certificate = smooth_certificate(curve, seed=5, knots=40, feeds=(1.0, 1.0))
        left, right = both_sides(curve, limits, certificate, motion)
        section = _Section.of(curve, limits, certificate, 0)
        span = certificate.sections[0].sigma[-1]
        for end, sign in ((0, -1.0), (1, 1.0)):
            points = path_points(curve, limits, section.path.parts, np.array([-end]) % section.path.parts.h.size,
                                 np.array([float(end)]), np.array([end == 1]))  # fmt: skip
            x, x1, _ = motion(np.array([float(end)]))
            feed = float(points.first[-1, 0] * np.sqrt(x[0]))
            acceleration = float(points.second[-1, 0] * x[0] + 0.5 * points.first[-1, 0] * x1[0] / span)
            right += end_term(section.side(end), section.path, feed, acceleration, sign)
        assert left == pytest.approx(right, rel=1e-8)

    def test_where_a_periodic_path_closes(self):
        curve, limits = limits_for("circle")
        certificate = smooth_certificate(curve, seed=6, knots=40, feeds=(1.0, 1.0))
        left, right = both_sides(curve, limits, certificate, turning)
        section = _Section.of(curve, limits, certificate, 0)
        x, x1, _ = turning(np.zeros(1))
        first, last = section.side(0), section.side(1)
        span, parts = certificate.sections[0].sigma[-1], section.path.parts
        accelerations = []
        for i, r in ((0, 0.0), (parts.h.size - 1, 1.0)):
            points = path_points(curve, limits, parts, np.array([i]), np.array([r]), np.array([r == 1.0]))
            accelerations.append(points.second[:, 0] * x[0] + 0.5 * points.first[:, 0] * x1[0] / span)
        speed2 = x[0] * np.sum(points.first[:-1, 0] ** 2)
        right += (last.pull - first.pull) * speed2
        # over u the circle's second derivative jumps where it closes, so this motion's acceleration does, too
        right += float(np.dot(last.load, accelerations[1]) - np.dot(first.load, accelerations[0]))
        assert left == pytest.approx(right, rel=1e-8)
        # the price covers every motion within the limits of the acceleration
        bounds = Bounds.of(limits)
        slow = dataclasses.replace(last, cap=speed2), dataclasses.replace(first, cap=speed2)
        any_acceleration = np.random.default_rng(2).uniform(-1.0, 1.0, (200, bounds.jerk.size)) * bounds.acceleration
        paid = (last.pull - first.pull) * speed2 + any_acceleration @ (last.load - first.load)
        assert seam(*slow, section.path, smooth=True) <= paid.min()

    def test_the_minimum_at_a_point(self):
        rng = np.random.default_rng(1)
        w, g, cap = rng.uniform(0, 1, 200), rng.normal(size=200), 10.0 ** rng.uniform(-2, 2, 200)
        x = cap * np.linspace(0.0, 1.0, 20001)[1:, None] ** 2
        np.testing.assert_allclose(smallest(w, g, cap), (w / np.sqrt(x) + g * x).min(axis=0), rtol=1e-6, atol=1e-6)
        assert smallest(np.array([1.0]), np.array([-1e-30]), np.array([np.inf]))[0] == -np.inf
        assert smallest(np.zeros(1), np.ones(1), np.ones(1))[0] == 0.0

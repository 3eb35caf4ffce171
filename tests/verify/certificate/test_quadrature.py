"""The integrals of a bound: the identity behind its proof, and what they may be off."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from certificate_cases import limits_for, section_of
from certificates import pieces_of, smooth_certificate

from planner.verify.certificate import verify_bound
from planner.verify.certificate.atoms import end_term, seam, sides
from planner.verify.certificate.pathspeeds import Bounds, path_points
from planner.verify.certificate.quadrature import min_integrand


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
        section = section_of(curve, limits, certificate, k)
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
        section = section_of(curve, limits, certificate, 0)
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
        section = section_of(curve, limits, certificate, 0)
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
        np.testing.assert_allclose(min_integrand(w, g, cap), (w / np.sqrt(x) + g * x).min(axis=0), rtol=1e-6, atol=1e-6)
        assert min_integrand(np.array([1.0]), np.array([-1e-30]), np.array([np.inf]))[0] == -np.inf
        assert min_integrand(np.zeros(1), np.ones(1), np.ones(1))[0] == 0.0


class TestQuadrature:
    """What the integrals may be off, and what that costs."""

    def test_what_the_quadrature_may_be_off_is_subtracted(self):
        curve, limits = limits_for("flank")
        certificate = smooth_certificate(curve, seed=3)
        section = section_of(curve, limits, certificate, 0)
        value, doubt = section.scaled(section.scale()).value()
        report = verify_bound(curve, limits, certificate)
        assert doubt > 0.0
        assert report.allowance == doubt
        assert report.proved == value - doubt

    def test_a_rough_certificate_is_paid_for_and_ends(self):
        curve, limits = limits_for("teardrop")
        certificate = smooth_certificate(curve, seed=3, knots=400)
        (section,) = certificate.sections
        rng = np.random.default_rng(0)
        rough = dataclasses.replace(section, jerk=rng.uniform(-1.0, 1.0, section.jerk.shape))
        report = verify_bound(curve, limits, dataclasses.replace(certificate, sections=(rough,)))
        assert report.proved < 0.0
        assert report.scale < 1.0

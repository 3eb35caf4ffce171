"""The parts of a bound: the identity behind its proof, loads, prices, and places where the curvature jumps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import drives
from certificate_cases import bends, limits_for, section_of
from certificates import pieces_of, smooth_certificate
from scipy.optimize import linprog

from planner import InputError, load_curve, plan_feedrate
from planner.machine.limits import Limits
from planner.verify.certificate import verify_bound, verify_plan_bound
from planner.verify.certificate.atoms import _least, end_term, seam, sides, spared_around, stepped
from planner.verify.certificate.pathspeeds import Bounds, path_points
from planner.verify.certificate.quadrature import smallest


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
        np.testing.assert_allclose(smallest(w, g, cap), (w / np.sqrt(x) + g * x).min(axis=0), rtol=1e-6, atol=1e-6)
        assert smallest(np.array([1.0]), np.array([-1e-30]), np.array([np.inf]))[0] == -np.inf
        assert smallest(np.zeros(1), np.ones(1), np.ones(1))[0] == 0.0


class TestParts:
    """Single terms against dense sampling."""

    def section(self, **options):
        curve, limits = limits_for("teardrop")
        return section_of(curve, limits, smooth_certificate(curve, seed=8, **options), 0)

    def test_the_largest_load_and_the_smallest_size(self):
        section = self.section(jerk=3.0, knots=6)
        s, parts = section.stretches, section.path.parts
        i, r, _ = pieces_of(section, 60)
        dense = np.abs(parts.jerk_at(i, r)[0])
        load = parts.largest_load(s.interval, s.lower, s.upper).reshape(-1)
        sampled = dense.sum(axis=0).reshape(load.size, -1).max(axis=1)
        assert np.all(load >= sampled - 1e-12)
        np.testing.assert_allclose(load, sampled, rtol=1e-2)
        inside = load > parts_ends(parts, s) + 1e-9  # the largest is within the part
        assert inside.any()

    def test_the_integral_of_m(self):
        section = self.section(acceleration=1.0, knots=9)
        i, r, weight = pieces_of(section, 200)
        dense = np.sum(weight * np.abs(section.path.parts.acceleration_at(i, r)[0]).sum(axis=0))
        assert section.path.parts.acceleration_price() == pytest.approx(dense, rel=1e-4)

    def test_the_feed_of_the_chord_error(self):
        """On a circle of 10 mm, the chord of a period leaves it by the error exactly."""
        curve = load_curve("circle")
        radius = 1.0 / curve.curvature(np.array([0.3]))[0]
        limits = Limits(1e9, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2, chord_error=1e-3, period=2e-3)
        nothing = smooth_certificate(curve, seed=0, jerk=0.0, acceleration=0.0, feeds=(np.nan,) * 2, periodic=True)
        report = verify_bound(curve, limits, nothing)
        chord = curve.length / report.proved * limits.period
        assert radius - np.sqrt(radius**2 - 0.25 * chord**2) == pytest.approx(1e-3, rel=1e-9)
        assert "osculating circle" in report.statement

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

    def test_a_periodic_path_pays_where_it_closes_and_shrinks_as_a_whole(self):
        curve, limits = limits_for("circle")
        options = {"feeds": (np.nan, np.nan), "periodic": True, "stops": (sum(curve.domain) / 2.0,)}
        certificate = smooth_certificate(curve, seed=4, jerk=2.0, acceleration=0.01, **options)
        first, last = (section_of(curve, limits, certificate, k) for k in (0, 1))
        scales = first.scale(), last.scale()
        assert scales[0] != scales[1]
        first, last = first.scaled(min(scales)), last.scaled(min(scales))
        price = seam(last.side(1), first.side(0), first.path, smooth=True)
        assert price < 0.0
        (a, off_a), (b, off_b) = first.value(), last.value()
        report = verify_bound(curve, limits, certificate)
        assert report.scale == min(scales)
        assert report.proved == pytest.approx(a + b - off_a - off_b + price, rel=1e-12)


def parts_ends(parts, stretches):
    """Larger of the loads at both ends of each part."""
    s = stretches
    return np.max([np.abs(parts.jerk_at(s.interval, r)[0]).sum(axis=0) for r in (s.lower, s.upper)], axis=0)


class TestCurvatureJumps:
    def limits(self, **others):
        return drives(**others)

    def test_the_least_over_speed_and_step_is_that_of_a_linear_program(self):
        rng = np.random.default_rng(7)
        for trial in range(200):
            dim = int(rng.integers(1, 5))
            jump, tangent, cost, saved, largest = rng.normal(size=(5, dim))
            saved, largest = np.abs(saved), np.exp(largest)
            if trial % 3 == 0:
                saved[:] = 0.0
            if trial % 5 == 0:
                tangent[0] = 0.0
            pull, cap = rng.normal(), np.exp(rng.normal())
            if not tangent.any():
                continue
            # variables y, a, and z_j >= |D_j|
            objective = np.concatenate([[pull * cap - cost @ jump, -cost @ tangent], saved])
            rows, sides_ = [], []
            for j in range(dim):
                for sign in (1.0, -1.0):
                    row = np.zeros(2 + dim)
                    row[:2] = sign * jump[j], sign * tangent[j]
                    rows.append(row.copy())
                    sides_.append(largest[j])
                    row[2 + j] = -1.0
                    rows.append(row)
                    sides_.append(0.0)
            best = linprog(objective, rows, sides_, bounds=[(0.0, 1.0), (None, None), *[(0.0, None)] * dim])
            assert best.success
            assert _least(jump, tangent, pull, cap, cost, saved, largest) == pytest.approx(best.fun, rel=1e-6, abs=1e-6)

    def test_the_price_covers_every_step_that_a_check_grants(self):
        curve, limits = bends(), self.limits(tangential_acceleration=900.0, tangential_jerk=3000.0)
        section = section_of(curve, limits, smooth_certificate(curve, seed=2, jerk=0.8, acceleration=0.2), 0)
        assert section.jumps.all()
        assert section.joins.size == 2
        before = sides(section.path, section.stretches, section.joins, 1)
        after = sides(section.path, section.stretches, section.joins + 1, 0)
        rng = np.random.default_rng(4)
        largest = limits.jerk * limits.period / 0.75
        count = 0
        for a, b in zip(before, after, strict=True):
            price, found = stepped(a, b, section.path, np.zeros(3)), np.inf
            spared = np.array([0.1, 0.2, 0.0])
            cheap, found_cheap = stepped(a, b, section.path, spared), np.inf
            tip = a.turn[:2] / a.turn[-1]
            for _ in range(4000):
                speed2 = min(a.cap, b.cap) * rng.uniform() ** 2
                step = (b.bend - a.bend)[:2] * speed2 + a.turn[:2] * rng.normal() * largest[0]
                if np.any(np.abs(step) > largest):
                    continue
                count += 1
                steps = np.append(step, step @ tip)
                paid = (a.pull - b.pull) * speed2 - a.load @ steps
                assert price <= paid + 1e-12
                found = min(found, paid)
                # 1.5 periods before and after with 0.75 D / T less jerk
                paid += 2.0 * 1.5 * 0.75 * float(np.dot(spared[:2] / limits.jerk, np.abs(step)))
                assert cheap <= paid + 1e-12
                found_cheap = min(found_cheap, paid)
            assert price == pytest.approx(found, rel=0.15)
            assert cheap == pytest.approx(min(found_cheap, 0.0), rel=0.15, abs=1e-9)
        assert count > 500

    def test_what_a_step_takes_from_the_jerk_around_it_pays_for_it(self):
        curve, limits = bends(), self.limits()
        smooth = smooth_certificate(curve, seed=2, jerk=0.8, acceleration=0.0)
        section = section_of(curve, limits, smooth, 0)
        (a, _), (b, _) = (sides(section.path, section.stretches, section.joins + k, 1 - k) for k in (0, 1))
        level = dataclasses.replace(a, force=a.force * 0.0), dataclasses.replace(b, force=b.force * 0.0)
        alone = stepped(*level, section.path, np.zeros(3))
        load = np.abs(a.load * np.append(limits.jerk, 0.0))
        assert alone < -1e-4
        assert stepped(*level, section.path, load) >= 0.5 * alone
        # without a tangential multiplier the axes' own |l| pays for all of it
        plain = [dataclasses.replace(side, load=np.append(side.load[:2], 0.0)) for side in level]
        assert stepped(*plain, section.path, load) == 0.0

    def test_jumps_close_to_another_or_to_an_end_are_not_alone(self):
        curve, limits = bends(), self.limits()
        section = section_of(curve, limits, smooth_certificate(curve, seed=2, jerk=0.8), 0)
        s = section.stretches
        times = np.linspace(0.0, 1.0, s.lower.size + 1)
        found = spared_around(section.path, s, times, np.array([0.3, 0.6]))
        assert (found[:2] > 0.0).any()
        assert not spared_around(section.path, s, times, np.array([0.3, 0.3029])).any()
        assert not spared_around(section.path, s, times, np.array([0.001, 0.9990])).any()
        # the smallest |l| in a window that holds everything
        everywhere = section.path.parts.smallest_sizes(s.interval, s.lower, s.upper)
        i, r, _ = pieces_of(section, 30)
        dense = np.abs(section.path.parts.jerk_at(i, r)[0]).min(axis=1)
        assert np.all(everywhere <= dense + 1e-12)

    def test_an_exact_stop_there_is_an_assumption_that_is_told(self):
        curve, limits = bends(), self.limits()
        report = verify_bound(curve, limits, smooth_certificate(curve, stops=(40.0,), seed=2, jerk=0.01))
        assert report.stops == (40.0,)
        assert "for plans that stop at u = 40 (1 besides corners)" in report.statement
        passing = plan_feedrate(curve, limits, intervals=200)
        with pytest.raises(InputError, match="stop at u = 40; this plan passes there"):
            verify_plan_bound(curve, limits, smooth_certificate(curve, stops=(40.0,), seed=2), passing)
        stopping = plan_feedrate(curve, limits, intervals=200, exact_stop=True)
        certificate = smooth_certificate(curve, stops=(40.0, 80.0), seed=2, jerk=0.01, acceleration=0.001)
        found = verify_plan_bound(curve, limits, certificate, stopping)
        assert 0.0 < found.proved <= stopping.duration

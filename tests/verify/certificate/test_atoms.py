"""Terms of a bound at single places: where the curvature jumps, and where a closed path joins."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import drives
from certificate_cases import bends, limits_for, section_of
from certificates import pieces_of, smooth_certificate
from scipy.optimize import linprog

from planner import InputError, plan_feedrate
from planner.verify.certificate import verify_bound, verify_plan_bound
from planner.verify.certificate.atoms import _least, seam, sides, spared_around, stepped


class TestCurvatureJumps:
    def limits(self, **others):
        return drives(**others)

    def test_the_least_over_speed_and_step_is_that_of_a_linear_program(self):
        rng = np.random.default_rng(7)
        counted = 0
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
            counted += 1
        assert counted > 180

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


def test_a_periodic_path_pays_where_it_closes_and_shrinks_as_a_whole():
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

"""The verifier of lower bounds: closed forms, plans, and what it must refuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import drives
from certificate_cases import INF, A, J, L, V, bends, limits_for, tangential
from certificates import arc_section, line_certificate, line_section, smooth_certificate

from planner import InputError, check, plan_feedrate
from planner.certificate import Certificate, CertificateSection
from planner.geometry.curve import FeedCaps
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.verify.certificate import verify_bound, verify_plan_bound


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
        assert report.proved == pytest.approx(total - paid, rel=1e-12, abs=0.0)


class TestPlans:
    """No bound exceeds a plan that passes the check, whatever the multipliers."""

    @pytest.mark.parametrize("name", ["circle", "teardrop", "butterfly-nurbs", "flank", "bends", "bends-X-A"])
    def test_random_multipliers_stay_below(self, name):
        if name.startswith("bends"):
            curve = bends(("X", "Y") if name == "bends" else ("X", "A"))
            limits = drives(axes=curve.axes)
        else:
            curve, limits = limits_for(name)
        plan = plan_feedrate(curve, limits, intervals=400)
        assert check(curve, limits, plan).ok
        positive = 0
        for seed in range(12):
            size = 10.0 ** np.random.default_rng(seed).uniform(-4.0, -0.5)
            certificate = smooth_certificate(curve, seed=seed, jerk=size, acceleration=0.1 * size)
            report = verify_bound(curve, limits, certificate)
            assert report.proved <= plan.duration
            positive += report.proved > 0.0
        assert positive >= 4

    def test_a_periodic_path_at_its_feed(self):
        curve, limits = limits_for("circle")
        plan = plan_feedrate(curve, limits, periodic=True, intervals=200)
        assert check(curve, limits, plan).ok
        nothing = smooth_certificate(curve, seed=0, jerk=0.0, acceleration=0.0, feeds=(np.nan, np.nan), periodic=True)
        report = verify_plan_bound(curve, limits, nothing, plan)
        assert report.proved == pytest.approx(plan.duration, rel=1e-5)
        assert report.proved <= plan.duration * (1.0 + 1e-9)
        assert report.statement.startswith("no plan of circle that pass its end into its start")
        for seed in range(5):
            some = smooth_certificate(
                curve, seed=seed, jerk=0.01, acceleration=1e-3, feeds=(np.nan,) * 2, periodic=True
            )
            assert verify_bound(curve, limits, some).proved <= plan.duration

    def test_plans_with_other_ends_are_told_apart(self):
        curve, limits = limits_for("teardrop")
        plan = plan_feedrate(curve, limits, start_feed=2.0, intervals=100)
        with pytest.raises(InputError, match="begin with 0 mm/s; this plan begins with 2 mm/s"):
            verify_plan_bound(curve, limits, smooth_certificate(curve, seed=1), plan)
        certificate = smooth_certificate(curve, seed=1, jerk=0.0, acceleration=1e-4, feeds=(2.0, 0.0))
        assert verify_plan_bound(curve, limits, certificate, plan).proved <= plan.duration

    def test_a_plan_that_a_bound_denies_is_an_error(self):
        certificate = line_certificate(line(), L, V, A, J)
        limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])
        plan = plan_feedrate(line(), limits.with_feed(V), intervals=100)
        report = verify_plan_bound(line(), limits, certificate, plan)
        assert report.ok
        faster = Limits(1e6, [V, np.inf], [0.99 * A, np.inf], [J, np.inf])
        slower = plan_feedrate(line(), faster.with_feed(V), intervals=100)
        slower = dataclasses.replace(slower, lower_bound=np.nan)  # its own bound is about the lower limits
        assert verify_plan_bound(line(), limits, certificate, slower).ok
        denied = verify_plan_bound(line(), faster, line_certificate(line(), L, V, 0.99 * A, J), plan)
        assert "error of this program" in denied.refusal


class TestRefusals:
    limits = Limits(1e6, [V, np.inf], [A, np.inf], [J, np.inf])

    def refused(self, match, section=None, curve=None, **changes):
        certificate = line_certificate(line(), L, V, A, J)
        if section is not None:
            changes["sections"] = (dataclasses.replace(certificate.sections[0], **section),)
        with pytest.raises(InputError, match=match):
            verify_bound(curve or line(), self.limits, dataclasses.replace(certificate, **changes))

    def test_another_curve(self):
        self.refused("for another curve", curve=line(L + 1.0))
        self.refused("for another curve", fingerprint="0" * 32)

    def test_names(self):
        self.refused('multipliers of "jerk Z"', jerk_names=("jerk Z",))
        self.refused('multipliers of "acceleration X"', jerk_names=("acceleration X",))
        both = np.zeros((2, 15))
        self.refused("names a limit twice", {"jerk": both}, jerk_names=("jerk X", "jerk X"))

    def test_shapes_and_values(self):
        section = line_section(L, V, A, J)[0]
        self.refused("no section", sections=())
        self.refused("bound = nan", bound=float("nan"))
        for name in ("sigma", "u", "jerk", "acceleration"):
            values = getattr(section, name)
            self.refused("is float64 of shape", {name: values[..., :-1]})
            self.refused(f"{name} is float32", {name: values.astype(np.float32)})
            bad = values.copy()
            bad.reshape(-1)[3] = np.nan
            self.refused(f"{name} has a value that is not finite", {name: bad})
        self.refused(r"sigma is float64 of shape \(1, 14\)", {"sigma": section.sigma[None]})

    def test_the_coordinate(self):
        section = line_section(L, V, A, J)[0]
        sigma = section.sigma.copy()
        sigma[[3, 5]] = sigma[[5, 3]]
        self.refused("is less than the one before", {"sigma": sigma})
        sigma = section.sigma.copy()
        sigma[3] = sigma[2]
        self.refused("threefold", {"sigma": sigma})
        u = section.u.copy()
        u[0, 4] += 1e-6
        self.refused("differs on the two sides", {"u": u})
        u = section.u.copy()
        u[1, 3:5] = -1.0
        self.refused("does not increase between", {"u": u})
        u = section.u.copy()
        u[1, 3:5] = 0.0
        self.refused("does not increase between", {"u": u})
        u = section.u.copy()
        u[2, 3:5] = 1e7
        self.refused("does not increase between", {"u": u})

    def test_parts_of_the_curve_left_out(self):
        section = line_section(L, V, A, J)[0]
        u = section.u.copy()
        u[0, -1] -= 1e-3
        self.refused("leaves out the curve between", {"u": u})

    def test_ends(self):
        self.refused("start_feed = -1.0 must be >= 0", {"start_feed": -1.0})
        self.refused("end_feed = nan must be >= 0", {"end_feed": float("nan")})
        self.refused("start_acceleration = 5.0 must be nan", {"start_acceleration": 5.0})
        self.refused("start_feed = 0.0 must be nan, free", periodic=True)

    def test_a_corner_or_a_knot_passed(self):
        curve = NurbsCurve([[0.0, 0.0], [L / 2, 0.0], [L / 2, L]], [0.0, 0.0, L / 2, L, L], 1)
        fingerprint = curve.fingerprint
        self.refused("no knot at u = 50", fingerprint=fingerprint, curve=curve)
        certificate = smooth_certificate(bends(), seed=0)
        other = dataclasses.replace(certificate, fingerprint=fingerprint)
        with pytest.raises(InputError, match=r"leaves out|no knot"):
            verify_bound(curve, self.limits, other)
        (section,) = line_certificate(line(), L, V, A, J).sections
        at = np.searchsorted(section.u[0], L / 2)
        start, end = section.sigma[at - 1], section.sigma[at]
        inserted = dataclasses.replace(
            section,
            sigma=np.insert(section.sigma, at, 0.5 * (start + end)),
            u=np.insert(section.u, at, [L / 2, V, 0.0], axis=1),
            jerk=np.insert(section.jerk, at, 0.0, axis=1),
            acceleration=np.insert(section.acceleration, at, 0.0, axis=1),
        )
        self.refused("passes the corner at u = 50", sections=(inserted,), fingerprint=fingerprint, curve=curve)

    def test_a_closed_path_needs_one_direction(self):
        section = line_section(L, V, A, J)[0]
        curve = NurbsCurve([[0.0, 0.0], [L, 0.0], [L, L], [0.0, 0.0]], [0, 0, 0, 50, 100, 100, 100], 2)
        certificate = smooth_certificate(curve, seed=0, feeds=(np.nan, np.nan), periodic=True)
        with pytest.raises(InputError, match="another direction at its end"):
            verify_bound(curve, self.limits, certificate)
        assert section.start_feed == 0.0

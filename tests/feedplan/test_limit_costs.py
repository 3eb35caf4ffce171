"""What each limit costs: a closed form, the plan of another machine, and what has no plan says so."""

from __future__ import annotations

import math

import pytest
from cases import PROGRAMS

import feedplan.limit_costs
from feedplan.job import load_job
from feedplan.limit_costs import limit_costs, raised_job
from planner import InputError, Limits, SolverError

A, J, V = 500.0, 20000.0, 50.0
MACHINE = Limits(100.0, [250.0, 250.0], [A, A], [J, J], axes="XY")
# From stop to stop, bound by jerk, acceleration and the programmed feed: s/v + v/a + a/j.
LINE = f"G21 G90 G61\nG1 X60 F{60 * V:g}\nX0\nM2\n"


@pytest.fixture
def job(tmp_path):
    (tmp_path / "part.ngc").write_text(LINE)
    return load_job(tmp_path / "part.ngc", MACHINE)


def leg(a=A, j=J, v=V):
    return 60.0 / v + v / a + a / j


def test_closed_form(job):
    """Each changes its own terms of it; more acceleration makes v/a less and a/j more."""
    found = {row.limit: row for row in limit_costs(job, job.plan())}
    assert set(found) == {"feed", "acceleration X", "jerk X"}
    assert all(row.ok and not row.reason for row in found.values())
    for name, raised in (("feed", {"v": 1.1 * V}), ("jerk X", {"j": 1.1 * J}), ("acceleration X", {"a": 1.1 * A})):
        assert found[name].saved_s == pytest.approx(2.0 * (leg() - leg(**raised)), abs=2e-4)


def test_it_is_the_plan_of_that_machine():
    job = load_job(PROGRAMS / "slots.ngc", "mill", tolerance=0.01)
    profile = job.plan()
    rows = limit_costs(job, profile)
    assert [row.limit for row in rows] == [n for n, share in profile.shares().items() if n != "none" and share >= 0.005]
    name = "jerk Y"
    other = load_job(PROGRAMS / "slots.ngc", job.limits.raised(name, 1.1), tolerance=0.01)
    assert next(row.saved_s for row in rows if row.limit == name) == profile.duration - other.plan().duration


def test_a_limit_that_is_raised_by_nothing_changes_nothing(job):
    assert raised_job(job, "jerk X", 1.0).plan().duration == job.plan().duration


def test_what_has_no_plan_says_so(job, monkeypatch):
    def fail(*_given, **_options):
        raise SolverError("no plan was found")

    profile = job.plan()
    monkeypatch.setattr(feedplan.limit_costs, "raised_job", fail)
    rows = limit_costs(job, profile)
    assert len(rows) == 3
    assert all(math.isnan(row.saved_s) and not row.ok and row.reason == "no plan was found" for row in rows)


def test_a_curve_that_is_no_program_is_refused():
    job = load_job("circle", "mill")
    with pytest.raises(InputError, match="circle is no part program"):
        raised_job(job, "feed", 1.1)


class TestRaised:
    LIMITS = Limits(100.0, [250.0, 20.0], [A, A], [J, J], chord_error=1e-3, axes="XY", rapid=150.0)

    @pytest.mark.parametrize("name", ["feed", "chord error", "velocity Y", "acceleration X", "jerk Y"])
    def test_one_and_no_other(self, name):
        raised = self.LIMITS.raised(name, 1.5)
        assert raised != self.LIMITS
        assert raised.raised(name, 1.0 / 1.5) == self.LIMITS
        keys = [k for k in ("feed", "chord_error", "rapid") if getattr(raised, k) != getattr(self.LIMITS, k)]
        rows = [
            f"{k} {axis}"
            for k in ("velocity", "acceleration", "jerk")
            for axis, one, other in zip("XY", getattr(raised, k), getattr(self.LIMITS, k), strict=True)
            if one != other
        ]
        assert keys + rows == {"feed": ["feed", "rapid"], "chord error": ["chord_error"]}.get(name, [name])

    @pytest.mark.parametrize("name", ["jerk Z", "none", "speed", ""])
    def test_another_name_is_refused(self, name):
        with pytest.raises(InputError, match="is no limit of these; they are feed, chord error"):
            self.LIMITS.raised(name, 1.1)

    @pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, "2"])
    def test_another_factor_is_refused(self, factor):
        with pytest.raises(InputError, match=r"factor = .* must be a number > 0"):
            self.LIMITS.raised("feed", factor)

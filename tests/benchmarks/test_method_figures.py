"""The experiments behind the page on the method, on small grids: what the page says of them, and that they are drawn."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cases import PROJECT
from matplotlib.figure import Figure
from PIL import Image

from benchmarks import method
from benchmarks import method_figures as figures
from planner.plan.solvers import interior as optimal

DOCS = PROJECT / "docs"
SMALL = 120


@pytest.fixture(scope="module")
def circle():
    return method.case("circle 100", SMALL)


def test_the_rest_map_lets_splines_converge_where_arc_length_does_not():
    coarse, fine = method.start_errors((20, 160))
    assert fine["over y"] == pytest.approx(coarse["over y"], rel=1e-9)
    assert fine["over y"] > 0.9
    assert fine["over sigma"] < 0.1 * coarse["over sigma"]


def test_a_spline_over_y_follows_the_exact_start_at_its_knots():
    spline = method.start_in_y(10)
    at = np.searchsorted(spline.y, spline.knots[1:] - 1e-9)
    assert spline.squared[at] == pytest.approx(method.exact_start(spline.knots[1:]), rel=1e-9)


def test_limits_held_at_knots_alone_are_exceeded_between_them():
    knots, both = method.collocation_rows("circle 100", SMALL)
    assert knots.jerk > 5.0
    assert both.jerk < 1.1
    assert knots.duration_s < both.duration_s


def test_tightening_takes_the_excess_away():
    before, after = method.tightening_rounds(method.case("butterfly 100", 4 * SMALL), 4 * SMALL)
    assert before.used.slowdown.max() > 1.0005
    assert after.used.slowdown.max() - 1.0 < 0.2 * (before.used.slowdown.max() - 1.0)


def test_every_iterate_from_the_scan_is_feasible_and_the_last_is_the_optimum(circle):
    run = method.trace(method.constraints(circle, SMALL))
    assert run.used.max() <= 1.0 + 1e-9
    assert run.time[-1] == run.time.min()
    assert run.gap[-1] < optimal.GAP_TOLERANCE < run.gap[-2]


def test_the_relaxation_meets_the_optimum_from_below(circle):
    problem = method.constraints(circle, SMALL)
    solution = method.optimal.solve_interior(problem, method.optimal.start_from(problem, problem.guess))
    found = method.relax(circle, SMALL)
    assert 0.999 < found.bound / (solution.time * problem.time_unit) <= 1.0
    assert (found.pace >= found.x**-0.5 * (1.0 - 1e-6)).all()


def test_multipliers_promise_what_solving_again_saves(circle):
    rows = {row.limit: row for row in method.saving_rows(circle, SMALL, 1e-3)}
    for limit in ("feed", "jerk Y"):
        assert rows[limit].promised_s == pytest.approx(rows[limit].solved_s, rel=2e-3)
    # where limits bind together the multipliers share their price in another way, but not another price
    assert sum(r.promised_s for r in rows.values()) == pytest.approx(sum(r.solved_s for r in rows.values()), rel=5e-3)


def test_the_pattern_of_the_newton_system_is_symmetric_and_banded():
    entries = {(i, j) for i, j, _ in figures._newton_pattern(5)}
    assert entries == {(j, i) for i, j in entries}
    assert max(abs(i - j) for i, j in entries) == 7
    assert max(i for i, _ in entries) == 5 * 5 - 3


def test_every_picture_is_drawn(circle, monkeypatch):
    monkeypatch.setattr(Figure, "draw_without_rendering", lambda figure: None)  # the layout takes most of the time
    drawn = {
        "method-rest-map.png": figures.rest_map_figure(8),
        "method-knots.png": figures.knots_figure(circle, SMALL),
        "method-plan.png": figures.plan_figure(circle),
        "method-convexity.png": figures.convexity_figure(circle, SMALL),
        "method-newton.png": figures.newton_figure(4),
        "method-convergence.png": figures.convergence_figure(circle, SMALL),
        "method-between.png": figures.between_figure(circle, SMALL),
        "method-sensitivities.png": figures.sensitivity_figure(circle, SMALL),
        "method-samples.png": figures.samples_figure(circle, (0.0, 0.1)),
    }
    assert set(drawn) == set(figures.figures())
    for figure in drawn.values():
        assert all(a.has_data() or a.patches for a in figure.axes)


def test_a_picture_is_stored_with_a_palette(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "figures", lambda: {"one.png": figures.newton_figure})
    figures.main(["--output", str(tmp_path)])
    with Image.open(tmp_path / "one.png") as picture:
        assert picture.mode == "P"
        assert picture.size == (1420, 600)
    assert (tmp_path / "one.png").stat().st_size < 120_000


def test_the_page_shows_every_picture():
    shown = re.findall(r"\]\((method-[a-z-]+\.png)\)", (DOCS / "method.md").read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(figures.figures())
    assert all((DOCS / name).stat().st_size < 120_000 for name in shown)

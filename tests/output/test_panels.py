"""Panels of lines: what is drawn, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from planner.errors import InputError
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels

X = np.linspace(0.0, 1.0, 50_000)


def panel(label, y, **options):
    return Panel("title", "u", label, [Line("one", X, y)], **options)


def test_lines_limits_and_labels_are_drawn():
    figure = plot_panels("head", [panel("feed, mm/s", 3.0 * X, bounds=(5.0,)), panel("error, mm", -X)])
    axes = figure.axes
    assert [a.get_ylabel() for a in axes] == ["feed, mm/s", "error, mm"]
    x, y = axes[0].lines[0].get_data()
    assert len(x) < 6000  # thinned out, with its extremes
    assert (np.min(y), np.max(y)) == (0.0, 3.0)
    assert axes[0].lines[1].get_ydata()[0] == 5.0
    assert axes[0].get_ylim()[1] > 5.0


def test_panels_of_a_row_that_show_the_same_have_the_same_axis():
    figure = plot_panels("head", [panel("feed", X), panel("feed", -7.0 * X), panel("other", 100.0 * X)], columns=3)
    limits = [a.get_ylim() for a in figure.axes]
    assert limits[0] == limits[1]
    assert limits[0][0] < -7.0
    assert limits[2][1] > 100.0


def test_a_path_keeps_its_scale_and_empty_places_stay_empty():
    path = Panel("path", "X", "Y", [Line("circle", np.cos(7.0 * X), np.sin(7.0 * X))], equal=True)
    figure = plot_panels("head", [path, panel("a", X), panel("b", X)], columns=2)
    assert figure.axes[0].get_aspect() == 1.0
    assert len(figure.axes[0].lines[0].get_xdata()) == X.size
    assert not figure.axes[3].axison


def test_a_figure_is_saved(tmp_path):
    save_plot(tmp_path / "a.png", plot_panels("head", [panel("a", X)], columns=1))
    save_plot(tmp_path / "b.png", plot_panels("head", [panel("a", X)], columns=1))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_nothing_to_draw_is_refused():
    with pytest.raises(InputError, match="0 panels in 2 columns"):
        plot_panels("head", [])
    with pytest.raises(InputError, match="1 panels in 0 columns"):
        plot_panels("head", [panel("a", X)], columns=0)

"""What is no time law is never handed over."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from planner.errors import SolverError
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.plan.guard import require_law

LINE = NurbsCurve([[0.0, 0.0], [1.0, 0.0]], [0, 0, 1, 1], 1, name="line")
COLUMNS = ("t", "u", "u_rate", "u_acceleration")


def law(**changes):
    """Steady motion along a line, with some of its entries changed: column=(node, value)."""
    t = np.linspace(0.0, 1.0, 11)
    columns = {"t": t, "u": t.copy(), "u_rate": np.ones(11), "u_acceleration": np.zeros(11)}
    for name, (node, value) in changes.items():
        columns[name] = columns[name].copy()
        columns[name][node] = value
    return TimeLaw(**columns)


def test_a_law_passes():
    require_law(LINE, law())


@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_with_its_place(name, value):
    with pytest.raises(SolverError, match=r"near u = 0\.[34].*is not finite"):
        require_law(LINE, law(**{name: (4, value)}))


@pytest.mark.parametrize("name", ["t", "u"])
def test_what_falls_back_from_node_to_node_is_refused(name):
    with pytest.raises(SolverError, match=r"near u = 0\.5.*falls back from one node to the next"):
        require_law(LINE, law(**{name: (6, 0.45)}))


@pytest.mark.parametrize("change", [{"u_rate": (4, -0.01)}, {"u_acceleration": (4, 200.0)}, {"u_rate": (4, 9.0)}])
def test_what_falls_back_between_nodes_is_refused(change):
    with pytest.raises(SolverError, match=r"near u = 0\.[34].*between two nodes"):
        require_law(LINE, law(**change))


@pytest.mark.parametrize("seed", range(40))
def test_it_agrees_with_a_dense_look(seed):
    """Random quintics: refused if and only if their rate falls below 0 on a fine grid."""
    rng = np.random.default_rng(seed)
    nodes = law(u_rate=(5, rng.uniform(0.0, 4.0)), u_acceleration=(5, rng.uniform(-100.0, 100.0)))
    sides = np.stack([nodes.u, nodes.u_rate, nodes.u_acceleration], axis=1)
    rate = BPoly.from_derivatives(nodes.t, sides).derivative()(np.linspace(0.0, 1.0, 20_001))
    if rate.min() < 0.0:
        with pytest.raises(SolverError, match="falls back between two nodes"):
            require_law(LINE, nodes)
    else:
        require_law(LINE, nodes)


def test_rounding_is_no_fall():
    """A last digit of u far from 0, over a short time, turns the rate a little."""
    t = np.array([0.0, 1e-9, 2e-9])
    u = 1e3 + 1e-6 * t / t[-1]
    require_law(LINE, TimeLaw(t, u, np.full(3, 500.0), np.zeros(3)))

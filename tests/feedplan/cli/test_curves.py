"""The list of curves: its facts are those of the curves, and no curve is loaded for it."""

from __future__ import annotations

import subprocess
import sys

import pytest
from cases import PROJECT
from texts import strict_json

from feedplan.cli.curves import curve_facts
from planner import CATALOG, load_curve


def test_lists_every_curve_in_its_order():
    assert tuple(curve_facts()) == CATALOG


@pytest.mark.parametrize("name", CATALOG)
def test_the_facts_are_those_of_the_curve(name):
    found, curve = curve_facts()[name], load_curve(name)
    orders = [at.geometric for at in curve.breaks]
    assert found["axes"] == list(curve.axes)
    assert found["domain"] == list(curve.domain)
    assert found["length_mm"] == pytest.approx(curve.length, rel=1e-12)
    assert found["breaks"] == {f"G{k}": orders.count(k) for k in range(4) if k in orders}
    assert found["source"]


def test_as_json(run):
    code, out, err = run("curves", "--json")
    assert (code, err) == (0, "")
    assert strict_json(out) == curve_facts()


def test_loads_no_library_that_it_does_not_need():
    script = "import sys\nfrom feedplan.cli import app\n"
    script += "try:\n    app(['curves'])\nexcept SystemExit as stop:\n    assert not stop.code\n"
    script += "heavy = {'numpy', 'scipy', 'casadi', 'rich'} & set(sys.modules)\n"
    script += "assert not heavy, heavy\n"
    run = subprocess.run([sys.executable, "-c", script], cwd=PROJECT, capture_output=True, text=True, check=True)
    assert "butterfly-nurbs" in run.stdout

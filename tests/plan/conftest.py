"""Sections with their guess and their knots, laid out once a file."""

import pytest
from cases import line, line_arc_line, mill
from problems import knotted

from planner import load_curve
from planner.machine.machine_file import load_limits

CASES = {
    "teardrop": (lambda: load_curve("teardrop"), mill()),
    "butterfly": (lambda: load_curve("butterfly", scale=10), mill(300.0)),
    "circle": (lambda: load_curve("circle"), mill()),
    "butterfly-nurbs": (lambda: load_curve("butterfly-nurbs"), mill(250.0)),
    "flank": (lambda: load_curve("flank"), load_limits("five-axis")),
    "line and arc": (line_arc_line, mill()),
    "nanometre": (lambda: load_curve("circle", scale=1e-8), mill()),
    "100 km": (lambda: load_curve("circle", scale=1e6), mill()),
    "100 km line": (lambda: line(1e8), mill()),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    make, limits = CASES[request.param]
    curve = make()
    return curve, limits, *knotted(curve, limits)

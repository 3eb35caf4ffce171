"""Colours: each limit has its own, far from every other, and what one panel shows stays apart for every eye."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from planner.geometry.curve import AXES
from planner.machine.feed_limits import COMMANDS
from planner.output.palette import FAINT, dash_lengths, limit_colour
from planner.quantity import AXIS, FEED, limit_names, motion_names

NAMES = tuple(dict.fromkeys((*limit_names(AXES), *COMMANDS)))
# A difference of 2.3 is just noticeable between large fields side by side (Mahy et al. 1994).  Lines and small bars, some
# centimetres apart, need several times that: eight are asked for, and five in one panel for who sees two hues only, for
# whom the dashes of the lines differ as well.
APART = 8 * 2.3
APART_IN_A_PANEL = 5 * 2.3
PAPER = {False: "#ffffff", True: "#121518"}
GROUND = pytest.mark.parametrize("dark", [False, True])
ORDER = pytest.mark.parametrize("order", [quantity.order for quantity in AXIS], ids=[q.label for q in AXIS])
# Machado, Oliveira, Fernandes (2009), severity 1: what dichromats see, for linear RGB.
DICHROMATS = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def linear(colour):
    c = np.array(to_rgb(colour))
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIE Lab of linear sRGB, white D65."""
    x = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(one, other, seen=None):
    eye = np.eye(3) if seen is None else np.array(seen)
    return float(np.linalg.norm(lab(eye @ linear(one)) - lab(eye @ linear(other))))


def contrast(one, other):
    """Ratio of luminances as WCAG has it."""
    low, high = sorted(float(TO_XYZ[1] @ linear(colour)) + 0.05 for colour in (one, other))
    return high / low


def test_lab_is_that_of_known_colours():
    assert lab(linear("#ffffff")) == pytest.approx([100.0, 0.0, 0.0], abs=0.02)
    assert lab(linear("#ff0000")) == pytest.approx([53.24, 80.09, 67.20], abs=0.02)  # Lindbloom
    assert lab(linear("#0000ff")) == pytest.approx([32.30, 79.19, -107.86], abs=0.03)


@GROUND
def test_no_two_limits_have_one_colour(dark):
    assert len(NAMES) == len(limit_names(AXES)) + 2 == 1 + 4 + 3 * 9 + 2
    close = {
        (a, b): found
        for a, b in combinations(NAMES, 2)
        if (found := distance(limit_colour(a, dark=dark), limit_colour(b, dark=dark))) < APART
    }
    assert close == {}


@GROUND
@ORDER
def test_lines_of_one_panel_stay_apart_for_every_eye(dark, order):
    """Of all nine axes, and of the path, which shares the panel."""
    names = motion_names(order, AXES)
    assert len(names) == 9 + 1
    for eye, seen in DICHROMATS.items():
        close = {
            (a, b): found
            for a, b in combinations(names, 2)
            if (found := distance(limit_colour(a, dark=dark), limit_colour(b, dark=dark), seen)) < APART_IN_A_PANEL
        }
        assert close == {}, eye


@ORDER
def test_lines_of_one_panel_differ_in_their_dashes(order):
    names = motion_names(order, AXES)
    assert len({dash_lengths(name) for name in names if name != FEED.label}) == len(names) - (order == FEED.order)


@GROUND
def test_limits_show_on_their_ground(dark):
    for name in NAMES:
        if name != "none":
            assert contrast(limit_colour(name, dark=dark), PAPER[dark]) > 2.0, name
    assert contrast(FAINT, PAPER[False]) > 2.0


def test_an_axis_keeps_its_hue():
    for axis in AXES:
        hues = [lab(linear(limit_colour(q.of(axis)))) for q in AXIS]
        angles = np.unwrap([np.arctan2(b, a) for _, a, b in hues])
        assert np.ptp(angles) < np.radians(60.0), axis

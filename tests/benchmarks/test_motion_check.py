"""The dense check of a motion: it passes what is right, and finds what is planted."""

from dataclasses import replace

import numpy as np
import pytest
from joint_reference import arc_and_line, polygon, run_along, stopping_motion, turning

from benchmarks.motion_check import defects
from planner.joint.joint_run import JointMotion

SPACE = polygon([[0, 0, 0], [8, 2, 1], [6, 7, 4], [12, 9, -2]], 2e-2)
PLANE = turning(20.0, 135.0, 12.0, 1e-3)


@pytest.mark.parametrize("run", [SPACE, PLANE, turning(20.0, 90.0, 3.0, 1e-2), turning(0.2, 170.0, 0.5, 5e-2)])
def test_a_motion_that_stops_at_every_vertex_has_no_defect(run):
    assert defects(run, stopping_motion(run)) == []


def slowly_round(radius, angle, share):
    """A motion along an arc at the constant distance ``share`` of 10 um inside, not from rest."""
    run = arc_and_line(radius, angle, 1.0, 0.0, 1e-2)
    run = run_along(run.legs.taken(np.array([0])), run.lengths[:1], 1e-2)
    t = np.linspace(0.0, 1.0, 201)
    w = np.deg2rad(angle)
    r = radius - share * 1e-2
    sine, cosine = np.sin(w * t), np.cos(w * t)
    q = np.stack([r * sine, radius - r * cosine], axis=1)
    v = r * w * np.stack([cosine, sine], axis=1)
    a = r * w**2 * np.stack([-sine, cosine], axis=1)
    return run, JointMotion(t, q, v, a, np.diff(a, axis=0) / np.diff(t)[:, None], np.zeros(200, dtype=int))


@pytest.mark.parametrize(("share", "away"), [(0.99, False), (-0.99, False), (1.01, True), (-1.01, True)])
def test_distances_from_an_arc_are_those_of_its_radius(share, away):
    said = " ".join(defects(*slowly_round(6.0, 90.0, share)))
    assert ("away from block 0" in said) == away
    assert ("block 0 is 1.0" in said) == away


def shifted(motion, by):
    return replace(motion, position=motion.position + by)


def timed(motion, factor):
    """The same path, so many times faster."""
    return JointMotion(
        motion.t / factor,
        motion.position,
        motion.velocity * factor,
        motion.acceleration * factor**2,
        motion.jerk * factor**3,
        motion.leg,
    )


def changed(motion, name, at, by):
    """One number of a motion changed."""
    value = getattr(motion, name).copy()
    value[at] += by
    return replace(motion, **{name: value})


GOOD = stopping_motion(SPACE)
LAST = GOOD.leg.size
PLANTED = {
    "a path aside": (lambda m: shifted(m, [0.0, 0.0, 0.021]), "away from block"),
    "faster": (lambda m: timed(m, 1.00001), "jerk 1.0000"),
    "a velocity that jumps": (lambda m: changed(m, "velocity", (5, 1), 1e-3), "velocity jumps"),
    "a position that jumps": (lambda m: changed(m, "position", (5, 1), 1e-5), "position jumps"),
    "an acceleration that jumps": (lambda m: changed(m, "acceleration", (5, 2), 1e-3), "acceleration jumps"),
    "another jerk": (lambda m: changed(m, "jerk", (5, 0), 1.0), "jumps"),
    "moves at the start": (lambda m: changed(m, "velocity", (0, 0), 1e-3), "at the start, not at rest"),
    "accelerated at the end": (lambda m: changed(m, "acceleration", (LAST, 0), 1e-3), "at the end, not at rest"),
    "ends elsewhere": (lambda m: changed(m, "position", (LAST, 0), 1e-4), "the end is 0.0001 mm from that of the run"),
    "time turns back": (lambda m: changed(m, "t", 3, 1.0), "do not rise"),
    "a number that is none": (lambda m: changed(m, "jerk", (3, 1), np.nan), "jerk is not finite"),
    "a block left out": (lambda m: replace(m, leg=np.where(m.leg == 1, 2, m.leg)), "one block after the other"),
    "leaves a block too late": (
        lambda m: replace(m, leg=np.where(np.arange(LAST) == np.argmax(m.leg == 1), 0, m.leg)),
        "where it leaves it",
    ),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_defect_is_found(name):
    plant, said = PLANTED[name]
    assert said in "; ".join(defects(SPACE, plant(GOOD)))


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"velocity": np.full(3, 40.0)}, "velocity 1"),
        ({"acceleration": np.array([1000.0, 1000.0, 300.0])}, "acceleration 3.33"),
        ({"jerk": np.array([20000.0, 2000.0, 20000.0])}, "jerk "),
        ({"feed": np.array([100.0, 20.0, 100.0])}, "of the feed"),
    ],
)
def test_a_limit_is_held(limits, said):
    run = polygon([[0, 0, 0], [8, 2, 1], [6, 7, 4], [12, 9, -2]], 2e-2, **limits)
    assert said in "; ".join(defects(run, GOOD))


def cut_corner(depth):
    """A motion round a right angle: y begins so early that the path passes the corner at the distance ``depth``."""
    run = turning(20.0, 90.0, 20.0, 1e-2)
    first, second = (stopping_motion(polygon(p, 1.0)) for p in ([[0, 0], [20, 0]], [[0, 0], [0, 20]]))
    overlap = 2.0 * np.cbrt(6.0 * depth / np.sqrt(2.0) / 20000.0)  # each is J (overlap / 2)^3 / 6 from it halfway
    begin = first.duration - overlap
    times = np.unique(np.round(np.concatenate([first.t, second.t + begin, [begin + 0.5 * overlap]]), 12))
    x, y = first.at(np.clip(times, 0.0, first.t[-1])), second.at(np.clip(times - begin, 0.0, second.t[-1]))
    middle = 0.5 * (times[1:] + times[:-1])
    jerk = first.at(middle)[3] * (middle < first.duration)[:, None]
    jerk += second.at(np.maximum(middle - begin, 0.0))[3] * (middle > begin)[:, None]
    leg = (middle > begin + 0.5 * overlap).astype(int)
    return run, JointMotion(times, *(x + y)[:3], jerk, leg)


@pytest.mark.parametrize("share", [0.5, 0.999, 1.001, 1.2])
def test_a_corner_cut_too_deep_is_found_by_the_disc_and_by_the_distance_of_the_blocks(share):
    found = defects(*cut_corner(share * 1e-2))
    if share < 1.0:
        assert found == []
    else:
        said = "; ".join(found)
        assert f"{share:.4g}" in said
        assert "where it leaves it" in said
        assert "block 0 is" in said
        assert "block 1 is" in said

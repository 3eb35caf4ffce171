"""Formats of controllers: which file is of which, and what each is told of the axes."""

from __future__ import annotations

import numpy as np
import pytest

from feedplan.exports import EXPORT_SUFFIXES, export_format, export_plan, per_axis, require_own
from feedplan.job import load_job
from interp.pulse_file import read_pulses
from planner import BrokenLimitError, InputError, load_limits


class TestFormats:
    @pytest.mark.parametrize(
        ("name", "kind", "found"),
        [
            ("a.fpr", None, "fpr"),
            ("a.csv", None, "csp"),
            ("a.NPZ", None, "csp"),
            ("a.yaml", None, "ros"),
            ("a.yml", None, "ros"),
            ("a.steps", None, "steps"),
            ("a.csv", "steps", "steps"),
            ("a", "ros", "ros"),
        ],
    )
    def test_by_suffix_or_name(self, name, kind, found):
        assert export_format(name, kind) == found

    @pytest.mark.parametrize(
        ("name", "kind", "message"),
        [
            (
                "a.foo",
                None,
                r'a\.foo: the suffix "\.foo" is of no format; they are fpr \(\.fpr\), csp \(\.csv \.npz\), ros',
            ),
            ("a", None, 'the suffix "" is of no format'),
            ("a.csv", "ros", r'the suffix "\.csv" of the format ros must be \.yaml or \.yml'),
            ("a.csv", "gcode", "format = 'gcode' must be one of fpr"),
        ],
    )
    def test_others_are_refused(self, name, kind, message):
        with pytest.raises(InputError, match=message):
            export_format(name, kind)

    def test_options_of_another_format_are_refused(self):
        require_own("csp", {"counts_per_mm": "3", "steps_per_mm": None, "velocity_offset": False})
        with pytest.raises(InputError, match="--steps-per-mm is for the format steps; this file is of the format csp"):
            require_own("csp", {"steps_per_mm": "3"})
        with pytest.raises(InputError, match=r"--velocity-offset is for the format csp; .* ros"):
            require_own("ros", {"velocity_offset": True})


class TestPerAxis:
    AXES = ("X", "Y", "C")

    def test_one_number_or_one_each(self):
        assert per_axis("100", "7", self.AXES, "steps") == {"X": 100.0, "Y": 100.0, "C": 7.0}
        assert per_axis("Y=2, X=1e3", 5.0, self.AXES, "steps") == {"X": 1000.0, "Y": 2.0, "C": 5.0}
        assert per_axis(None, "C=2", ("C",), "steps") == {"C": 2.0}

    @pytest.mark.parametrize(
        ("mm", "rad", "message"),
        [
            (
                None,
                "1",
                "steps per mm of X, Y are missing; give them with --steps-per-mm, one number for all or X=...,Y=...",
            ),
            ("X=1", "1", "steps per mm of Y are missing"),
            ("1", None, "steps per rad of C are missing; give them with --steps-per-rad"),
            ("X=1,Y=2,Z=3", "1", "--steps-per-mm: Z is none of its axes; they are X Y"),
            ("X=1,Y=2,C=3", "1", "--steps-per-mm: C is none of its axes; they are X Y"),
            ("X=1,X=2,Y=1", "1", "--steps-per-mm = X=1,X=2,Y=1 says X twice"),
            ("many", "1", '--steps-per-mm = "many" must be a number, or numbers by axis as X=1000,Y=800'),
            ("X=1,Y=", "1", "must be a number"),
            ("", "1", "must be a number"),
            ("nan", "1", "must be a number"),
        ],
    )
    def test_what_is_wrong_is_named(self, mm, rad, message):
        with pytest.raises(InputError) as caught:
            per_axis(mm, rad, self.AXES, "steps")
        assert message in str(caught.value)


@pytest.fixture(scope="module")
def judged():
    job = load_job("circle", "mill")
    profile = job.plan(intervals=200)
    return job, job.judge(profile)


OPTIONS = {"fpr": {}, "csp": {"counts_per_mm": "1e4"}, "ros": {}, "steps": {"steps_per_mm": "X=100,Y=200"}}


@pytest.mark.parametrize("kind", EXPORT_SUFFIXES)
def test_every_format_is_written_and_said(judged, tmp_path, kind):
    file = tmp_path / f"part{EXPORT_SUFFIXES[kind][0]}"
    told = []
    done = export_plan(*judged, file, kind, lambda text, _share=None: told.append(text), **OPTIONS[kind])
    assert file.stat().st_size > 1000
    assert told == [f"writing {file}"]
    assert done.text
    assert done.facts
    if kind == "steps":
        assert len(read_pulses(file).pulses) == sum(done.facts["pulses"])


@pytest.mark.parametrize("kind", EXPORT_SUFFIXES)
def test_nothing_is_written_of_a_plan_that_breaks_a_limit(judged, tmp_path, kind):
    """The plan, checked under lower limits."""
    job, verdict = judged
    lower = load_job("circle", load_limits("mill").with_feed(30.0))
    broken = lower.judge(verdict.profile)
    assert not broken.ok
    with pytest.raises(BrokenLimitError, match=r"not written: the plan .*plan again within the limits"):
        export_plan(lower, broken, tmp_path / f"part{EXPORT_SUFFIXES[kind][0]}", kind, lambda *_: None, **OPTIONS[kind])
    assert list(tmp_path.iterdir()) == []
    assert np.isfinite(job.curve.length)

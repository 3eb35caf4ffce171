"""Verdict, report, line times, bound: tables for pandas, and two lines for a person."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from cases import PROGRAMS

import feedplan
from feedplan.job import load_job
from planner.programs.times import KINDS


@pytest.fixture(scope="module")
def job():
    return load_job(PROGRAMS / "slots.ngc", "mill")


@pytest.fixture(scope="module")
def verdict(job):
    return job.run(intervals=400)


@pytest.fixture(scope="module")
def lines(job, verdict):
    return job.line_times(verdict.profile)


def test_line_times(lines, tmp_path):
    frame = lines.to_frame()
    assert frame["seconds"].sum() == pytest.approx(lines.moving, rel=1e-12)
    assert list(frame["kind"]) == [KINDS[kind] for kind in lines.kind]
    assert list(frame["held_back_by"]) == [lines.limit_names[k] for k in lines.binding]
    pd.testing.assert_frame_equal(pd.DataFrame(lines), frame, check_dtype=False)  # of small integers
    feedplan.write_line_times(tmp_path / "lines.csv", lines, "slots.ngc", "holds")
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "lines.csv", comment="#"), frame, check_exact=True, check_dtype=False
    )


def test_report(verdict):
    report = verdict.plan_report
    frame = report.to_frame()
    assert list(report) == list(report.rows)
    assert list(frame["ratio"]) == [row.ratio for row in report.rows]
    assert list(frame["ok"]) == [row.ok for row in report.rows]
    pd.testing.assert_frame_equal(pd.DataFrame(report), frame)


def test_verdict(verdict):
    frame = verdict.to_frame()
    assert list(frame["limit"].unique()[:3]) == ["feed", "programmed feed", "chord error"]
    jerk = frame[(frame["limit"] == "jerk") & (frame["axis"] == "X")].iloc[0]
    assert jerk["plan"] == verdict.plan_report.row("jerk", "X").ratio
    assert jerk["samples"] == verdict.samples_report.row("jerk", "X").ratio
    assert jerk["allowed"] == verdict.limits.jerk[0]
    assert frame["ok"].all()
    pd.testing.assert_frame_equal(pd.DataFrame(verdict), frame)


def test_two_lines_each(verdict, lines, job):
    bound = feedplan.certify(job.curve, job.limits, verdict.profile)
    for result in (verdict, verdict.plan_report, lines, bound):
        text = repr(result).splitlines()
        assert len(text) <= 2
        assert max(map(len, text)) <= 80
        assert text[0].startswith(f"{type(result).__name__}(")
    assert f"{verdict.profile.duration:.6g} s" in repr(verdict)
    for result in (verdict, verdict.plan_report, lines):
        assert "<table>" in result._repr_html_()


def test_what_is_no_table_is_short_too(job, verdict):
    """Of a program with many arrays, and of what was made of it."""
    bound = feedplan.certify(job.curve, job.limits, verdict.profile)
    for name in (*feedplan.CATALOG, job.curve):
        curve = feedplan.load_curve(name) if isinstance(name, str) else name
        assert f"({curve.name}: {curve.length:.6g} mm, axes {' '.join(curve.axes)}," in repr(curve)
    for result in (job, job.curve, job.program, job.path, bound.certificate, feedplan.load_curve("butterfly-nurbs")):
        text = repr(result).splitlines()
        assert len(text) <= 2
        assert max(map(len, text)) <= 80
        assert text[0].startswith(f"{type(result).__name__}(")
    assert " -" not in repr(verdict.samples)


def test_a_bound_is_still_a_number(job, verdict):
    bound = feedplan.certify(job.curve, job.limits, verdict.profile)
    assert json.loads(json.dumps({"s": bound}))["s"] == float(bound)
    assert f"{bound:.6g}" == f"{float(bound):.6g}"
    assert np.float64(bound) == float(bound)

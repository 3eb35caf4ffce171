"""The report as a page: its numbers are those of the plan, it loads nothing, and a browser draws it without an error."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest
from cases import PROGRAMS
from motions import line_of_a_program, plan_along, scurve

import feedplan.page
import interp
from feedplan.cli import app
from feedplan.job import load_job
from feedplan.page import require_report, write_report
from feedplan.playback import Playback, PlayedLines
from feedplan.slow_corner import slowest_corner
from feedplan.tolerances import ToleranceTime, time_of_tolerances, tolerance_facts
from feedplan.verdict import Verdict, to_json
from planner import InputError, Limits, Samples, __version__, check, load_curve, load_limits, write_table
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.feed_limits import COMMANDS
from planner.output.corner_view import plot_corner
from planner.output.figures import svg_of
from planner.output.palette import SERIES, dash_lengths, limit_colour
from planner.profile import make_profile
from planner.programs.program_text import ProgramText
from planner.programs.times import LineTimes, times_at
from planner.verify import Report

SLOTS = PROGRAMS / "slots.ngc"
FEED, ACCELERATION, JERK = 100.0, 1000.0, 20000.0
LIMITS = Limits(120.0, [250.0, 250.0], [1500.0, 2000.0], [25000.0, np.inf], chord_error=1e-3, period=2e-3)
CIRCLE = load_curve("circle")
RADIUS = 50.0
FORTIETHS = CIRCLE.arclength.u(np.linspace(0.0, CIRCLE.length, 41))  # ends of forty lines of one length
MOTION = scurve(CIRCLE.length, FEED, ACCELERATION, JERK)
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
IN_BROWSER = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed (apt-get install chromium)")
AT = 1.2345  # where the pointer is, s
NASTY = "</script><script>document.title='caught'</script><b>&\"'"


def judged(profile, limits=LIMITS, **facts):
    samples = interp.replay(profile.curve, profile, limits.period)
    reports = [check(profile.curve, limits, plan) for plan in (profile, samples)]
    return Verdict(profile, limits, "mill.toml", samples, *reports, **facts)


def lines_along(profile, u, *, dwell=False):
    """Lines 10, 12, 14, ... between the parameters u, each with the time the plan takes for it."""
    count, t = u.size - 1, times_at(profile, u)
    return LineTimes(
        line=10 + 2 * np.arange(count),
        kind=np.full(count, 2, dtype=np.int8),
        length=np.diff(profile.curve.arclength.s(u)),
        u_start=u[:-1].copy(),
        u_end=u[1:].copy(),
        seconds=np.diff(t),
        binding=np.full(count, 1, dtype=np.int8),
        share=np.full(count, 0.5),
        dwell=np.where(dwell & (np.arange(count) == 3), 0.25, 0.0),
        tool_changes=np.zeros(count, dtype=np.int8),
        rest=np.where(dwell & (np.arange(count) == 3), 0.25, 0.0),
        limit_names=profile.limit_names,
        start=t[:-1].copy(),
        end=np.zeros((count, 9)),
        feed=np.full(count, FEED),
        highest_feed=np.full(count, FEED),
    )


def facts_of(path):
    """What is embedded in a page."""
    found = re.findall(r'<script id="facts" type="application/json">(.*?)</script>', path.read_text("utf-8"), re.DOTALL)
    assert len(found) == 1
    return json.loads(found[0])


def unpacked(packed):
    kinds = {"float64": "<f8", "float32": "<f4", "int32": "<i4", "int8": "|i1"}
    return np.frombuffer(base64.b64decode(packed["data"]), kinds[packed["type"]])


@pytest.fixture(scope="module")
def profile():
    return plan_along(CIRCLE, MOTION, LIMITS)


@pytest.fixture(scope="module")
def verdict(profile):
    return judged(profile, planning_time=0.25)


@pytest.fixture(scope="module")
def page(tmp_path_factory, verdict):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, verdict, lines=lines_along(verdict.profile, FORTIETHS, dwell=True))
    return path


@pytest.fixture(scope="module")
def facts(page):
    return facts_of(page)


@pytest.fixture(scope="module")
def bought(tmp_path_factory):
    """A program's plan, what its tolerance buys, one that has no plan among them, and the page of both."""
    path = tmp_path_factory.mktemp("bought") / "r.html"
    job = load_job(SLOTS, "mill")
    profile = job.plan()
    verdict = job.judge(profile)
    rows = (*time_of_tolerances(SLOTS, "mill", (0.02, 0.001)), ToleranceTime(0.05, reason=NASTY))
    write_report(path, verdict, tolerances=rows)
    return verdict, rows, path


class TestNumbers:
    def test_feed_acceleration_and_jerk_are_those_of_the_motion(self, facts, profile):
        t = unpacked(facts["plan"]["t"])
        low = {name: unpacked(values) for name, values in facts["plan"]["low"].items()}
        assert not facts["plan"]["thinned"]
        assert (t[0], t[-1]) == (0.0, profile.duration)
        assert np.all(np.diff(t) > 0.0)
        s, feed, acceleration, _ = MOTION(t)
        assert low["feed"] == pytest.approx(feed, abs=1e-4)
        assert low["acceleration"] == pytest.approx(acceleration, abs=0.02)
        assert low["jerk"] == pytest.approx(profile.at(t).jerk, rel=1e-6, abs=0.1)
        assert np.abs(low["jerk"]).max() == pytest.approx(JERK, rel=1e-3)
        assert unpacked(facts["plan"]["s"]) == pytest.approx(s, abs=1e-4)
        assert unpacked(facts["plan"]["u"]) == pytest.approx(profile.at(t).u, abs=1e-12)

    def test_the_axes_use_shares_of_their_limits(self, facts, profile):
        t = unpacked(facts["plan"]["t"])
        h = 1e-4
        inner = (t > 2 * h) & (t < profile.duration - 2 * h)
        at = t[inner]
        positions = [CIRCLE.derivatives(profile.at(at + k * h).u, 0)[0] for k in (-1, 0, 1)]
        second = (positions[2] - 2.0 * positions[1] + positions[0]) / h**2
        for j, axis in enumerate("XY"):
            share = unpacked(facts["plan"]["low"][f"acceleration {axis}"])[inner]
            assert share == pytest.approx(second[:, j] / LIMITS.acceleration[j], abs=2e-3)
        assert "jerk X" in facts["plan"]["low"]
        assert "jerk Y" not in facts["plan"]["low"]  # has no limit

    def test_the_path_lies_on_the_circle(self, facts):
        x, y = (unpacked(column) for column in facts["plan"]["position"])
        assert np.hypot(x - RADIUS, y) == pytest.approx(RADIUS, abs=1e-4)
        assert np.ptp(x) == pytest.approx(2.0 * RADIUS, abs=1e-2)

    def test_limits_on_the_feed(self, facts):
        low = {name: unpacked(values) for name, values in facts["plan"]["low"].items()}
        assert set(low["feed limit"]) == {np.float32(LIMITS.feed)}
        # the normal acceleration v^2/r is all on one axis four times a turn
        top = np.sqrt(LIMITS.acceleration.max() * RADIUS)
        assert low["limit at steady feed"].min() == pytest.approx(np.sqrt(LIMITS.acceleration.min() * RADIUS), rel=1e-3)
        assert low["limit at steady feed"].max() >= top

    def test_chord_error_is_the_sagitta_of_a_period(self, facts, verdict):
        error = unpacked(facts["chords"]["low"]["chord error"])
        assert error.size == verdict.samples.t.size - 1
        sagitta = RADIUS * (1.0 - np.cos(0.5 * FEED * LIMITS.period / RADIUS))
        assert error.max() == pytest.approx(sagitta, rel=1e-3)

    def test_what_binds_adds_up_to_the_shares(self, facts, profile):
        t, binding = unpacked(facts["plan"]["t"]), unpacked(facts["plan"]["binding"])
        for name, share in profile.shares().items():
            held = np.diff(t)[binding[:-1] == profile.limit_names.index(name)].sum()
            assert held / profile.duration == pytest.approx(share, abs=0.01)
        assert facts["limit_names"] == list(profile.limit_names)

    def test_the_verdict_is_all_there(self, facts, verdict):
        said = json.loads(to_json(verdict))
        assert {key: facts[key] for key in said} == said
        assert facts["limits"] == {"feed": 120.0, "acceleration": None, "jerk": None, "chord error": 1e-3}
        assert facts["version"] == __version__

    def test_sensitivities_and_origin(self, tmp_path, profile):
        told = dataclasses.replace(profile, saved_by_one_percent={"feed": 0.016, "jerk X": 0.003})
        write_report(tmp_path / "r.html", judged(told, facts=(("program", "45 lines"),)))
        found = facts_of(tmp_path / "r.html")
        assert found["saved_by_one_percent_s"] == {"feed": 0.016, "jerk X": 0.003}
        assert found["origin"] == [["program", "45 lines"]]
        assert found["lines"] is None

    def test_a_rotary_machine_shows_the_tip(self, tmp_path):
        curve = NurbsCurve([[0, 0], [20, 1], [40, 0], [60, 2]], [0, 0, 0, 0, 1, 1, 1, 1], 3, axes=("X", "C"))
        limits = load_limits("five-axis").for_curve(curve)
        write_report(
            tmp_path / "r.htm", judged(plan_along(curve, scurve(curve.length, 20.0, 100.0, 2000.0), limits), limits)
        )
        found = facts_of(tmp_path / "r.htm")
        assert found["tip_axes"] == list(curve.tip.axes)
        assert len(found["plan"]["position"]) == curve.tip.dim

    def test_the_same_plan_gives_the_same_page(self, tmp_path, verdict):
        for name in ("a.html", "b.html"):
            write_report(tmp_path / name, verdict)
        assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


class TestColours:
    def test_every_limit_has_those_of_the_figures(self, facts, profile):
        names = {*profile.limit_names, *COMMANDS}
        assert set(facts["colours"]) == set(facts["dashes"]) == names
        for name in names:
            assert facts["colours"][name] == [limit_colour(name), limit_colour(name, dark=True)]
            assert facts["dashes"][name] == list(dash_lengths(name))

    def test_what_the_page_reads_is_handed_over(self, facts):
        """Names of the page's program that stand behind "facts.": a slip there would show in a browser only."""
        script = resources.files("feedplan").joinpath("page.html").read_text(encoding="utf-8")
        read = set(re.findall(r"\bfacts\.(\w+)", script))
        assert len(read) > 15
        assert read - set(facts) == {"program"}  # which the page asks for before it reads on
        for part in ("curve", "plan", "chords", "lines"):
            inner = set(re.findall(rf"\bfacts\.{part}\.(\w+)", script))
            assert inner <= set(facts[part]), part


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """What a page of a program knows."""
    profile, limits = line_of_a_program()
    path = tmp_path_factory.mktemp("program") / "r.html"
    write_report(path, judged(profile, limits))
    return facts_of(path)


class TestPrograms:
    def test_rapids_and_f_words(self, program):
        plan = program["plan"]
        t, rapid = unpacked(plan["t"]), unpacked(plan["rapid"])
        assert np.array_equal(rapid, (t > 5.0) & (t < 5.5))
        x = unpacked(plan["position"][0])
        wanted = np.where(rapid, np.nan, np.where(x < 150.0, 20.0, 30.0))
        assert unpacked(plan["low"]["programmed feed"]) == pytest.approx(wanted, nan_ok=True)
        assert unpacked(plan["low"]["feed"]).max() == pytest.approx(200.0)

    def test_axes_use_shares_of_their_velocity(self, program):
        share = unpacked(program["plan"]["low"]["velocity X"])
        assert {round(float(value), 6) for value in share} == {20.0 / 400.0, 200.0 / 400.0}

    def test_other_curves_have_neither(self, facts):
        assert facts["plan"]["rapid"] is None
        assert "programmed feed" not in facts["plan"]["low"]


class TestLines:
    def test_the_line_at_every_time(self, facts, profile):
        found = facts["lines"]
        start = np.cumsum(unpacked(found["step"]).astype(float))
        assert unpacked(found["first"]).tolist() == [10 + 2 * k for k in range(40)]
        assert found["last"] is None
        s = np.linspace(0.0, CIRCLE.length, 41)[:-1]
        assert MOTION(start)[0] == pytest.approx(s, abs=1e-3)
        assert (found["count"], found["dwell"], found["tool_changes"]) == (40, 0.25, 0)
        assert found["seconds"] == pytest.approx(profile.duration, rel=1e-12)

    def test_the_longest_lines_come_first(self, facts, profile):
        top = facts["lines"]["top"]
        assert top["line"][0] == 16  # the dwell counts
        total = np.array(top["seconds"]) + top["dwell"]
        assert np.all(np.diff(total) <= 0.0)
        assert np.array(top["end"]) - top["start"] == pytest.approx(np.array(top["seconds"]), abs=1e-9)
        assert sum(top["length"]) == pytest.approx(CIRCLE.length)

    def test_very_many_lines_share_entries(self, tmp_path, monkeypatch, verdict):
        monkeypatch.setattr(feedplan.page, "_MAX_LINES", 15)
        monkeypatch.setattr(feedplan.page, "_TOP_LINES", 7)
        write_report(tmp_path / "r.html", verdict, lines=lines_along(verdict.profile, FORTIETHS))
        found = facts_of(tmp_path / "r.html")["lines"]
        assert found["group"] == 3
        assert unpacked(found["first"]).tolist() == [10 + 6 * k for k in range(14)]
        assert unpacked(found["last"]).tolist() == [*(14 + 6 * k for k in range(13)), 88]
        assert len(found["top"]["line"]) == 7
        assert found["count"] == 40

    def test_lines_of_another_plan_are_refused(self, tmp_path, verdict):
        lines = dataclasses.replace(lines_along(verdict.profile, FORTIETHS), limit_names=("none", "feed"))
        with pytest.raises(InputError, match="the lines are of another plan than circle"):
            write_report(tmp_path / "r.html", verdict, lines=lines)
        assert list(tmp_path.iterdir()) == []


class TestTolerances:
    def test_the_plan_and_what_others_take(self, bought):
        verdict, rows, page = bought
        now = ToleranceTime.of(verdict.program, verdict.profile, verdict.plan_report)
        found = facts_of(page)["tolerances"]
        assert found["now"]["seconds"] == verdict.profile.duration
        assert found["rows"] == tolerance_facts(now, sorted(rows, key=lambda row: row.tolerance))
        assert [row["tolerance_mm"] for row in found["rows"]] == [0.001, 0.02, 0.05]

    def test_a_curve_has_none(self, tmp_path, verdict, bought):
        with pytest.raises(InputError, match="circle has no tolerance to choose; that needs a part program"):
            write_report(tmp_path / "r.html", verdict, tolerances=bought[1])
        write_report(tmp_path / "r.html", verdict)
        assert facts_of(tmp_path / "r.html")["tolerances"] is None


@pytest.fixture(scope="module")
def cornered(tmp_path_factory):
    """The page of a program with a sharp corner, and that corner."""
    folder = tmp_path_factory.mktemp("cornered")
    (folder / "c.ngc").write_text("G21 G90 G64 P0.01\nF6000\nG0 X0 Y0\nG1 X20\nY20\nM2\n")
    job = load_job(folder / "c.ngc", "mill")
    profile = job.plan()
    slow = slowest_corner(job, profile)
    write_report(folder / "r.html", job.judge(profile), corner=slow)
    return folder / "r.html", slow


class TestPlayback:
    def test_frames_are_those_of_the_plan(self, facts, profile):
        found, frames = facts["playback"], Playback.of(profile, feedplan.page._MAX_FRAMES)
        assert unpacked(found["t"]).tolist() == frames.t.tolist()
        position = np.stack([unpacked(column) for column in found["position"]], axis=1)
        assert position == pytest.approx(frames.position, rel=1e-6)
        assert unpacked(found["feed"]) == pytest.approx(frames.feed, rel=1e-6)
        assert (found["position_error_mm"], found["feed_error_mm_s"]) == (frames.position_error, frames.feed_error)

    def test_a_program_has_text_and_feed_of_its_lines(self, tmp_path):
        file = tmp_path / "umlaut.ngc"
        file.write_bytes(
            "N1 G21 G90 G64 P0.01\nN2 G0 X0 Y0\nN30 G1 X20 F1200 (f\u00fcr </script> & <b>)\nG0 Y9\nM2\n".encode(
                "cp1252"
            )
        )
        assert command_line("plan", file, "--report", tmp_path / "r.html") == 0
        lines = facts_of(tmp_path / "r.html")["lines"]
        assert unpacked(lines["first"]).tolist() == [3, 4]
        assert unpacked(lines["feed"]).tolist() == [20.0, np.inf]
        assert unpacked(lines["text"]["number"]).tolist() == [3, 4]
        assert lines["text"]["text"] == ["N30 G1 X20 F1200 (f\u00fcr </script> & <b>)", "G0 Y9"]
        assert lines["text"]["n_word"] == ["N30", ""]

    def test_without_their_times_no_lines_are_played(self, tmp_path, verdict):
        played = PlayedLines(np.zeros(1), np.ones(1, dtype=int), np.ones(1), ProgramText(b"G1 X1"))
        with pytest.raises(InputError, match="the lines of circle are to be played, but their times are not given"):
            write_report(tmp_path / "r.html", verdict, played=played)


class TestCorner:
    def test_the_page_has_its_picture(self, cornered):
        page, slow = cornered
        found = facts_of(page)["corner"]
        assert (found["lines"], found["lost_s"], found["turn"]) == (list(slow.lines), slow.lost, slow.corner.turn)
        kind, _, data = found["picture"].partition(";base64,")
        assert kind == "data:image/svg+xml"
        assert base64.b64decode(data) == svg_of(plot_corner(slow.corner))
        assert len(data) < 250_000

    def test_other_pages_have_none(self, facts):
        assert facts["corner"] is None

    def test_plan_and_report_show_it(self, tmp_path, cornered):
        program, table = cornered[0].parent / "c.ngc", tmp_path / "t.csv"
        pages = [tmp_path / name for name in ("plan.html", "report.html")]
        for words in (("plan", program, "--machine", "mill", "-o", table, "--report", pages[0]),
                      ("report", table, program, "-o", pages[1])):  # fmt: skip
            with pytest.raises(SystemExit) as stop:
                app([str(word) for word in words], prog_name="feedplan")
            assert not stop.value.code
        found = [facts_of(page)["corner"] for page in pages]
        assert [corner["lines"] for corner in found] == [[4, 5], [4, 5]]
        pictures = [base64.b64decode(corner["picture"].partition(",")[2]).decode() for corner in found]
        # Beside a joint path the page of a table shows the one that is made before its feed.
        assert [picture.count(SERIES[1].lower()) > 2 for picture in pictures] == [False, True]


def command_line(*words):
    """Exit code of a command."""
    with pytest.raises(SystemExit) as stop:
        app([str(word) for word in words], prog_name="feedplan")
    return stop.value.code or 0


class _Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))


class TestPage:
    def test_nothing_is_loaded(self, page):
        text = page.read_text("utf-8")
        outside = (
            r"https?:",
            "@import",
            r"url\(",
            r"\bfetch\(",
            "XMLHttpRequest",
            "WebSocket",
            r"\bimport\(",
            "sendBeacon",
        )
        assert [pattern for pattern in outside if re.search(pattern, text)] == []
        tags = _Tags()
        tags.feed(text)
        assert {tag for tag, attributes in tags.found if "src" in attributes} == set()
        assert [attributes["href"] for _, attributes in tags.found if "href" in attributes] == ["data:,"]
        (policy,) = [a["content"] for _, a in tags.found if a.get("http-equiv") == "Content-Security-Policy"]
        assert policy.startswith("default-src 'none';")

    def test_names_end_no_element(self, tmp_path, profile):
        named = NurbsCurve([[0, 0], [20, 1], [40, 0], [60, 2]], [0, 0, 0, 0, 1, 1, 1, 1], 3, name=NASTY)
        plan = plan_along(named, scurve(named.length, 50.0, 500.0, 5000.0))
        limits = load_limits("mill").for_curve(named)
        told = dataclasses.replace(plan, notes=(NASTY,))
        write_report(tmp_path / "r.html", dataclasses.replace(judged(told, limits), machine=NASTY))
        found = facts_of(tmp_path / "r.html")
        assert (found["curve"]["name"], found["machine"], found["notes"]) == (NASTY, NASTY, [NASTY])
        tags = _Tags()
        tags.feed((tmp_path / "r.html").read_text("utf-8"))
        assert [tag for tag, _ in tags.found].count("script") == 2
        assert "b" not in [tag for tag, _ in tags.found]

    def test_a_million_lines_stay_below_15_mb(self, tmp_path):
        nodes, count, duration = 70_000, 1_000_000, 2000.0
        t = np.linspace(0.0, duration, nodes)
        span, w = np.ptp(CIRCLE.domain), 2.0 * np.pi * 400 / duration
        u = CIRCLE.domain[0] + span * (t / duration + 0.7 * (np.cos(w * t) - 1.0) / (w * duration))
        rate, change = span / duration * (1.0 - 0.7 * np.sin(w * t)), -span / duration * 0.7 * w * np.cos(w * t)
        profile = make_profile(CIRCLE, LIMITS, TimeLaw(t, u.clip(*CIRCLE.domain), rate, change), method="waves")
        at = np.linspace(0.0, duration, 100_000)
        samples = Samples(at[1], at, np.interp(at, t, profile.u), np.zeros((at.size, 2)))
        verdict = Verdict(profile, LIMITS, "mill", samples, Report(()), Report(()))
        edges = np.linspace(*CIRCLE.domain, count + 1)
        one = np.ones(count)
        lines = LineTimes(
            line=np.arange(1, count + 1), kind=one.astype(np.int8), length=one, u_start=edges[:-1].copy(),
            u_end=edges[1:].copy(), seconds=duration / count * one, binding=one.astype(np.int8), share=one.copy(),
            dwell=one.copy(), tool_changes=one.astype(np.int8), rest=one.copy(), limit_names=profile.limit_names,
            start=np.arange(count) * duration / count, end=np.zeros((count, 9)), feed=one.copy(), highest_feed=one.copy(),
        )  # fmt: skip
        text = ProgramText(b"".join(b"N%d G1 X%.4f Y%.4f Z%.4f\n" % (k, k, -k, k) for k in range(count)))
        played = PlayedLines(lines.start, lines.line, FEED * one, text)
        write_report(tmp_path / "r.html", verdict, lines=lines, played=played)
        size = (tmp_path / "r.html").stat().st_size
        assert 8e6 < size < 15e6
        found = facts_of(tmp_path / "r.html")
        assert found["lines"]["count"] == count
        # A group of lines has no text, and no feed, of its own.
        assert (found["lines"]["group"], found["lines"]["text"], found["lines"]["feed"]) == (5, None, None)
        assert 10_000 < unpacked(found["playback"]["t"]).size <= feedplan.page._MAX_FRAMES
        few = slice(0, 190_000)
        some = PlayedLines(lines.start[few], lines.line[few], FEED * one[few], text)
        assert feedplan.page._text_facts(some) is None
        assert (
            len(json.dumps(feedplan.page._text_facts(dataclasses.replace(some, line=some.line % 20_000 + 1)))) < 1.1e6
        )
        assert unpacked(found["plan"]["t"]).size >= 40_000
        assert np.abs(unpacked(found["plan"]["high"]["feed"])).max() == pytest.approx(profile.feed.max(), rel=1e-4)

    @pytest.mark.parametrize("dim", [2, 3, 5, 6])
    def test_the_bound_holds_for_any_number_of_axes(self, dim):
        points = feedplan.page._most_points(dim, min(dim, 3))
        # time, u, s, binding, rapid and place; twice six quantities of the path and three of each axis
        plan = points * (8 + 8 + 4 + 1 + 1 + 4 * min(dim, 3) + 2 * 4 * (6 + 3 * dim))
        chords = feedplan.page._MAX_CHORDS * (8 + 2 * 4)
        frames = feedplan.page._MAX_FRAMES * (8 + 4 * min(dim, 3) + 4)
        # first and last line, time, feed, and the number of a text
        assert feedplan.page._LINE_BYTES == 5 * 4
        assert feedplan.page._MAX_LINES * 4 * 4 * 4 / 3 < feedplan.page._LINES_BYTES
        assert points >= 20_000
        # which leaves 1 MB for the rest
        assert (plan + chords + frames) * 4 / 3 + feedplan.page._LINES_BYTES < 14e6

    def test_another_suffix_or_no_directory_is_refused(self, tmp_path, verdict):
        with pytest.raises(InputError, match=r'plan.pdf: the suffix "\.pdf" must be \.html or \.htm'):
            require_report(tmp_path / "plan.pdf")
        with pytest.raises(InputError, match="there is no directory"):
            write_report(tmp_path / "missing" / "plan.html", verdict)
        assert list(tmp_path.iterdir()) == []


class TestCommandLine:
    @pytest.fixture
    def run(self, capsys):
        def command(*arguments):
            with pytest.raises(SystemExit) as stop:
                app([str(argument) for argument in arguments], prog_name="feedplan")
            out, err = capsys.readouterr()
            return stop.value.code or 0, out, err

        return command

    def test_a_table_becomes_a_page(self, run, tmp_path, profile):
        write_table(tmp_path / "t.csv", profile, LIMITS)
        code, out, err = run("report", tmp_path / "t.csv", "circle", "-o", tmp_path / "r.html", "--json")
        facts = json.loads(out)
        assert (code, err) == (0 if facts["ok"] else 1, "")
        found = facts_of(tmp_path / "r.html")
        assert {key: found[key] for key in facts} == facts
        assert facts["files"] == [str(tmp_path / "r.html")]

    def test_plan_writes_one_beside_its_table(self, run, tmp_path):
        code, out, _ = run("plan", "teardrop", "--intervals", 60, "--report", tmp_path / "r.html")
        assert code == 0
        assert f"{facts_of(tmp_path / 'r.html')['duration_s']:.6g} s" in out
        assert facts_of(tmp_path / "r.html")["saved_by_one_percent_s"]["feed"] > 0.0

    def test_of_a_program_it_tells_what_the_tolerance_buys(self, run, tmp_path):
        assert run("plan", SLOTS, "-o", tmp_path / "t.csv")[0] == 0
        words = ("report", tmp_path / "t.csv", SLOTS, "-o", tmp_path / "r.html", "--tolerances-um", "20,1")
        assert run(*words)[0] == 0
        rows = facts_of(tmp_path / "r.html")["tolerances"]["rows"]
        wanted = time_of_tolerances(SLOTS, "mill", (0.001, 0.02))
        assert [row["seconds"] for row in rows] == pytest.approx([row.seconds for row in wanted], rel=1e-6)

    def test_a_curve_has_no_tolerance_to_choose(self, run, tmp_path, profile):
        write_table(tmp_path / "t.csv", profile, LIMITS)
        words = ("report", tmp_path / "t.csv", "circle", "-o", tmp_path / "r.html", "--tolerances-um", "20,1")
        code, _, err = run(*words)
        assert (code, err.partition(";")[0]) == (2, "error: circle has no lines")

    @pytest.mark.parametrize("command", [("report", "t.csv", "circle", "-o"), ("plan", "circle", "--report")])
    def test_a_bad_name_is_refused_before_the_work(self, run, command):
        code, out, err = run(*command, "report.pdf")
        assert (code, out) == (2, "")
        assert err == 'error: report.pdf: the suffix ".pdf" must be .html or .htm\n'


def opened(path, folder, *options, place=""):
    """Open a page in a headless browser; returns what it writes, after making sure that no script failed."""
    done = subprocess.run(
        [
            str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
            "--enable-logging=stderr", f"--user-data-dir={folder}/browser", "--window-size=1280,1000",
            "--virtual-time-budget=1000", *options, f"file://{path}{place}",
        ],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    return done.stdout


def text_of(dom, name):
    """Text of the element with this id."""
    found = re.search(rf'<(\w+)[^>]* id="{name}"[^>]*>(.*?)</\1>', dom, re.DOTALL)
    assert found, name
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", found[2]).replace("&nbsp;", " ")).strip()


TOOL = 2.3456  # where the tool is put, s
# Acts as a person would: drags over the first panel, turns the wheel, asks for a line, sorts the table, and plays.
ACTS = """
Element.prototype.setPointerCapture = () => {};
const panel = document.querySelector("#charts .plot"), box = panel.getBoundingClientRect(), seen = {};
const mouse = { pointerId: 1, pointerType: "mouse", bubbles: true, clientY: box.top + 20 };
const send = (kind, t) => {
  const clientX = box.left + LEFT + t / duration * (box.width - LEFT - RIGHT);
  panel.dispatchEvent(new PointerEvent(kind, { ...mouse, clientX }));
};
seen.readout = [...byId("readout").children].map((item) => item.textContent).join("\\n");
send("pointerdown", 1.0); send("pointermove", 1.5); send("pointermove", 2.0); send("pointerup", 2.0);
seen.dragged = [view.from, view.to];
const wheel = { deltaY: -100, ctrlKey: true, bubbles: true, cancelable: true, clientX: box.left + box.width / 2 };
panel.dispatchEvent(new WheelEvent("wheel", wheel));
seen.wheeled = view.to - view.from;
byId("over-time").dispatchEvent(new KeyboardEvent("keydown", { key: "0" }));
seen.all = [view.from, view.to];
byId("goto-line").value = 30;
byId("goto").dispatchEvent(new Event("submit", { cancelable: true }));
seen.line = [view.from, view.to];
byId("line-table").querySelector("th button").click();
seen.sorted = [...byId("line-table").tBodies[0].rows].map((row) => Number(row.cells[0].textContent));
byId("limits").tBodies[0].rows[0].click();
seen.limit = view.at;
seen.hidden = ["tolerances", "corner"].map((id) => getComputedStyle(byId(id)).display);
const shown = () => Object.fromEntries([...byId("tool").children].map((item) => item.textContent).map((text, k) =>
  [byId("tool").children[k].firstChild.textContent, byId("tool").children[k].lastChild.textContent]));
const key = (id, name, more = {}) =>
  byId(id).dispatchEvent(new KeyboardEvent("keydown", { key: name, ...more, bubbles: true }));
zoomTo(0, duration);
byId("time").value = String(TOOL);
byId("time").dispatchEvent(new Event("input"));
drawAll();
seen.slid = [view.tool, shown()];
key("playback", "ArrowRight"); seen.right = view.tool;
key("path", "ArrowLeft"); seen.left = view.tool;
key("path", "ArrowRight", { shiftKey: true }); seen.nextLine = view.tool;
key("path", "ArrowLeft", { shiftKey: true }); seen.lineBefore = view.tool;
key("playback", "End"); seen.end = view.tool;
send("pointerdown", 1.5); send("pointerup", 1.5); seen.clicked = view.tool;
const canvas = byId("path").getBoundingClientRect(), spot = parts[0].project(Math.floor(plan.t.length / 3));
for (const kind of ["pointerdown", "pointerup"])
  byId("path").dispatchEvent(
    new PointerEvent(kind, { ...mouse, clientX: canvas.left + spot[0], clientY: canvas.top + spot[1] }));
seen.onPath = [view.tool, plan.t[Math.floor(plan.t.length / 3)]];
byId("speed").value = "0.5"; byId("speed").dispatchEvent(new Event("change"));
toolTo(1.0);
key("playback", " ");
player.last = 0; playFrame(50); seen.played = [player.on, view.tool, byId("play").textContent];
toolTo(duration); playFrame(60); seen.stopped = [player.on, view.tool, byId("play").textContent];
zoomTo(1.0, 1.2); toolTo(2.0); seen.follows = [view.from, view.to];
document.body.dataset.seen = JSON.stringify(seen);
"""


@pytest.fixture(scope="module")
def dom(page):
    """The page of a curve with a nasty name, pointed at one time, after hands were on it."""
    folder = page.parent
    name = json.dumps(NASTY).replace("<", "\\u003c")
    text = page.read_text("utf-8").replace('"name":"circle"', f'"name":{name}')
    (folder / "handled.html").write_text(
        text.replace("</body>", f"<script>{ACTS.replace('TOOL', str(TOOL))}</script></body>"), "utf-8"
    )
    return opened(folder / "handled.html", folder, "--dump-dom", place=f"#at={AT}")


@pytest.fixture(scope="module")
def seen(dom):
    return json.loads(re.search(r'data-seen="([^"]*)"', dom)[1].replace("&quot;", '"'))


@IN_BROWSER
class TestBrowser:
    def test_everything_is_drawn_without_an_error(self, dom, profile):
        assert 'data-state="ready"' in dom
        assert dom.count("<canvas") == 2 * (1 + 1 + 7 + 1)  # path, overview, panels, lanes
        assert f"{profile.duration:.6g} s" in text_of(dom, "tiles")
        assert "acceleration Y 2000 mm/s²" in text_of(dom, "limits")

    def test_names_stay_text(self, dom):
        assert re.search(r"<title>(.*?)</title>", dom)[1].startswith("&lt;/script&gt;&lt;script&gt;")
        assert text_of(dom, "name").startswith("&lt;/script&gt;&lt;script&gt;")

    def test_what_is_under_the_pointer(self, seen, profile):
        state = profile.at(AT)
        names = ["t", "u", "s", "feed", "held back by", "line"]
        found = re.fullmatch(
            "".join(rf"{name}(?P<{name[0]}>.+?)(?: s| mm| mm/s)?\n" for name in names), seen["readout"] + "\n"
        )
        assert found, seen["readout"]
        numbers = [float(found[name]) for name in "tusf"]
        assert numbers == pytest.approx([AT, float(state.u), float(state.s), float(state.feed)], rel=1e-4)
        nearest = int(np.argmin(np.abs(profile.t - AT)))
        assert found["h"] == profile.limit_names[profile.binding[nearest]].replace("none", "no limit")
        assert int(found["l"]) == 10 + 2 * int(state.s / (CIRCLE.length / 40))

    def test_what_a_curve_has_not_is_not_there(self, seen):
        assert seen["hidden"] == ["none", "none"]

    def test_the_slowest_corner_is_drawn(self, cornered):
        page, slow = cornered
        dom = opened(page, page.parent, "--dump-dom")
        assert 'data-state="ready"' in dom
        before, behind = slow.lines
        assert f"Between lines {before} and {behind}, a turn of 90°" in text_of(dom, "corner-about")
        assert re.search(r'id="corner-picture"[^>]* src="data:image/svg', dom)

    def test_what_the_tolerance_buys_is_drawn(self, bought):
        verdict, rows, page = bought
        dom = opened(page, page.parent, "--dump-dom")
        assert 'data-state="ready"' in dom
        assert len(re.findall("<canvas", re.search(r'id="tolerance-plot".*?</div>', dom, re.DOTALL)[0])) == 2
        text = text_of(dom, "tolerance-table")
        assert f"10, now {verdict.profile.duration:.4f}" in text
        assert f"1 {rows[1].seconds:.4f} \N{MINUS SIGN}" in text
        assert "50 no plan" in text
        assert "<b>" not in re.search(r'id="tolerance-notes".*?</p>', dom, re.DOTALL)[0]

    def test_the_tool_is_where_the_slider_says(self, seen, profile):
        at, shown = seen["slid"]
        assert at == TOOL
        state = profile.at(TOOL)
        place = CIRCLE.derivatives(np.array([float(state.u)]), 0)[0][0]
        assert float(shown["time"].removesuffix(" s")) == pytest.approx(TOOL, abs=1e-4)
        feed, _, per_second = shown["feed"].partition(" mm/min, ")
        assert float(feed) == pytest.approx(60.0 * float(state.feed), abs=6.5)
        assert float(per_second.removesuffix(" mm/s")) == pytest.approx(float(state.feed), abs=0.11)
        numbers = [float(shown[axis].removesuffix(" mm").replace("\N{MINUS SIGN}", "-")) for axis in "XY"]
        assert numbers == pytest.approx(place, abs=2e-3)
        assert int(shown["line"]) == 10 + 2 * int(state.s / (CIRCLE.length / 40))
        nearest = int(np.argmin(np.abs(profile.t - TOOL)))
        assert shown["held back by"] == profile.limit_names[profile.binding[nearest]].replace("none", "no limit")

    def test_the_tool_goes_where_keys_and_clicks_put_it(self, seen, profile):
        step = 0.005 * profile.duration
        assert seen["right"] == pytest.approx(TOOL + step)
        assert seen["left"] == pytest.approx(TOOL)
        starts = times_at(profile, FORTIETHS)
        assert seen["nextLine"] == pytest.approx(starts[starts > TOOL][0], abs=1e-5)
        assert seen["lineBefore"] == pytest.approx(starts[starts < TOOL][-1], abs=1e-5)
        assert seen["end"] == profile.duration
        assert seen["clicked"] == pytest.approx(1.5, abs=0.01)
        assert seen["onPath"][0] == pytest.approx(seen["onPath"][1], abs=0.01)

    def test_it_plays_at_the_speed_that_is_set_and_stops_at_the_end(self, seen, profile):
        assert seen["played"] == [True, pytest.approx(1.0 + 0.5 * 0.05), "Pause"]
        assert seen["stopped"] == [False, profile.duration, "Play"]
        start, end = seen["follows"]
        assert end - start == pytest.approx(0.2)
        assert start < 2.0 < end

    def test_it_answers_to_hands(self, seen, profile):
        assert seen["dragged"] == pytest.approx([1.0, 2.0], abs=0.01)
        assert seen["wheeled"] == pytest.approx(1.0025**-100, rel=1e-3)
        assert seen["all"] == [0.0, profile.duration]
        start, end = times_at(profile, FORTIETHS[[10, 11]])
        assert seen["line"][0] < start < end < seen["line"][1]
        assert seen["line"][1] - seen["line"][0] < 1.5 * (end - start)
        assert seen["sorted"] == [10 + 2 * k for k in range(20)]
        assert seen["limit"] == pytest.approx(check(CIRCLE, LIMITS, profile).row("feed").t)

    @pytest.mark.parametrize(("dark", "paper"), [(False, (255, 255, 255)), (True, (18, 21, 24))])
    def test_the_path_is_drawn_by_feed_in_light_and_dark(self, page, tmp_path, dark, paper):
        from matplotlib.image import imread

        scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
        opened(page, page.parent, f"--screenshot={tmp_path}/shot.png", *scheme)
        pixels = np.round(255.0 * imread(tmp_path / "shot.png")[..., :3]).astype(int).reshape(-1, 3)
        assert np.array_equal(pixels[0], paper)
        # the fastest stretch is the largest part of the path, in the last colour of the ramp
        last = (253, 231, 37) if dark else (210, 226, 27)
        assert np.count_nonzero(np.abs(pixels - last).max(axis=1) <= 12) > 1000

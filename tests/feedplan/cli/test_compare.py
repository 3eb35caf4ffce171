"""The command that compares: what it prints and writes, and what it refuses."""

from __future__ import annotations

import csv
import io

import pytest
from pictures import width_of
from texts import strict_json


class TestCommand:
    METHODS = ("--methods", "algorithm-1,2002-bell-1,scurve,optimal")

    def test_table(self, run, tmp_path):
        target, figure = tmp_path / "result.json", tmp_path / "result.png"
        code, out, err = run("compare", "teardrop", "--machine", "mill", *self.METHODS, "-o", target, "--plot", figure)
        assert (code, err) == (0, "")
        table = out[: out.index("slowed down")].splitlines()
        lines = {line.split()[0]: line.split() for line in table if line.startswith(("algo", "2002", "opt"))}
        assert lines["optimal"][1:3] == ["1.1402", "nothing"]
        assert "J" in lines["algorithm-1"][2]
        assert "saves 0.7" in out
        assert "scurve" in out
        assert max(len(line) for line in out.splitlines() if not line.startswith("written")) <= 80
        assert figure.read_bytes().startswith(b"\x89PNG")
        facts = strict_json(target.read_text())
        assert [row["method"] for row in facts["methods"]] == ["algorithm-1", "2002-bell-1", "scurve", "optimal"]
        assert [row["verdict"] for row in facts["methods"]] == ["breaks", "breaks", "holds", "holds"]
        first = facts["methods"][0]
        assert first["machining_time_s"] == pytest.approx(13.482)
        assert first["points"] == 13483
        assert first["dilation_confirmed"]
        assert first["dilated_time_s"] == pytest.approx(first["dilation"] * first["machining_time_s"])
        assert first["jerk_ratio"] > 1.0
        assert facts["saving"]["saving"] == pytest.approx(0.007556, abs=2e-5)

    def test_stalled_method_has_its_reason_in_its_row(self, run):
        small = ("compare", "snailshell", "--scale", "0.001", "--methods", "algorithm-1,optimal")
        code, out, _ = run(*small)
        assert code == 0
        row = out[out.index("algorithm-1") : out.index("optimal   ")]
        assert "StalledError" in row
        assert "scale the curve up" in " ".join(row.split())
        code, out, _ = run(*small, "--json")
        stalled, optimal = strict_json(out)["methods"]
        assert code == 0
        assert (stalled["verdict"], stalled["machining_time_s"], stalled["dilation"]) == ("not run", None, None)
        assert "StalledError" in stalled["reason"]
        assert optimal["verdict"] == "holds"

    def test_a_program_has_a_row_for_its_other_path(self, run, tmp_path):
        file, target = tmp_path / "corner.ngc", tmp_path / "result.json"
        file.write_text("G21 G90 G64 P0.01\nF6000\nG0 X0 Y0\nG1 X20\nY20\nM2\n")
        code, out, err = run("compare", file, "--machine", "mill", "--methods", "optimal", "-o", target)
        assert (code, err) == (0, "")
        assert max(len(line) for line in out.splitlines() if not line.startswith("written")) <= 80
        lines = {line.split()[0]: line.split() for line in out.splitlines() if line.startswith(("optimal", "joint  "))}
        facts = strict_json(target.read_text())
        optimal, joint = facts["methods"]
        assert (joint["method"], joint["verdict"]) == ("joint", "holds")
        assert lines["joint"][1:3] == [f"{joint['machining_time_s']:.4f}", "nothing"]
        saved = 1.0 - joint["machining_time_s"] / optimal["machining_time_s"]
        assert facts["joint_path_saves"] == pytest.approx(saved)
        text = " ".join(out.split())
        assert f"leaves the program by {1e3 * joint['deviation_mm']:.4g} um at most" in text
        assert f"Finding path and feed together saves {100.0 * saved:.2f} %." in text

    def test_csv(self, run, tmp_path):
        target = tmp_path / "result.csv"
        code, _, _ = run(
            "compare", "snailshell", "--scale", "0.001", "--methods", "algorithm-1,2002-bell-2", "-o", target
        )
        rows = list(csv.DictReader(io.StringIO(target.read_text())))
        assert code == 1  # none of them holds
        assert [row["verdict"] for row in rows] == ["not run", "breaks"]
        assert rows[0]["machining_time_s"] == ""
        assert "jerk" in rows[1]["breaks"].split("; ")
        assert float(rows[1]["jerk_ratio"]) > 1.0

    def test_nothing_ran(self, run, tmp_path):
        figure = tmp_path / "result.png"
        code, out, _ = run("compare", "flank", "--methods", "algorithm-1", "--plot", figure)
        assert code == 3
        assert "rotary" in out
        assert not figure.exists()

    @pytest.mark.parametrize("methods", ["optimal", "scurve"])
    def test_figure_of_one_method(self, run, tmp_path, methods):
        figure = tmp_path / "result.svg"
        code, _, _ = run("compare", "snailshell", "--scale", "0.01", "--methods", methods, "--plot", figure)
        assert code == 0
        assert figure.read_text().count('<g id="axes_') == 2

    @pytest.mark.parametrize(
        ("options", "width", "panels"),
        [((), 180.0, 2), (("--width-mm", "85"), 85.0, 2), (("--width-mm", "120", "--panels", "jerk"), 120.0, 1),
         (("--panels", "feed"), 180.0, 1)],
    )  # fmt: skip
    def test_figure_is_as_asked_for(self, run, tmp_path, options, width, panels):
        for name in ("result.svg", "result.pdf"):
            figure = tmp_path / name
            short = ("compare", "snailshell", "--scale", "0.01", "--methods", "optimal")
            code, _, err = run(*short, "--plot", figure, *options)
            assert (code, err) == (0, "")
            assert width_of(figure) == pytest.approx(width, abs=0.01)
        assert (tmp_path / "result.svg").read_text().count('<g id="axes_') == panels

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (("--plot", "a.pdf", "--panels", "chord"), 'panels: "chord" is not one of feed, jerk'),
            (("--plot", "a.pdf", "--panels", "feed,feed"), 'panels: "feed" is given twice'),
            (("--plot", "a.pdf", "--width-mm", "79"), "a figure 79 mm wide is not possible: allowed is 80 to 420 mm"),
            (("--width-mm", "85"), "--width-mm says how a figure looks, and none is asked for; add --plot FILE"),
            (("--panels", "feed"), "--panels says how a figure looks, and none is asked for; add --plot FILE"),
        ],
    )
    def test_bad_figure(self, run, monkeypatch, tmp_path, options, message):
        monkeypatch.chdir(tmp_path)
        code, out, err = run("compare", "teardrop", *options)
        assert (code, out) == (2, "")
        assert err.startswith(f"error: {message}")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        "arguments",
        [("--methods", "fastest"), ("-o", "result.txt"), ("--plot", "result.txt"), ("--feed-mm-s", "-1")],
        ids=["method", "output", "plot", "feed"],
    )
    def test_bad_input(self, run, arguments):
        code, out, err = run("compare", "teardrop", *arguments)
        assert (code, out) == (2, "")
        assert err.startswith("error: ")

    def test_help_names_it_with_an_example(self, run):
        _, out, _ = run("--help")
        assert "feedplan compare " in out

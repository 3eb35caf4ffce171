"""The page for controllers: its header is the header, its example builds and runs, its pins are the component's."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from cases import PROJECT
from doc_pages import DOCS, blocks, key_tables

from feedplan import load_curve, load_limits, plan_feedrate
from interp.plan_file import write_plan_file

PAGE = DOCS / "controller.md"
COMPONENT = PROJECT / "interp" / "linuxcnc" / "feedplan_rt.comp"
STRICT = ("-std=c11", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wconversion")


def block(remark):
    return next(found for found in blocks(PAGE) if found.remark == remark)


def test_the_header_is_shown_in_full():
    assert block("header: interp/step.h").text == (PROJECT / "interp" / "step.h").read_text(encoding="utf-8")


def test_the_example_builds_and_runs(tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    example = block("file: example.c")
    shown = next(found for found in blocks(PAGE) if found.language == "text" and found.line > example.line)
    (tmp_path / "example.c").write_text(example.text, encoding="utf-8")
    body = example.text.partition("int main")[2]
    assert len(body.splitlines()) <= 30
    files = [str(tmp_path / "example.c"), str(PROJECT / "interp" / "step.c")]
    subprocess.run([compiler, *STRICT, f"-I{PROJECT}", *files, "-lm", "-o", str(tmp_path / "example")], check=True)
    curve = load_curve("butterfly-nurbs")
    limits = load_limits("mill").for_curve(curve)
    profile = plan_feedrate(curve, limits, override_reserve=0.1)
    write_plan_file(profile, tmp_path / "part.fpr", limits)
    done = subprocess.run(
        [str(tmp_path / "example"), str(tmp_path / "part.fpr")], check=True, capture_output=True, text=True
    )
    assert done.stdout == shown.text
    (tmp_path / "part.fpr").write_bytes((tmp_path / "part.fpr").read_bytes()[:-8])
    refused = subprocess.run(
        [str(tmp_path / "example"), str(tmp_path / "part.fpr")], check=False, capture_output=True, text=True
    )
    assert refused.returncode == 1
    assert "cut off" in refused.stderr


def test_every_pin_of_the_component_is_on_the_page():
    pins = re.findall(r"^pin (in|out) (\w+) ([\w#-]+)", COMPONENT.read_text(encoding="utf-8"), re.MULTILINE)
    own = {(f"feedplan-rt.{name.replace('_', '-').replace('#', 'N')}", kind, way) for way, kind, name in pins}
    shown = {(row[0], row[1], row[2]) for row in key_tables(PAGE)["pins"]}
    assert shown == own

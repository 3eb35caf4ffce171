"""What is installed is whole: the wheel holds every file of the packages, and runs from where it is unpacked."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from planner import core_source

ROOT = Path(__file__).parents[1]
PACKAGES = ("feedplan", "planner", "interp")
# Each names a file that is read at run time, and would be missed only then.
READ = """
import sys
sys.path.insert(0, sys.argv[1])
import feedplan
assert feedplan.__file__.startswith(sys.argv[1]), feedplan.__file__
from feedplan.cli.options import curve_names
from importlib import resources
for name in feedplan.CATALOG:
    assert feedplan.load_curve(name).length > 0.0
assert feedplan.load_limits("five-axis").dim == 5
assert feedplan.load_limits("mill").dim == 3
assert curve_names("tear") == ["teardrop"]
assert feedplan.plan_feedrate(feedplan.load_curve("circle"), feedplan.load_limits("mill"), intervals=40).duration > 3.0
assert "<html" in resources.files("feedplan").joinpath("page.html").read_text(encoding="utf-8")
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    builder = pytest.importorskip("hatchling.builders.wheel", reason="needs hatchling, of the extra dev").WheelBuilder
    (file,) = builder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])
    return Path(file)


def files_of(package):
    """All but what Python leaves behind."""
    found = (path for path in (ROOT / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(ROOT).as_posix() for path in found if path.suffix not in {".pyc"}}


def test_the_wheel_holds_every_file_of_the_packages(wheel):
    expected = set().union(*map(files_of, PACKAGES))
    read = {"feedplan/page.html", "planner/core.h", "planner/data/curve_facts.json", "interp/py.typed"}
    assert read <= expected
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        (script,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/entry_points.txt"))
    assert held == expected | {core_source.core_file(ROOT).relative_to(ROOT).as_posix()}
    assert "feedplan = feedplan.cli:main" in script


def test_the_wheel_is_for_this_platform_and_any_python(wheel):
    """The core is machine code, and knows nothing of Python."""
    assert re.fullmatch(r"feedplan-[\d.]+-py3-none-(?!any)\w+\.whl", wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        (said,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/WHEEL"))
    assert "Root-Is-Purelib: false" in said


def test_it_runs_from_where_it_is_unpacked(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    done = subprocess.run(
        [sys.executable, "-I", "-c", READ, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")

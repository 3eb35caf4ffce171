"""What is installed is whole: the wheel holds every file of the packages, and runs from where it is unpacked."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

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
    assert {"feedplan/page.html", "planner/data/curve_facts.json", "interp/py.typed"} <= expected
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        (script,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/entry_points.txt"))
    assert held == expected
    assert "feedplan = feedplan.cli:main" in script


def test_it_runs_from_where_it_is_unpacked(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    done = subprocess.run(
        [sys.executable, "-I", "-c", READ, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")

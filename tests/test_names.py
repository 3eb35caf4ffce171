"""One word for one thing: names of classes and functions, and MIN and MAX for bounds."""

import ast
import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = {package: sorted((ROOT / package).rglob("*.py")) for package in ("planner", "interp", "feedplan")}


def defined(paths, kind):
    """Where each name is defined at the top of a module."""
    found = defaultdict(set)
    for path in paths:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, kind):
                found[node.name].add(path.relative_to(ROOT).as_posix())
    return found


def twice(found):
    return {name: sorted(places) for name, places in found.items() if len(places) > 1}


def test_the_scan_sees_the_names():
    every = [path for paths in FILES.values() for path in paths]
    assert "planner/profile.py" in defined(every, ast.ClassDef)["FeedrateProfile"]
    assert defined(every, ast.FunctionDef)["chain_rule"] == {"planner/geometry/differential.py"}


def test_the_name_of_a_class_or_type_is_used_once_in_all_packages_private_ones_too():
    found = defaultdict(set)
    for path in (path for paths in FILES.values() for path in paths):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
            names = (
                [node.name] if isinstance(node, ast.ClassDef) else [t.id for t in targets if isinstance(t, ast.Name)]
            )
            for name in names:
                if re.match(r"_?[A-Z][a-z]", name):  # also what stands for a type: Place = tuple[float, float]
                    found[name.lstrip("_")].add(path.relative_to(ROOT).as_posix())
    assert {"FeedrateProfile", "FloatArray", "Side"} <= set(found)
    assert twice(found) == {}


def test_a_public_function_is_defined_once_in_its_package():
    repeated = {}
    for paths in FILES.values():
        # a command has the name of the function that it is about
        found = defined([path for path in paths if path.parent.name != "cli"], ast.FunctionDef)
        repeated |= twice({name: places for name, places in found.items() if not name.startswith("_")})
    assert repeated == {}


def test_a_module_has_a_name_of_its_own():
    """Among all packages, and none that of the room it stands in; only a command has that of what it runs."""
    places = defaultdict(set)
    for path in (path for paths in FILES.values() for path in paths):
        if path.stem not in {"__init__", "__main__"} and path.parent.name != "cli":
            places[path.stem].add(path.relative_to(ROOT).as_posix())
    assert len(places) > 100
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
    assert {name for name, found in places.items() for path in found if Path(path).parent.name == name} == set()


def test_bounds_are_called_min_and_max():
    bound = re.compile(r"^_?(LEAST|MOST|FEWEST|LARGEST|SMALLEST|HIGHEST|LOWEST|MINIMUM|MAXIMUM)_")
    named = {
        f"{path.relative_to(ROOT).as_posix()}: {target.id}"
        for paths in FILES.values()
        for path in paths
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for item in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for target in ast.walk(item)
        if isinstance(target, ast.Name) and bound.match(target.id)
    }
    assert named == set()

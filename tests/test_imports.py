"""Which room may import which, read from the source; and what importing the packages may load."""

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("planner", "interp", "feedplan")

# Every module stands in one of these rooms, and imports from the rooms before its own, or from its own.
ORDER = (
    "planner.version",
    "planner.data",
    "planner.errors",
    "planner.core_source",
    "planner.compiled",
    "planner.types",
    "planner.sets",
    "planner.gauss",
    "planner.frames",
    "planner.inputs",
    "planner.quantity",
    "planner.files",
    "planner.law",
    "planner.geometry",
    "planner.machine",
    "planner.joint",
    "planner.status",
    "planner.origin",
    "planner.samples",
    "planner.profile",
    "planner.certificate",
    "planner.verify",
    "planner.plan",
    "planner.programs",
    "planner.controllers",
    "planner.calibration",
    "planner.output",
    "interp",
    "feedplan",
)
# Beside the order: what a room may not reach although it stands before it, on whatever way.
APART = {
    "planner.verify": ("planner.plan",),
    "interp": ("planner.verify", "planner.plan", "planner.programs", "planner.output"),
    "planner.geometry": ("planner.files",),
    "planner.controllers": (
        "planner.plan",
        "planner.joint",
        "planner.verify",
        "planner.programs.path",
        "planner.programs.long",
        "planner.output",
    ),
}
DOORS = ("planner", "interp", "feedplan")  # they hand names on, each loaded when it is first used
HEAVY = ("casadi", "ezdxf", "toppra", "ruckig", "matplotlib", "scipy", "click", "rich", "pandas")


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))}


def resolve(name: str) -> str:
    """The module of ours that holds a dotted name, or the name itself."""
    while name not in MODULES and "." in name and name.split(".", maxsplit=1)[0] in PACKAGES:
        name = name.rpartition(".")[0]
    return name


@cache
def homes() -> dict[str, str]:
    """Public names of planner and interp, by the module that the package loads them from."""
    import interp
    import planner

    found = {
        f"{package.__name__}.{name}": home for package in (planner, interp) for name, home in package._MODULE_OF.items()
    }
    return {**found, "interp.replay": "interp.replay"}


def is_for_types_only(node: ast.If) -> bool:
    return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def imports(module: str, *, types: bool = True, nested: bool = True) -> frozenset[str]:
    """Modules that a module imports; without those for types only, or inside functions, on demand."""
    public = homes()
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]

    def visit(node: ast.AST) -> Iterator[str]:
        if isinstance(node, ast.Import):
            yield from (resolve(alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = node.module or ""
            if node.level:
                parent = package.rsplit(".", node.level - 1)[0] if node.level > 1 else package
                source = f"{parent}.{source}".rstrip(".")
            for alias in node.names:
                if f"{source}.{alias.name}" in public:
                    yield public[f"{source}.{alias.name}"]
                else:
                    yield resolve(f"{source}.{alias.name}") if source.split(".")[0] in PACKAGES else source
        elif isinstance(node, ast.If) and is_for_types_only(node) and not types:
            for child in node.orelse:
                yield from visit(child)
        elif nested or not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for child in ast.iter_child_nodes(node):
                yield from visit(child)

    return frozenset(visit(ast.parse(MODULES[module].read_text(encoding="utf-8"))))


def ours(names: Iterable[str]) -> set[str]:
    return {name for name in names if name.split(".")[0] in PACKAGES}


def within(name: str, *rooms: str) -> bool:
    return any(name == room or name.startswith(room + ".") for room in rooms)


def reached(module: str) -> set[str]:
    """Every module of ours that a module imports, directly or not, also on demand."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        for name in ours(imports(todo.pop())) - seen:
            if name not in PACKAGES:
                seen.add(name)
                todo.append(name)
    return seen


class TestTheScanItself:
    """The rules below would hold of nothing if the scan saw nothing."""

    def test_finds_the_modules(self):
        assert {"planner", "interp", "planner.errors", "planner.geometry.curve", "planner.machine.limits"} <= set(
            MODULES
        )

    def test_finds_imports_on_demand_and_for_types(self):
        assert {"planner.errors", "planner.geometry.arclength", "numpy"} <= imports("planner.geometry.curve")
        assert "planner.files.columns" in imports("planner.programs.line_table")
        assert "planner.files.columns" not in imports("planner.programs.times", nested=False)
        assert "feedplan.verdict" in imports("feedplan.job")
        assert "feedplan.verdict" not in imports("feedplan.job", types=False, nested=False)

    def test_follows_the_imports(self):
        assert {"planner.errors", "planner.geometry.curve", "planner.inputs"} <= reached("planner.machine.limits")

    def test_sees_through_the_package(self, tmp_path, monkeypatch):
        source = "from planner import plan_feedrate\nfrom planner.plan.solvers import ipopt\n"
        source += "import matplotlib.pyplot as plt\n"
        path = tmp_path / "probe.py"
        path.write_text(source)
        monkeypatch.setitem(MODULES, "planner.probe", path)
        found = imports("planner.probe")
        assert "planner.plan" in found
        assert any(within(name, "planner.plan.solvers") for name in found)
        assert "matplotlib.pyplot" in found

    def test_resolves_relative_imports(self, tmp_path, monkeypatch):
        path = tmp_path / "probe.py"
        path.write_text("from . import arclength\nfrom ..machine import limits\nfrom .curve import Curve\n")
        monkeypatch.setitem(MODULES, "planner.geometry.probe", path)
        expected = {"planner.geometry.arclength", "planner.machine.limits", "planner.geometry.curve"}
        assert imports("planner.geometry.probe") == expected


def room(module: str) -> int:
    """Where the room of a module stands in the order."""
    return next(i for i, name in enumerate(ORDER) if within(module, name))


class TestRooms:
    def test_every_module_stands_in_a_room(self):
        assert {m for m in MODULES if m not in DOORS and not within(m, *ORDER)} == set()
        assert all(any(within(m, name) for m in MODULES) for name in ORDER)

    @pytest.mark.parametrize("module", [m for m in MODULES if m not in DOORS])
    def test_imports_only_what_lies_below(self, module):
        upward = {name for name in ours(imports(module)) if name in DOORS or room(name) > room(module)}
        if ORDER[room(module)] == "feedplan":
            upward -= set(DOORS)  # a caller like any other
        assert upward == set()

    @pytest.mark.parametrize("module", [m for m in MODULES if within(m, *APART)])
    def test_keeps_apart_what_must_not_be_shared(self, module):
        forbidden = next(names for name, names in APART.items() if within(module, name))
        assert not {name for name in reached(module) if within(name, *forbidden)}

    @pytest.mark.parametrize("module", [m for m in MODULES if within(m, "planner.verify")])
    def test_the_check_takes_the_nodes_of_a_law_and_not_its_formulas(self, module):
        """What is between the nodes it evaluates itself; see also tests/verify/test_verify.py."""
        assert "planner.law" not in imports(module)

    @pytest.mark.parametrize("module", [m for m in MODULES if within(m, "planner.plan.solvers")])
    def test_solvers_lie_below_the_plan(self, module):
        above = ("planner.plan.refine", "planner.plan.bounds", "planner.plan.sensitivity")
        assert not {name for name in reached(module) if within(name, *above) or name == "planner.plan"}

    @pytest.mark.parametrize("module", [m for m in MODULES if within(m, "interp")])
    def test_interp_needs_no_solver_library(self, module):
        assert not {name for name in imports(module) if name.split(".")[0] in {"casadi", "toppra", "ruckig"}}

    def test_only_feedplan_imports_both_packages(self):
        assert not {m for m in MODULES if within(m, "planner") and any(within(n, "interp") for n in imports(m))}

    def test_only_output_imports_matplotlib(self):
        users = {m for m in MODULES if any(name.split(".")[0] == "matplotlib" for name in imports(m))}
        assert users <= {
            f"planner.output.{name}" for name in ("corner_view", "figures", "panels", "plan_panels", "plots")
        }

    def test_no_circles_between_modules(self):
        below = {m: ours(imports(m)) - set(DOORS) - {m} for m in MODULES}
        done: set[str] = set()
        while ready := {m for m in below if m not in done and below[m] <= done}:
            done |= ready
        assert set(below) - done == set()


class TestLoading:
    @pytest.mark.parametrize(
        "statement", ["import planner", "import interp", "import feedplan", "from feedplan import load_limits, Limits"]
    )
    def test_importing_loads_no_heavy_library(self, statement):
        script = f"import sys; {statement}; print(*(m for m in {HEAVY!r} if m in sys.modules))"
        run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
        assert run.stdout.split() == []

    def test_every_public_name_is_there(self):
        script = "import feedplan as f, planner, interp\n"
        script += "[getattr(p, n) for p in (f, planner, interp) for n in p.__all__]; print('all')"
        run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
        assert run.stdout.split() == ["all"]

"""Where a module is tested: in the file named after it, in the folder that its own has here, or where this page says."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from cases import PROJECT

TESTS = PROJECT / "tests"
PACKAGES = ("planner", "interp", "feedplan")

# Modules without a file of their own, by the file that tests them: they are parts of what is named there.
ELSEWHERE = {
    "test_compiled.py": ("planner.core_source",),
    "feedplan/cli/test_plan.py": ("feedplan.cli.check", "feedplan.cli.replay", "feedplan.progress"),
    "feedplan/cli/test_programs.py": ("feedplan.cli.ngc", "feedplan.cli.time", "feedplan.cli.windows"),
    "feedplan/comparison/test_comparison.py": tuple(
        f"feedplan.comparison{name}" for name in (".judgement", ".methods", ".result", ".two_paths", ".controller_rows")
    ),
    "feedplan/test_controller_time.py": ("feedplan.controller_text",),
    "feedplan/cli/test_calibrate.py": ("feedplan.calibration",),
    "feedplan/test_job.py": ("feedplan.sources",),
    "feedplan/test_page.py": ("feedplan.cli.report",),
    "feedplan/test_program_time.py": ("feedplan.time_text",),
    "feedplan/test_verdict.py": ("feedplan.verdict_text",),
    "calibration/test_calibrate.py": (
        "planner.calibration.calibrated_machine",
        "planner.calibration.known_path",
    ),
    "calibration/test_cycle_times.py": (
        "planner.calibration.controller_times",
        "planner.calibration.times_list",
    ),
    "calibration/test_ramps.py": ("planner.calibration.laws",),
    "geometry/test_catalog.py": ("planner.data",),
    "geometry/test_curve.py": ("planner.geometry.continuity", "planner.geometry.fit"),
    "geometry/drawing/test_drawn_entities.py": (
        "planner.geometry.drawing.bezier_pieces",
        "planner.geometry.drawing.entity_numbers",
    ),
    "machine/test_machine_toml.py": ("planner.machine.program_setup",),
    "interp/literature/test_greedy.py": ("interp.literature.greedy_published", "interp.literature.greedy_setup"),
    "output/test_certificate_file.py": ("planner.certificate",),
    "output/test_plots.py": ("planner.output.figures", "planner.output.panel_choice", "planner.output.plan_panels"),
    "output/test_ngc.py": ("planner.output.ngc_blocks",),
    "output/test_roundtrip.py": ("planner.output.ngc_program",),
    "output/test_table.py": (
        "planner.files.archive",
        "planner.files.columns",
        "planner.files.formats",
        "planner.files.whole_file",
        "planner.output.table_header",
        "planner.verify.implied_columns",
    ),
    "plan/solvers/test_scurve.py": tuple(
        f"planner.plan.solvers.{name}" for name in ("arcpath", "scurve_blocks", "scurve_search")
    ),
    "plan/test_bounds.py": ("planner.plan.dual.problem",),
    "plan/test_knots.py": ("planner.plan.slow",),
    "plan/test_refine.py": ("planner.plan.stage",),
    "plan/test_two_sided.py": ("planner.machine.limit_rows",),
    "plan/test_speed_law.py": ("planner.law",),
    "programs/linuxcnc/test_canonical_program.py": tuple(
        f"planner.programs.linuxcnc.{name}" for name in ("calls", "canon", "interpreter", "line_events", "marks")
    ),
    "programs/long/test_path_ahead.py": ("planner.programs.long.runs_beside", "planner.programs.long.worker"),
    "programs/long/test_windows.py": tuple(
        f"planner.programs.long.{name}"
        for name in ("done", "journal", "parts", "path_source", "restore", "run", "view", "window")
    ),
    "programs/path/test_absorb.py": ("planner.programs.path.corner_sizes",),
    "programs/path/test_smooth_path.py": tuple(
        f"planner.programs.path.{name}" for name in ("measure", "moves", "separate_path", "stretch")
    ),
    "programs/path/test_tube.py": (
        "planner.programs.path.tube_knots",
        "planner.programs.reading.noise",
    ),
    "programs/reading/test_compensation.py": tuple(
        f"planner.programs.reading.{name}" for name in ("compensation_words", "tool_guide")
    ),
    "programs/reading/test_offsets.py": tuple(
        f"planner.programs.reading.{name}" for name in ("acts", "setup", "unread")
    ),
    "programs/reading/test_flow.py": tuple(
        f"planner.programs.reading.{name}" for name in ("flow_lines", "flow_words", "machine_parameters")
    ),
    "programs/reading/test_threads.py": ("planner.programs.reading.spindle",),
    "programs/reading/test_refusals.py": ("planner.programs.reading.rules",),
    "programs/reading/test_splines.py": ("planner.programs.reading.nurbs_blocks",),
    "programs/reading/test_reader.py": tuple(
        f"planner.programs.reading.{name}"
        for name in (
            "blocks",
            "language",
            "modal",
            "move_making",
            "positions",
            "program",
            "program_events",
        )
    ),
    "verify/certificate/test_certificate.py": (
        "planner.verify.places",
        "planner.verify.certificate.shapes",
    ),
    "test_profile.py": ("planner.samples",),
    "verify/test_motion.py": ("planner.verify.peaks", "planner.verify.quantities"),
    "verify/test_rotary.py": ("planner.verify.steps", "planner.verify.tiplength"),
    "verify/test_verify.py": tuple(
        f"planner.verify.{name}" for name in ("between_nodes", "chords", "differences", "findings", "meanjerk", "sizes")
    ),
}
# Files that are named after no module, by what they are about.
TOPICS = {
    "benchmarks": "the commands of the benchmarks",
    "docs/test_controller.py": "what the page for controllers shows in C, and the pins of HAL",
    "docs/test_docs.py": "pages, links, and what they say to type",
    "docs/test_formats.py": "keys and columns on the pages of the file formats",
    "feedplan/cli/test_programs.py": "what a shop asks of a part program",
    "feedplan/cli/test_start.py": "what a command loads",
    "feedplan/cli/test_joint_programs.py": "every command on programs whose path was found with its feed",
    "feedplan/test_tables.py": "results as tables and in two lines",
    "interp/literature/test_loops.py": "compiled loops of the literature against plain Python",
    "test_core_builds.py": "the compiled core under sanitizers, valgrind, and for other processors",
    "test_installed.py": "built and installed elsewhere",
    "test_wheel.py": "what is installed",
    "feedplan/test_arguments.py": "swapped arguments and wrong types, at every door",
    "joint/test_joint_core.py": "the compiled joint solver against the problem as it is defined",
    "joint/test_optima.py": "the joint solver against IPOPT on small runs",
    "machine/test_feed_caps.py": "limits of a curve whose blocks have feeds of their own",
    "output/test_table_truth.py": "what a table claims is computed again",
    "output/test_roundtrip.py": "programs that are written and planned again",
    "plan/solvers/test_interior_core.py": "the compiled interior-point method against dense linear algebra",
    "plan/solvers/test_interior_invariants.py": "what must not change the optimum",
    "plan/solvers/test_interior_plans.py": "plans of the interior-point method",
    "plan/test_extreme.py": "curves and machines at the edges of what is allowed",
    "plan/test_plan_ends.py": "ends of a plan",
    "plan/test_two_sided.py": "rows whose bounds are not symmetric",
    "programs/path/test_path_of_axes.py": "paths of rotary axes and of U V W",
    "programs/reading/test_axes.py": "words of rotary axes and of U V W",
    "programs/reading/test_threads.py": ("planner.programs.reading.spindle",),
    "programs/reading/test_refusals.py": "programs that are refused",
    "programs/test_machine_setup.py": "homes, work offsets and tool changes of a machine file",
    "programs/test_spline_paths.py": "splines of a program, from the reader to the plan",
    "programs/test_rapids.py": "rapids of a program, from the reader to the plan",
    "verify/test_defects.py": "planted defects",
    "verify/test_rotary.py": "rotary axes",
    "test_imports.py": "which room may import which",
    "test_layout.py": "this page",
    "test_names.py": "one name for one thing",
    "test_mutations.py": "mutated files of every kind",
}


def is_trivial(module: Path) -> bool:
    """Whether a module defines nothing that runs: names handed on, types, exceptions without code."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.name not in {"__getattr__", "__dir__"}:
            return False
    return True


def own_test(module: Path) -> Path:
    """The file named after a module; a package has its name."""
    path = module.relative_to(PROJECT / "planner") if "planner" in module.parts else module.relative_to(PROJECT)
    stem = module.parent.name if module.stem == "__init__" else module.stem
    return TESTS / path.parent / f"test_{stem}.py"


def dotted(module: Path) -> str:
    parts = module.relative_to(PROJECT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    dotted(path): path
    for package in PACKAGES
    for path in sorted((PROJECT / package).rglob("*.py"))
    if not is_trivial(path)
}
PLACED = {module: TESTS / file for file, modules in ELSEWHERE.items() for module in modules}


@pytest.mark.parametrize("module", MODULES)
def test_every_module_has_its_file_or_a_place_elsewhere(module):
    own = own_test(MODULES[module])
    assert own.exists() or module in PLACED, f"{module}: neither {own.relative_to(PROJECT)} nor an entry here"


def test_what_is_named_here_exists():
    assert set(PLACED) <= set(MODULES)
    assert len(PLACED) == sum(map(len, ELSEWHERE.values()))
    assert [module for module in PLACED if own_test(MODULES[module]).exists()] == []
    assert [name for name in (*ELSEWHERE, *TOPICS) if not (TESTS / name).exists()] == []


def test_every_file_is_named_after_a_module_or_a_topic():
    named = {own_test(path) for path in MODULES.values()} | {TESTS / name for name in TOPICS}
    files = {file if file.parent.name != "benchmarks" else file.parent for file in TESTS.rglob("test_*.py")}
    assert files - named == set()


def test_the_scan_finds_what_it_should():
    """A package by its name, a file in its folder."""
    assert own_test(PROJECT / "planner/verify/__init__.py") == TESTS / "verify/test_verify.py"
    assert own_test(PROJECT / "interp/replay.py") == TESTS / "interp/test_replay.py"
    assert "planner.types" not in MODULES
    assert "planner.geometry.curve" in MODULES

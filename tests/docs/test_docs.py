"""The documentation is true: every block runs as it stands, prints what the page shows, and every link leads somewhere."""

from __future__ import annotations

import importlib.util
import json
import re
import runpy
import shlex
import subprocess
from pathlib import Path

import click
import matplotlib as mpl
import pytest
from cases import PROJECT
from doc_pages import DOCS, PAGES, anchors, blocks, differs, key_tables, links

import feedplan
import feedplan.progress
import planner
from feedplan.cli import app

NAMES = [str(page.relative_to(PROJECT)) for page in PAGES]
LINKED = (
    *PAGES,
    PROJECT / "CHANGELOG.md",
    PROJECT / "benchmarks" / "README.md",
    PROJECT / "benchmarks" / "comparison.md",
)
PARSED = "parsed, not run"
SETUP = "python3 -m venv "  # .ci/run types the README's own
STATUS = re.compile(r"#\s*exit status (\d)\s*$")


@pytest.fixture(scope="module", autouse=True)
def _drawn_without_a_screen():
    mpl.use("Agg")


@pytest.fixture
def typed(tmp_path, monkeypatch, capsys):
    """A reader's directory, and how a line is typed there; returns what is printed."""
    for folder in ("tests", "docs"):
        (tmp_path / folder).symlink_to(PROJECT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def line(text):
        capsys.readouterr()
        said = STATUS.search(text)
        words = shlex.split(text, comments=True)
        if words[0] == "head":
            return subprocess.run(words, check=True, capture_output=True, text=True).stdout
        with pytest.raises(SystemExit) as stop:
            app(words[1:], prog_name="feedplan")
        printed = capsys.readouterr()
        assert (stop.value.code or 0) == int(said[1] if said else 0), f"{text}\n{printed.out}{printed.err}"
        return printed.out + printed.err

    return line


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_page_runs_as_it_stands(page, typed, capsys, tmp_path):
    """Every block of a page, in its order."""
    namespace = {"__name__": page.stem}
    printed = None
    for block in blocks(page):
        place = f"{page.name}:{block.line}"
        if block.language == "text" and block.follows and printed is not None:
            assert not (text := differs(block.text, printed)), f"{place}: {text}"
        elif block.language == "sh":
            lines = command_lines(block.text)
            for text in lines:
                assert understood(text), f"{place}: {text} is no command that a reader can type"
            run = block.remark != PARSED and all(text.startswith(("feedplan ", "head ")) for text in lines)
            printed = "".join(map(typed, lines)) if run else None
        elif block.language == "python":
            capsys.readouterr()
            exec(compile(block.text, place, "exec"), namespace)
            printed = capsys.readouterr().out
        else:
            printed = None
            if block.remark.startswith("file: "):
                (tmp_path / block.remark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(PROJECT)))
def test_links_lead_somewhere(page):
    """Files and headings that a page links to exist."""
    for _, target in links(page):
        if target.startswith(("https://", "http://")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {target}, which is no heading"


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(PROJECT)))
def test_named_files_exist(page):
    """Modules and folders of the project that a page names: they move, and pages forget it."""
    text = page.read_text(encoding="utf-8")
    quoted = " ".join(re.findall(r"`([^`\n]+)`", text))
    for name in re.findall(r"(?<![\w/.])((?:planner|interp|feedplan|benchmarks|tests|findings)/[\w./]*)", quoted):
        assert (PROJECT / name).exists(), f"{page.name} names {name}"
    modules = {file.name for package in ("planner", "interp", "feedplan") for file in (PROJECT / package).rglob("*.py")}
    modules |= {file.name for file in PROJECT.glob("*.py")}
    for name in re.findall(r"(?<![\w/.])(\w+\.py)\b", quoted):
        assert name in modules, f"{page.name} names {name}"
    for name in re.findall(r"python -m (benchmarks[\w.]*)", quoted):
        assert importlib.util.find_spec(name) is not None, f"{page.name} names {name}"


def test_every_page_is_reached_from_the_index():
    """No page of the documentation is an orphan."""
    index = {target.partition("#")[0] for _, target in links(DOCS / "README.md")}
    pages = {file.name for file in DOCS.iterdir() if file.suffix in {".md", ".ipynb"}} - {"README.md"}
    assert pages == {name for name in index if "/" not in name and name}, "docs/README.md and the pages in docs/"


def test_every_picture_is_made_by_a_command():
    """The index names a command for each picture, a page shows it, and what the command runs knows its name."""
    made = {row[0]: row[1].strip("`") for row in key_tables(DOCS / "README.md")["pictures"]}
    shown = {(page.parent / target).resolve().name for page in PAGES for picture, target in links(page) if picture}
    files = {file.name for file in DOCS.rglob("*.png")}
    assert set(made) == files
    assert shown == files
    for name, command in made.items():
        assert understood(command), command
        if command.startswith("feedplan "):
            assert shlex.split(command)[-1] == f"docs/{name}"
        else:
            source = importlib.util.find_spec(shlex.split(command)[2]).origin
            figure = name.removesuffix(".png").partition("-")[2]
            assert figure in Path(source).read_text(encoding="utf-8"), f"{command} does not know {figure}"


def test_notebook_runs(typed, monkeypatch):
    """The code cells of the notebook in their order, in one namespace; no output is stored in it."""
    import matplotlib.pyplot as plt

    notebook = json.loads((DOCS / "tutorial-research.ipynb").read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    namespace = {"__name__": "notebook"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 8
    for cell in cells:
        assert not cell["outputs"]
        assert cell["execution_count"] is None
        exec(compile("".join(cell["source"]), f"notebook cell {cell['id']}", "exec"), namespace)


def test_links_of_the_notebook_lead_somewhere():
    """Files that its text links to exist."""
    notebook = json.loads((DOCS / "tutorial-research.ipynb").read_text(encoding="utf-8"))
    text = "".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown")
    targets = re.findall(r"\]\(([^)#]+)\)", text)
    assert targets
    assert all((DOCS / target).exists() for target in targets)


def test_api_page_is_made_of_the_docstrings():
    """The committed page is what its command writes, and every public name has its place in it."""
    made = runpy.run_path(str(DOCS / "make_api.py"))["api_page"]()
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    assert page == made, "python docs/make_api.py writes it again"
    heads = set(re.findall(r"^### (\w+)", page, re.MULTILINE))
    assert heads == set(feedplan.__all__)


def test_cited_version_is_the_package_version():
    """The citation file is of this version, and has what the format requires."""
    text = (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    fields = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.MULTILINE))
    assert fields["version"].strip('"') == planner.__version__
    assert {"cff-version", "message", "title", "authors", "license"} <= set(fields)
    assert fields["license"] == "MIT"
    assert fields["cff-version"] == "1.2.0"


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a 1.000 s", "a 1.001 s", True),
        ("a 1.000 s", "a 1.02 s", False),
        ("a 1.000 s", "b 1.000 s", False),
        ("first\n...\nlast", "first\nmiddle 3\nlast\n", True),
        ("first\n...\nlast", "first\nmiddle\n", False),
        ("planned in 0.2 s", "planned in 9.9 s", True),
        ("X 12.5% 0.3 s", "X 12.5% 4.1 s", True),
        ("X 12.5% 0.3 s", "X 13.5% 0.3 s", False),
        ("1e-3 um", "1.001e-3 um", True),
        ("more words", "more", False),
    ],
)
def test_comparison_of_output_tells_true_from_false(shown, printed, same):
    """The rule by which pages are judged: a test of the test."""
    assert (differs(shown, printed) == "") == same


def command_lines(text):
    """The lines of a shell block, continued ones joined; comments on lines of their own are left out."""
    joined = text.replace("\\\n", " ")
    return [line.strip() for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def understood(text):
    """Whether a line is a command of ours with arguments it takes, or starts a module or a file that exists."""
    words = shlex.split(text, comments=True)
    if text.startswith((SETUP, "head ")):
        return True
    if words[0] == "python":
        return importlib.util.find_spec(words[2]) is not None if words[1] == "-m" else (PROJECT / words[1]).is_file()
    # A command keeps the names of its option for help as it first sees them: from its group, which has two.
    group = click.Context(app, info_name="feedplan", **app.context_settings)
    command = app.get_command(group, words[1]) if words[0] == "feedplan" else None
    if command is not None:
        command.make_context(words[1], words[2:], parent=group)  # raises for what it does not take
    return command is not None

"""Writes docs/api.md: every public name of feedplan with its signature and docstring.

    python docs/make_api.py

The page follows the docstrings; a test holds that the committed page is what this writes.
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parents[1]
PAGE = PROJECT / "docs" / "api.md"
_HEAD = """\
# API

Every public name of `feedplan`: `import feedplan as fp`. `planner` (offline) and `interp` (real time) have parts of it.
Lengths are in mm, angles in rad, times in s. This page is made of the docstrings by `python docs/make_api.py`.

"""
# Chapters in their order, each with the modules whose names stand in it; of two that fit the longer counts.
_CHAPTERS = {
    "Curves": ("planner.geometry", "planner.programs.source"),
    "Limits": ("planner.machine", "planner.quantity"),
    "Plans": ("planner.plan", "planner.profile", "planner.law", "planner.certificate", "planner.samples"),
    "The check": ("planner.verify",),
    "From source to verdict, page and comparison": ("feedplan",),
    "Part programs": ("planner.programs",),
    "Files and pictures": ("planner.output", "planner.files"),
    "Real time": ("interp",),
    "Interpolators of the literature": ("interp.literature",),
    "Errors": ("planner.errors",),
}
_OURS = ("feedplan", "planner", "interp")
_ROLE = re.compile(r":\w+:`~?(?:[\w.]*\.)?(\w+)`")
_LISTED = {"Parameters", "Attributes", "Returns", "Yields", "Raises"}


class _Raw(str):
    """An annotation that is written as it stands in the source."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def api_page() -> str:
    """The whole page."""
    package = importlib.import_module("feedplan")
    chapters: dict[str, list[str]] = {title: [] for title in _CHAPTERS}
    for name in sorted(package.__all__, key=str.lower):
        value = getattr(package, name)
        chapters[_chapter(_home(name, value))].append(_entry(name, value))
    text = "".join(f"## {title}\n\n" + "".join(entries) for title, entries in chapters.items() if entries)
    return (_HEAD + text).rstrip() + "\n"


def _home(name: str, value: Any) -> str:
    """The module a name comes from."""
    said = getattr(getattr(value, "py_func", value), "__module__", None)
    if isinstance(said, str) and said.split(".")[0] in _OURS:
        return said
    # A plain value does not say where it is from: the module that has it and is no door.
    return next(
        module
        for module, content in sorted(sys.modules.items())
        if module.split(".")[0] in _OURS and module not in _OURS and vars(content).get(name) is value
    )


def _chapter(module: str) -> str:
    fitting = [
        (len(prefix), title)
        for title, prefixes in _CHAPTERS.items()
        for prefix in prefixes
        if f"{module}.".startswith(f"{prefix}.")
    ]
    if not fitting:
        raise LookupError(f"{module} belongs to no chapter of docs/make_api.py")
    return max(fitting)[1]


def _entry(name: str, value: Any) -> str:
    """One public name."""
    value = getattr(value, "py_func", value)  # what was compiled
    if inspect.isclass(value):
        return _class_entry(name, value)
    if callable(value):
        return f"### {name}\n\n{_signature(name, value)}{_text(value.__doc__)}"
    return f"### {name}\n\n```py\n{name} = {_short(value)}\n```\n\n"


def _class_entry(name: str, value: type) -> str:
    inherited = [
        base.__name__ for base in value.__mro__[1:] if base is not object and not base.__name__.startswith("_")
    ]
    kind = f"{name}({', '.join(inherited[:2])})" if issubclass(value, Exception) else name
    parts = [f"### {kind}\n\n"]
    if not issubclass(value, Exception | Enum):
        parts.append(_signature(name, value))
    parts.append(_text(value.__doc__))
    if issubclass(value, Enum):
        parts.append("".join(f"- `{member.name}`: {_short(member.value)}\n" for member in value) + "\n")
    for attribute, member in sorted(vars(value).items()):
        if attribute.startswith("_"):
            continue
        function = getattr(member, "__func__", getattr(member, "func", getattr(member, "fget", member)))
        if not inspect.isfunction(function) or not function.__doc__:
            continue
        head = f"`{name}.{attribute}{_arguments(function)}`" if _is_called(member) else f"`{name}.{attribute}`"
        parts.append(f"#### {head}\n\n{_text(function.__doc__)}")
    return "".join(parts)


def _is_called(member: Any) -> bool:
    return inspect.isfunction(member) or isinstance(member, classmethod | staticmethod)


def _signature(name: str, value: Any) -> str:
    return f"```py\n{name}{_arguments(value)}\n```\n\n"


def _arguments(value: Any) -> str:
    """The arguments as they stand in the source, without self."""
    signature = inspect.signature(value)
    given = [p for p in signature.parameters.values() if p.name not in {"self", "cls"}]
    if is_dataclass(value) and inspect.isclass(value):  # a factory shows as what it makes
        made = {f.name: f.default_factory for f in fields(value) if f.default_factory is not MISSING}
        given = [p.replace(default=made[p.name]()) if p.name in made else p for p in given]
    given = [p.replace(default=_Raw("...")) if inspect.isfunction(p.default) else p for p in given]
    given = [p.replace(annotation=_plain(p.annotation)) for p in given]
    if inspect.isclass(value):
        signature = signature.replace(return_annotation=signature.empty)
    text = str(signature.replace(parameters=given, return_annotation=_plain(signature.return_annotation)))
    return text if len(text) < 100 or not given else _wrapped(given, signature)


def _wrapped(given: list[inspect.Parameter], signature: inspect.Signature) -> str:
    """One argument a line."""
    lines, starred = [], False
    for parameter in given:
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            lines.append("*")
            starred = True
        lines.append(str(parameter))
    result = signature.return_annotation
    end = "" if result is signature.empty else f" -> {_plain(result)}"
    return "(\n" + "".join(f"    {line},\n" for line in lines) + f"){end}"


def _plain(annotation: Any) -> Any:
    return _Raw(annotation) if isinstance(annotation, str) else annotation


def _short(value: Any) -> str:
    text = re.sub(r"<function (\w+) at 0x\w+>", r"\1", repr(value))
    return text if len(text) < 400 else text[:400] + " ..."


def _text(doc: str | None) -> str:
    """A docstring as Markdown: numpydoc's sections become lists, everything else stays."""
    lines = inspect.cleandoc(doc or "").splitlines()
    out: list[str] = []
    section = ""
    for k, line in enumerate(lines):
        below = lines[k + 1] if k + 1 < len(lines) else ""
        if below and set(below) == {"-"}:
            section = line
            out += [f"**{line}**", ""]
        elif line and set(line) == {"-"}:
            continue
        elif section in _LISTED and line and not line.startswith(" "):
            out.append(f"- `{line}`")
        elif section in _LISTED and line.startswith(" "):
            out.append(f"  {line.strip()}" if not line.startswith("     ") else f"  {line}")
        else:
            out.append(line)
    return _ROLE.sub(r"`\1`", "\n".join(out)).replace("``", "`").strip() + "\n\n"


if __name__ == "__main__":
    sys.path.insert(0, str(PROJECT))
    PAGE.write_text(api_page(), encoding="utf-8")

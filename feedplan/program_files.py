"""Which part programs are meant by names on a command line: files, and folders of them; and what to call each."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from feedplan.sources import is_program
from planner.errors import InputError
from planner.programs import SUFFIXES

_NAMED = 3  # of what else is in a folder
_CALLS = re.compile(rb"call|m\s*0*98")
_COMPUTED = re.compile(rb"o\s*\[|p\s*[\[#]")
_WORD = re.compile(rb"[\w-]+")
_IN_FOLDERS = tuple(suffix for suffix in SUFFIXES if suffix != ".txt")
"""In a folder a text is a note to people; named itself, it is a program."""


@dataclass(frozen=True)
class ProgramFile:
    """A part program, or what was named as one.

    Attributes
    ----------
    path : Path
    label : str
        The shortest end of its path that no other of them has.
    """

    path: Path
    label: str

    def read(self) -> bytes:
        """Return its content.

        Raises InputError where it is no part program, cannot be read, or is empty.
        """
        if os.path.islink(self.path) and not os.path.exists(self.path):
            raise InputError(f"{self.label}: a link to {os.readlink(self.path)}, which is not there")
        if os.path.isdir(self.path):
            raise InputError(
                f"{self.label}: a directory; name it alone, or with a / at its end, for the programs in it"
            )
        if not is_program(self.path):
            raise InputError(f"{self.label}: no part program by its name; these end in {', '.join(SUFFIXES)}")
        if os.path.exists(self.path) and not os.path.isfile(self.path):  # a pipe or a device would be waited for
            raise InputError(f"{self.label}: is not an ordinary file")
        try:
            content = self.path.read_bytes()
        except OSError as error:
            raise InputError(f"{self.label}: cannot be read ({error.strerror or error})") from None
        if not content.strip():
            raise InputError(f"{self.label}: is empty; the file may have been cut off")
        return content


def called_files(program: ProgramFile, content: bytes) -> dict[str, bytes]:
    """Read the files beside a program that it may call, and those that these may call, by their names.

    They are those whose name stands in a program that calls, behind an O or a P too; where it calls a computed number, all.
    One that cannot be read is left out: the program that calls it says so.
    """
    beside = [path for path in sorted(program.path.parent.glob("*")) if is_program(path) and path.is_file()]
    found: dict[str, bytes] = {}
    todo = [content]
    while todo:
        text = todo.pop().lower()
        if not _CALLS.search(text):
            continue
        words = set(_WORD.findall(text))
        words |= {word[1:] for word in words if word[:1] in (b"o", b"p")}
        computed = _COMPUTED.search(text) is not None
        for path in beside:
            if path.name in found or path.name == program.path.name:
                continue
            if computed or path.stem.lower().encode("utf-8", "surrogateescape") in words:
                with suppress(OSError):
                    found[path.name] = path.read_bytes()
                    todo.append(found[path.name])
    return found


def find_programs(names: Sequence[str]) -> tuple[tuple[ProgramFile, ...], tuple[str, ...]]:
    """Find the part programs that names stand for.

    Parameters
    ----------
    names : sequence of str
        Files, in whatever way each is to fail; and folders, which stand for the part programs in them, sorted by name.

    Returns
    -------
    (files, notes)
        The files in the order of the names, each once; and what a person should know: what else is in the folders, and what
        was named twice.

    Raises
    ------
    InputError
        If a folder cannot be read, or has no part program.
    """
    found: dict[str, Path] = {}
    notes: list[str] = []
    for name in names:
        # The folder x.ngc/ is one; without the / it may be one of many names that a pattern found.
        alone = len(names) == 1 or name.endswith(os.sep)
        if os.path.isdir(name) and (alone or not is_program(name)):
            inside, others = _of_folder(name)
            if not inside:
                raise InputError(
                    f"{name}: has no part program, {', '.join(_IN_FOLDERS)}; what is there{_besides(others) or ': nothing'}"
                )
            notes += [f"{name}: not timed{_besides(others)}"] if others else []
        else:
            inside = [Path(name)]
        for path in inside:
            same = os.path.abspath(path)
            if same in found:
                notes.append(f"{path}: named twice, timed once")
            else:
                found[same] = path
    labels = distinct_labels(list(found))
    return tuple(ProgramFile(path, label) for path, label in zip(found.values(), labels, strict=True)), tuple(notes)


def distinct_labels(paths: Sequence[str]) -> list[str]:
    """Shorten absolute paths, all different, to their shortest ends that are: file names where these are."""
    parts = [Path(path).parts for path in paths]
    count = [1] * len(paths)
    while True:
        labels = [os.path.join(*part[-n:]) for part, n in zip(parts, count, strict=True)]
        alike: dict[str, list[int]] = {}
        for k, label in enumerate(labels):
            alike.setdefault(label, []).append(k)
        again = [k for rows in alike.values() if len(rows) > 1 for k in rows if count[k] < len(parts[k])]
        if not again:
            return labels
        for k in again:
            count[k] += 1


def _of_folder(name: str) -> tuple[list[Path], list[str]]:
    """The part programs of a folder, and what else is there, each sorted."""
    try:
        entries = sorted(os.listdir(name))
    except OSError as error:
        raise InputError(f"{name}: cannot be read ({error.strerror or error})") from None
    inside = [entry for entry in entries if Path(entry).suffix.lower() in _IN_FOLDERS]
    others = [entry for entry in entries if entry not in set(inside)]
    marked = [entry + os.sep if os.path.isdir(os.path.join(name, entry)) else entry for entry in others]
    return [Path(name) / entry for entry in inside], marked


def _besides(others: Sequence[str]) -> str:
    if not others:
        return ""
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    return f": {', '.join(others[:_NAMED])}{more}"

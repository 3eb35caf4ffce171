"""Standard input and output in place of a file: ``-``.

    feedplan plan circle -o - | feedplan check - circle
    cat part.ngc | feedplan ngc - --tolerance-mm 0.01 -o - > out.ngc

A table, samples, lines and a comparison are CSV there, a program is text, a page HTML.  A curve is read as JSON where it
begins with a brace, else as a part program.  What a command has to say goes to standard error where its standard output is
the file.

Readers and writers work on files that they may read twice and write whole or not at all: those of a directory that lasts as
long as the command.  Nothing reaches standard output before the file is whole.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import click

from planner.errors import FeedrateError, InputError

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

STANDARD = "-"
_IN, _OUT = "standard input", "standard output"


class Streams:
    """A context in which files stand for the standard streams."""

    def __init__(self) -> None:
        self._folder: TemporaryDirectory[str] | None = None
        self._names: dict[str, str] = {}  # what to call each file
        self._output: Path | None = None

    def __enter__(self) -> Streams:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if isinstance(error, FeedrateError) and self._names:
                raise type(error)(self.told(str(error))) from None
            whole = self._output is not None and self._output.exists()
            if whole and (error is None or isinstance(error, click.exceptions.Exit)):
                import shutil

                with open(str(self._output), "rb") as file:
                    shutil.copyfileobj(file, sys.stdout.buffer)
                sys.stdout.buffer.flush()
        finally:
            if self._folder is not None:
                self._folder.cleanup()

    @property
    def taken(self) -> bool:
        """Standard output is a file of this command: what else there is to say goes to standard error."""
        return self._output is not None

    def table(self, path: Path) -> Path:
        """Return the file of a table to read."""
        return self._read(".csv") if str(path) == STANDARD else path

    def curve(self, source: str) -> str:
        """Return the name or file of a curve to read: JSON in braces, else a part program."""
        return str(self._read("")) if source == STANDARD else source

    def program(self, source: str) -> str:
        """Return the file of a part program to read."""
        return str(self._read(".ngc")) if source == STANDARD else source

    def output(self, path: Path | None, suffix: str) -> Path | None:
        """Return the file of that kind to write; None stays None."""
        if path is None or str(path) != STANDARD:
            return path
        if self._output is not None:
            raise InputError(f"{_OUT} is given for two outputs; give a file for one")
        self._output = self._named(f"stdout{suffix}", _OUT)
        return self._output

    def told(self, text: str) -> str:
        """Call the streams by their names in a text for a person."""
        for path, name in self._names.items():
            text = text.replace(path, name).replace(Path(path).name, name)  # programs are told by their file's name
        return text

    def _read(self, suffix: str) -> Path:
        if _IN in self._names.values():
            raise InputError(f"{_IN} is given for two inputs; give a file for one")
        data = sys.stdin.buffer.read()
        kind = suffix or (".json" if data.lstrip().startswith(b"{") else ".ngc")
        path = self._named(f"stdin{kind}", _IN)
        path.write_bytes(data)
        return path

    def _named(self, file: str, name: str) -> Path:
        if self._folder is None:
            from tempfile import TemporaryDirectory

            self._folder = TemporaryDirectory(prefix="feedplan-")
        path = Path(self._folder.name) / file
        self._names[str(path)] = name
        return path

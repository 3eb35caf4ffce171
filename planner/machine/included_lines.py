"""Lines of a configuration file with those of the files that it includes, each with its place."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from planner.errors import InputError
from planner.inputs import read_text, shorten

_MAX_FILES = 500


@dataclass(frozen=True)
class PlacedLine:
    """A line, and where it stands: ``file:line``."""

    text: str
    place: str


@dataclass
class IncludedLines:
    """Reads a file and what it includes.

    ``directive`` matches a line that includes, with the name of the file as its first group.  A name counts from the folder
    of the file that it stands in, ``~`` is the home of the user.  ``patterns``: ``*`` and ``?`` stand for several files, and
    for none if there are none.
    """

    directive: re.Pattern[str]
    patterns: bool = False
    files: int = 0

    def of(self, text: str, path: Path, above: tuple[Path, ...] = ()) -> Iterator[PlacedLine]:
        """The lines in the order in which they count.

        Raises
        ------
        InputError
            ``file:line: ...`` where a file is missing, is no text, or includes itself.
        """
        self.files += 1
        inside = (*above, path.resolve())
        for number, line in enumerate(text.splitlines(), 1):
            place = f"{path}:{number}"
            found = self.directive.match(line)
            if found is None:
                yield PlacedLine(line, place)
                continue
            for file in self._files(found[1].strip(), path.parent, place):
                self._require_new(file, inside, place)
                try:
                    content = read_text(file, InputError)
                except InputError as error:
                    raise InputError(f"{place}: {shorten(line.strip())}: {error}") from None
                yield from self.of(content, file, inside)

    def _files(self, name: str, folder: Path, place: str) -> list[Path]:
        if not name or "\0" in name:
            raise InputError(f"{place}: no file is named to include; write its name, or delete the line")
        target = folder / Path(name).expanduser() if name.startswith("~/") else folder / name
        if self.patterns and glob.has_magic(name):
            return [Path(file) for file in sorted(glob.glob(str(target)))]
        return [target]

    def _require_new(self, file: Path, inside: tuple[Path, ...], place: str) -> None:
        if file.resolve() in inside:
            raise InputError(f"{place}: {file} includes itself; delete this line")
        if self.files >= _MAX_FILES:
            raise InputError(f"{place}: more than {_MAX_FILES} files are included; put them into fewer")

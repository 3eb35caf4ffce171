"""The order in which the lines of a program are run: O words, calls, loops, conditions, and M98.

Lines without parameters, expressions and O words are kept as runs of text, which are split into words as a whole; only the
others are read one by one.  A called file is looked for beside the program; its moves count for the line of the call.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from planner.errors import InputError
from planner.inputs import shorten
from planner.programs import SUFFIXES
from planner.programs.reading.expressions import MAX_ARGUMENTS, LineError, LineEvaluator, ParameterKey, Parameters
from planner.programs.reading.flow_lines import FlowLine, Listing, read_listing
from planner.programs.reading.flow_words import WordQueue
from planner.programs.reading.machine_parameters import ASKS
from planner.programs.reading.words import Words

_MAX_CALLS = 10  # within each other, as LinuxCNC has it
_MAX_WORK = 10_000_000  # plain blocks; a line that is evaluated counts for ten
_LINE_WORK = 10
_MAX_WORDS = 200_000  # that wait for the next step of the reader


@dataclass
class _Call:
    """A call that runs: where it goes on afterwards, and of M98 how often it runs again."""

    listing: Listing
    after: int
    line: int | None
    own: bool
    begin: int = 0
    again: int = 0
    counts: dict[int, int] = field(default_factory=dict)


class Flow:
    """Runs a program."""

    def __init__(self, path: Path, machine: Callable[[ParameterKey], float | None]) -> None:
        self.path = path
        self.main = read_listing(path)
        self.files: dict[str, Listing] = {}
        self.parameters = Parameters(machine=machine)
        self.calls = [_Call(self.main, 0, None, own=False)]
        self.queue = WordQueue(path.name)
        self.work = 0

    def words(self) -> Iterator[tuple[Words, InputError | None]]:
        """The words in the order in which they are run; with the last of them comes the error that ended it, if any."""
        error = None
        at = 0
        try:
            while at < len(self.listing.items) and not self.queue.ended:
                item = self.listing.items[at]
                if self.queue.count and isinstance(item, FlowLine) and ASKS.search(item.text):
                    yield self.queue.take(0), None  # after this the machine stands where the line finds it
                at = self._step(at)
                if self.queue.count > _MAX_WORDS:
                    yield self.queue.take(0), None
        except InputError as problem:
            error = problem
        yield self.queue.take(self.main.line_count), error

    @property
    def listing(self) -> Listing:
        """The file that runs."""
        return self.calls[-1].listing

    def _step(self, at: int) -> int:
        """Run one item; returns the index of the next."""
        item = self.listing.items[at]
        if not isinstance(item, FlowLine):
            words, error = item.scanned
            self.work += words.letter.size
            self._require_end(item.first_line)
            self.queue.add(words, self.calls[-1].line)
            if error is not None:
                raise error
            return at + 1
        self.work += _LINE_WORK
        self._require_end(item.line)
        try:
            if item.fault:
                raise LineError(item.text, item.fault)
            return self._plain(item, at) if item.keyword is None else self._control(item, at)
        except LineError as problem:
            raise InputError(f"{self._place(item.line)}: {shorten(problem.word)}: {problem.reason}") from None

    def _place(self, line: int) -> str:
        return f"{self.listing.name}:{line}"

    def _require_end(self, line: int) -> None:
        if self.work > _MAX_WORK:
            raise InputError(
                f"{self._place(line)}: end of steps: the program has run {_MAX_WORK // _LINE_WORK} lines and does not end; "
                "a loop here may never end"
            )

    def _plain(self, item: FlowLine, at: int) -> int:
        """A line of words."""
        found = LineEvaluator(item.text, self.parameters).line()
        for key, value in found.sets:
            self.parameters.set(key, value)
        numbers = {letter: value for letter, value, _, _ in found.words}
        jump = numbers.get("M") if any(w[0] == "M" and w[1] in (98.0, 99.0) for w in found.words) else None
        if jump is None:
            self.queue.add_line(item.text, found.words, self.calls[-1].line or item.line)
            return at + 1
        if jump == 99.0:
            return self._again_or_back(item)
        return self._call_program(item, at, numbers)

    def _call_program(self, item: FlowLine, at: int, numbers: dict[str, float]) -> int:
        """M98: the lines behind O with the number P, L times."""
        if "P" not in numbers or numbers["P"] != int(numbers["P"]):
            raise LineError(item.text, "M98 needs the number of a program, P")
        times = numbers.get("L", 1.0)
        if times < 1.0 or times != int(times):
            raise LineError(item.text, "the repeats L of M98 are a whole number of at least 1")
        label = str(int(numbers["P"]))
        listing, begin = self._found(item, label)
        self._enter(
            _Call(listing, at + 1, self.calls[-1].line or self._line_in_main(listing, item), False, begin), item
        )
        self.calls[-1].again = int(times) - 1
        return begin

    def _line_in_main(self, listing: Listing, item: FlowLine) -> int | None:
        """The line that what a called file moves counts for; None within the program itself."""
        return None if listing is self.main else item.line

    def _found(self, item: FlowLine, label: str) -> tuple[Listing, int]:
        """Where a subroutine begins: in the file that runs, in the program, or in a file of its name."""
        for listing in (self.listing, self.main):
            if label in listing.begins:
                return listing, listing.begins[label]
        if label not in self.files:
            names = [label + suffix for suffix in SUFFIXES] if re.fullmatch(r"[\w-]+", label) else []
            path = next((p for name in names if (p := self.path.parent / name).is_file()), None)
            if path is None:
                raise LineError(
                    item.text, f"there is no subroutine {label} in the program, and no file {label}.ngc beside it"
                )
            self.files[label] = read_listing(path)
        listing = self.files[label]
        if label not in listing.begins:
            raise LineError(item.text, f"the file {listing.name} has no subroutine {label}")
        return listing, listing.begins[label]

    def _enter(self, call: _Call, item: FlowLine) -> None:
        if len(self.calls) > _MAX_CALLS:
            raise LineError(item.text, f"more than {_MAX_CALLS} calls within each other; a subroutine may call itself")
        self.calls.append(call)

    def _again_or_back(self, item: FlowLine) -> int:
        """M99: the next repeat of M98, or back behind the call."""
        if len(self.calls) == 1:
            raise LineError(item.text, "repeats the program for ever; end it with M2 or M30")
        call = self.calls[-1]
        if call.again:
            call.again -= 1
            return call.begin
        return self._back()

    def _back(self) -> int:
        call = self.calls.pop()
        if call.own:
            self.parameters.own.pop()
        return call.after

    def _numbers(self, item: FlowLine, count: int | None = None) -> list[float]:
        values = LineEvaluator(item.arguments, self.parameters).brackets()
        if count is not None and len(values) != count:
            raise LineError(
                item.text, f"needs {count} expression in brackets [ ]" if count else "nothing belongs behind it"
            )
        return values

    def _control(self, item: FlowLine, at: int) -> int:
        """An O word."""
        return _CONTROLS.get(item.keyword or "", Flow._next)(self, item, at)

    def _next(self, item: FlowLine, at: int) -> int:
        """A label, the head of a do, or the end of an if."""
        return at + 1

    def _jump(self, item: FlowLine, at: int) -> int:
        """A line that always leads elsewhere."""
        return item.partner

    def _while(self, item: FlowLine, at: int) -> int:
        return at + 1 if self._numbers(item, 1)[0] else item.partner + 1

    def _until(self, item: FlowLine, at: int) -> int:
        """The while that ends a do."""
        return item.partner + 1 if self._numbers(item, 1)[0] else at + 1

    def _repeat(self, item: FlowLine, at: int) -> int:
        times = int(self._numbers(item, 1)[0])
        self.calls[-1].counts[at] = times
        return at + 1 if times > 0 else item.partner + 1

    def _end_repeat(self, item: FlowLine, at: int) -> int:
        counts = self.calls[-1].counts
        counts[item.partner] -= 1
        return item.partner + 1 if counts[item.partner] > 0 else at + 1

    def _branch(self, item: FlowLine, at: int) -> int:
        """The first branch of an if whose condition holds."""
        for index in (at, *item.branches):
            branch = self.listing.items[index]
            if isinstance(branch, FlowLine) and (branch.keyword == "ELSE" or self._numbers(branch, 1)[0]):
                return index + 1
        return item.partner + 1

    def _call(self, item: FlowLine, at: int) -> int:
        arguments = self._numbers(item)
        listing, begin = self._found(item, item.label)
        self._enter(_Call(listing, at + 1, self.calls[-1].line or self._line_in_main(listing, item), True), item)
        if len(arguments) > MAX_ARGUMENTS:
            raise LineError(item.text, f"a call takes at most {MAX_ARGUMENTS} arguments")
        own: dict[ParameterKey, float] = dict.fromkeys(range(1, MAX_ARGUMENTS + 1), 0.0)
        own.update(enumerate(arguments, start=1))
        self.parameters.own.append(own)
        return begin

    def _return(self, item: FlowLine, at: int) -> int:
        if not self.calls[-1].own:
            raise LineError(item.text, "ends no subroutine that was called")
        values = self._numbers(item)
        back = self._back()
        self.parameters.set("_value", values[0] if values else 0.0)
        self.parameters.set("_value_returned", float(bool(values)))
        return back


_CONTROLS = {
    "CALL": Flow._call,
    **dict.fromkeys(("RETURN", "ENDSUB"), Flow._return),
    "IF": Flow._branch,
    "WHILE": Flow._while,
    "UNTIL": Flow._until,
    "REPEAT": Flow._repeat,
    "ENDREPEAT": Flow._end_repeat,
    **dict.fromkeys(("BREAK", "CONTINUE", "SUB", "ELSE", "ELSEIF", "ENDWHILE"), Flow._jump),
}

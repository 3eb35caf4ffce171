"""The order in which the lines of a program are run: O words, calls, loops, conditions, and M98.

Lines without parameters, expressions and O words are kept as runs of text, which are split into words as a whole; only the
others are read one by one.  A called file is looked for beside the program; its moves count for the line of the call.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from pathlib import Path

from planner.errors import InputError
from planner.inputs import shorten
from planner.programs import SUFFIXES
from planner.programs.reading.expressions import MAX_ARGUMENTS, LineError, LineEvaluator, ParameterKey, Parameters
from planner.programs.reading.flow_lines import FlowLine, Listing, read_listing
from planner.programs.reading.flow_words import WordQueue
from planner.programs.reading.machine_parameters import ASKS, PROBE_PARAMETERS, machine_parameter
from planner.programs.reading.modal import ReadingState
from planner.programs.reading.polar import without_polar
from planner.programs.reading.saved_modes import SavedModes, restoring_blocks, saved_modes
from planner.programs.reading.words import Words

FLOW_CODES = (70.0, 71.0, 72.0, 73.0, 98.0, 99.0)  # M words that change the order of lines, or what is in force
_MODE_CODES = FLOW_CODES[:4]
_END_OF_PROGRAM = 99.0
_MAX_CALLS = 10  # within each other, as LinuxCNC has it
_MAX_WORK = 10_000_000  # plain blocks; a line that is evaluated counts for ten
_LINE_WORK = 10
_MAX_WORDS = 200_000  # that wait for the next step of the reader


@dataclass
class _Call:
    """A call that runs: where it goes on afterwards, of M98 how often it runs again, and what M70 or M73 saved in it."""

    listing: Listing
    after: int
    line: int | None
    own: bool
    begin: int = 0
    again: int = 0
    counts: dict[int, int] = field(default_factory=dict)
    saved: SavedModes | None = None
    restores: bool = False


class Flow:
    """Runs a program."""

    def __init__(self, path: Path, state: ReadingState) -> None:
        self.path, self.state = path, state
        self.machine = partial(machine_parameter, state=state)
        self.main = read_listing(path)
        self.files: dict[str, Listing] = {}
        self.parameters = Parameters(machine=self.machine)
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
                if self.queue.count and isinstance(item, FlowLine) and self._asks(item):
                    probes = self.state.probes
                    yield self.queue.take(0), None  # after this the machine stands where the line finds it
                    if self.state.probes != probes:
                        self.parameters.forget(PROBE_PARAMETERS)
                at = self._step(at)
                if self.queue.count > _MAX_WORDS:
                    yield self.queue.take(0), None
        except InputError as problem:
            error = problem
        yield self.queue.take(self.main.line_count), error

    def _asks(self, item: FlowLine) -> bool:
        """Whether a line asks for what the words before it have done."""
        returns = item.keyword in ("RETURN", "ENDSUB") or "M99" in item.text
        return ASKS.search(item.text) is not None or (returns and self.calls[-1].restores)

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
        codes = [value for letter, value, _, _ in found.words if letter == "M" and value in FLOW_CODES]
        if not codes or codes[0] in _MODE_CODES:
            line, words = self._line_of(item), [w for w in found.words if w[0] != "M" or w[1] not in _MODE_CODES]
            for block in without_polar(item.text, words, self.machine):
                self.queue.add_line(item.text, block, line)
            if codes:
                self._keep_modes(item, codes[0])
            return at + 1
        if codes[0] == _END_OF_PROGRAM:
            return self._again_or_back(item)
        return self._call_program(item, at, {letter: value for letter, value, _, _ in found.words})

    def _line_of(self, item: FlowLine) -> int:
        """The line that what an item moves counts for."""
        return self.calls[-1].line or item.line

    def _keep_modes(self, item: FlowLine, code: float) -> None:
        """M70 and M73 save what is in force, M71 forgets that, M72 brings it back."""
        call = self.calls[-1]
        if code in (70.0, 73.0):
            call.saved, call.restores = saved_modes(self.state), code == 73.0 or call.restores
        elif code == 71.0:
            call.saved = None
        elif call.saved is None:
            raise LineError(
                item.text, "nothing is saved here that it could bring back; M70 or M73 saves what is in force"
            )
        else:
            self._restore(item, call.saved)

    def _restore(self, item: FlowLine, saved: SavedModes) -> None:
        for block in restoring_blocks(saved, saved_modes(self.state)):
            texts = [f"{letter}{value:.12g}" for letter, value in block]
            places = accumulate(map(len, texts), initial=0)
            words = [(*word, at, at + len(text)) for word, at, text in zip(block, places, texts, strict=False)]
            self.queue.add_line("".join(texts), words, self._line_of(item))

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
        return self._back(item)

    def _back(self, item: FlowLine) -> int:
        if self.calls[-1].restores and self.calls[-1].saved is not None:
            self._restore(item, self.calls[-1].saved)
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
        back = self._back(item)
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

"""Reader of part programs (RS274, the dialect of LinuxCNC): every block is understood, or refused by name.

Words, blocks, modal state, moves: a module each.  A block is a line with words (``words``, ``blocks``).  Where there
are parameters, expressions or O words, the words come in the order in which lines are run (``flow``).  Modal words are
columns: each group has a value at the blocks that name it, and carries it forward to those that do not (``modal``).
Positions follow, in the machine's coordinates (``positions``, with the words that change what they count from, ``acts``),
and moves (``move_making``).  So the rules act on all blocks of some megabytes of text at once.  What the words are stands
in one table (``language``); what is wrong is collected and the first in the order of the file is raised, words that are
not read all in one message (``unread``).

Rules, where dialects differ:

1. The file starts in G17 G21 G40 G49 G54 G80 G90 G91.1 G94 G99 and G64 without a tolerance.
2. The machine's first position is unknown.  An axis whose first word is an absolute one of a rapid, or that goes home first,
   stands there from the start, so that the rapid to the start of the work takes no time; every other axis stands at 0.
3. X, Y, Z, U, V, W, I, J, K, R, and P and Q of G64 count in the units and the distance mode of their own block; an F beside
   G20 or G21 counts in the units before, as on LinuxCNC, and a note says so.
4. Changing between G93 and G94 forgets the feed.
5. The program ends with M2, M30 or the second %; what follows is not read.  A file without one may have been cut off.
6. In a block tool change, spindle and dwell come before the motion, M0, M1, M2, M30 and M60 after it.
7. Homes (G28, G30) and the origins of coordinate systems are 0 on the machine, and the length of a tool is 0, where neither
   the program nor a machine file nor a tool table says more; the notes of the program say so.  M6 moves nothing unless the
   machine file says where tools are changed: then it is a rapid there, before the change.
8. Blocks with / are passed over, and so are lines that begin with $ or ?; the notes say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from planner.errors import InputError
from planner.inputs import require_path
from planner.machine.program_setup import ProgramSetup
from planner.programs.reading.acts import carry_positions
from planner.programs.reading.blocks import Blocks, sort_words
from planner.programs.reading.compensation_words import TURN_ON, check_beside
from planner.programs.reading.flow import FLOW_CODES, Flow
from planner.programs.reading.language import MOTION, PROBES
from planner.programs.reading.modal import (
    ReadingState,
    carry_feeds,
    carry_modal,
    carry_tolerances,
    halve_diameters,
    units,
)
from planner.programs.reading.move_making import BlockFeeds, make_moves
from planner.programs.reading.offsets import Offsets
from planner.programs.reading.positions import ProgramTrack
from planner.programs.reading.program import LINE, Program
from planner.programs.reading.program_events import add_events, with_messages
from planner.programs.reading.rules import check_motion, check_words
from planner.programs.reading.setup import Tool, read_tool_table
from planner.programs.reading.spindle import carry_spindle
from planner.programs.reading.splines import check_splines
from planner.programs.reading.unread import UnreadWords, ignored_words
from planner.programs.reading.words import Faults, Words, keep_words, read_words

_TOOL_CHANGE = 6.0
_MAX_MOVES = 5_000_000  # some 120 bytes each
_MAX_EVENTS = 1_000_000


def read_program(
    path: str | Path,
    *,
    start: Sequence[float] | None = None,
    tools: str | Path | Mapping[int, Tool] | None = None,
    ignore: Sequence[str] = (),
    setup: ProgramSetup | None = None,
) -> Program:
    """Read a part program.

    Parameters
    ----------
    path : str or Path
        A text file in the language above.
    start : (3,) or (9,) sequence of float, optional
        Where the machine stands before the first block, X Y Z in mm, or X Y Z A B C U V W in mm and degrees; left out, it is
        taken from the program (rule 2 above).
    tools : str, Path or mapping of int to Tool, optional
        A tool table of LinuxCNC, or the tools by their numbers; left out, every tool has the length that the program gives
        it, or 0.
    ignore : sequence of str
        Words to pass over, each by itself, that are not read: ``("M123", "G7")``.
    setup : ProgramSetup, optional
        What the machine's file says of homes, origins, tools and where they are changed; left out, rule 7 above.

    Returns
    -------
    Program
        Moves in mm and mm/s, with their lines; m = 0 where the program moves no axis.

    Raises
    ------
    InputError
        ``file:line: word: reason`` for the first thing that is wrong, in the order of the file; of words that are not read
        all of them.
    """
    file = require_path(path)
    known = ProgramSetup() if setup is None else setup
    given = known.tools if tools is None else tools
    table = read_tool_table(given) if isinstance(given, str | Path) else given
    ignored = ignored_words(ignore)

    def begun() -> ReadingState:
        state = ReadingState(file.name, UnreadWords(file.name, ignored), Offsets.of(known, table))
        if start is not None:
            state.place(start)
        return state

    state = begun()
    in_order = _read_parts(read_words(file), state)
    if not in_order:
        state = begun()
        _read_parts(Flow(file, state).words(), state, ordered=True)
    state.unread.require_none()
    state.require_end()
    return with_messages(state.program(), file) if in_order else state.program()


def _read_parts(
    parts: Iterator[tuple[Words, InputError | None]], state: ReadingState, *, ordered: bool = False
) -> bool:
    """Read all parts; False as soon as lines are not run in the order in which they stand, where that is not seen to."""
    for every, problem in parts:
        words = _before_end(every, state)
        if not ordered and ((every.stopped and not state.ended) or _leads_elsewhere(words)):
            return False
        _read_part(words, state)
        if problem is not None and not state.ended:
            state.unread.require_none()
            raise problem
    return True


def _leads_elsewhere(words: Words) -> bool:
    """Whether there is an O word, M98, M99 or M70 to M73."""
    call = (words.letter == ord("M")) & (words.value >= 70.0) & np.isin(words.value, FLOW_CODES)
    return bool(call.any() or (words.letter == ord("O")).any())


def _before_end(words: Words, state: ReadingState) -> Words:
    """The words up to the end of the program: M2, M30 or the second %; what follows is not read."""
    if state.ended:
        return keep_words(words, slice(0, 0))
    for name, line in words.skipped:
        first, count = state.skipped.get(name, (line, 0))
        state.skipped[name] = (first, count + 1)
    mark = words.letter == ord("%")
    stop = (words.letter == ord("M")) & ((words.value == 2.0) | (words.value == 30.0))
    ends = np.flatnonzero(stop | (mark & (state.percents + np.cumsum(mark) == 2)))
    if not ends.size:
        return words
    state.ended = True
    return keep_words(
        words, slice(0, int(np.searchsorted(words.block_number, words.block_number[ends[0]], side="right")))
    )


def _read_part(every: Words, state: ReadingState) -> None:
    """Read the words of some megabytes of text; the state goes on from there."""
    for words in _from_tool_changes(every, state):
        _read_blocks(words, state)
    state.line_count += every.lines
    if state.moves > _MAX_MOVES or len(state.events) > _MAX_EVENTS:
        raise InputError(
            f"{state.source}:{state.line_count}: end of part: more than {_MAX_MOVES} moves, or {_MAX_EVENTS} stops and "
            "switches; split the program"
        )


def _from_tool_changes(words: Words, state: ReadingState) -> list[Words]:
    """The words from M6 to M6, where tools are compensated: there it has to be known where the last one ended."""
    compensated = (words.letter == ord("G")) & np.isin(words.value, TURN_ON)
    if not (state.tools or compensated.any()):
        return [words]
    change = (words.letter == ord("M")) & (words.value == _TOOL_CHANGE)
    block = words.block_number
    cuts = np.unique(np.searchsorted(block, block[change])).tolist()
    edges = [0, *cuts, block.size]
    return [keep_words(words, slice(first, last)) for first, last in pairwise(edges) if last > first]


def _read_blocks(words: Words, state: ReadingState) -> None:
    words = state.unread.without_ignored(words)
    faults = Faults(words)
    if words.line.size:
        blocks = sort_words(words, faults, state.unread)
        _check_marks(blocks, state)
        before = state.modal
        state.modal, modal = carry_modal(blocks, before)
        unit = units(modal)
        halve_diameters(blocks, modal)
        kind = check_motion(blocks, modal)
        check_words(blocks, modal[MOTION], kind)
        check_splines(blocks, modal, kind)
        check_beside(blocks, modal, before, kind)
        feeds = BlockFeeds(
            *carry_feeds(blocks, modal, unit, kind, state), *carry_tolerances(blocks, unit, state),
            carry_spindle(blocks, modal, unit, kind, state),
        )  # fmt: skip
        track = ProgramTrack(blocks, modal, unit, kind, state)
        carry_positions(track)
        _note_probes(track)
        moves = make_moves(track, feeds)
        if not state.unread.found:  # else every fault may follow from a word that is not read
            faults.raise_first()
        add_events(track, moves)
        state.parts.append(moves.columns)
        state.moves += moves.columns.line.size
        state.blocks += blocks.line.size


def _note_probes(track: ProgramTrack) -> None:
    """Where a probe would end a move is not known: moves of G38 are taken in full, which is said."""
    state = track.state
    if (track.modal[MOTION] >= PROBES[0]).any():
        rows = np.flatnonzero(np.isin(track.modal[MOTION], PROBES) & (track.kind == LINE))
        if rows.size:
            first, count = state.probes or (int(track.blocks.line[rows[0]]), 0)
            state.probes = first, count + rows.size
            state.probed = track.points[rows[-1] + 1] - track.origins(rows[-1:])[0]


def _check_marks(blocks: Blocks, state: ReadingState) -> None:
    """The %: alone in its line, the first before all blocks."""
    mark = blocks.letters["%"]
    if not mark.given.any():
        return
    faults, rows = blocks.faults, np.arange(blocks.line.size)
    several = np.diff(np.append(blocks.first, blocks.of_word.size)) > 1
    count = state.percents + np.cumsum(mark.given)
    faults.add(mark.at(several), "must stand alone in its line")
    faults.add(mark.at((count == 1) & (state.blocks + rows > 0)), "closes a file that no % opens")
    state.percents = int(count[-1])

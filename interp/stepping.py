"""The compiled steps, one sample a call, and the state they keep.  Layout of the tables: ``interp/interp.h``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from planner.compiled import core
from planner.errors import InputError
from planner.types import FloatArray

# Indices into the state, as in ``interp/step_inline.h``.
SAMPLE = 0  # number k of the last sample
SEGMENT = 1  # row of the segments, or of the feed, that holds its time
PIECE = 2  # curve piece that holds its parameter (Taylor only: a segment knows its piece)
U = 3  # its curve parameter
PERIOD_HIGH = 4  # leading 20 bits of the period T, s: times k they are exact up to k = 2^33
PERIOD_LOW = 5  # the rest of T
LAST = 6  # number of the last sample, at the end of the path
U_END = 7
DIM = 8  # number of machine axes
ROWS = 9  # rows of a curve piece
POWERS = 10  # coefficients of a row
END = 11  # dim numbers: the position at the end of the path; behind them, dim numbers: the position of the last sample

_SEGMENT_WIDTH = 8
_FEED_WIDTH = 5


class State(np.ndarray[tuple[int], np.dtype[np.float64]]):
    """What is remembered between two periods, ``(11 + 2 dim,)``; a copy of it is a snapshot.

    The sample time k T is a product, never a sum of periods, and T is split into a leading part of 20 bits and the rest:
    the time since a segment began is exact to rounding however long the plan is.

    To convert arrays to what compiled code takes costs more than the step: the first one keeps its call here, with the
    arrays it was made for.  Copies and views begin without; any other array will do as a state, but pays that every time.
    """

    quintic: tuple[Any, Any, Callable[[], int]] = (None, None, int)
    taylor: tuple[Any, Any, int, Callable[[], int]] = (None, None, 0, int)


def quintic_step(segments: FloatArray, pieces: FloatArray, state: FloatArray) -> bool:
    """Go to the next sample of the plan; True once it is the last one, which is then held.

    t = k T;  the quintic of its segment gives the curve parameter, and the curve piece the position.

    Parameters
    ----------
    segments, pieces
        ``InterpolatorTable.arrays``.
    state : (11 + 2 dim,) array
        From ``start``; changed in place.  Its last dim numbers are the sample: machine axes, mm (rad for rotary axes).

    Raises
    ------
    InputError
        If the state was made for another table.
    """
    if not isinstance(state, State):
        _require_match(segments, _SEGMENT_WIDTH, pieces, state)
        return bool(core.quintic_step(segments, pieces, state))
    first, second, call = state.quintic
    if first is not segments or second is not pieces:
        _require_match(segments, _SEGMENT_WIDTH, pieces, state)
        call = core.quintic_step.bind(segments, pieces, state)
        state.quintic = segments, pieces, call
    return call() != 0


def taylor_step(order: int, feed: FloatArray, pieces: FloatArray, state: FloatArray) -> bool:
    """Go to the next sample by a Taylor step of order 1, 2 or 3; True once it is the last one, which is then held.

    u_{k+1} = u_k + T u' + T^2/2 u'' + T^3/6 u'''  with V, A, J of the plan at t_k and C', C'', C''' at u_k:

        u'   = V / |C'|
        u''  = A / |C'| - V^2 (C'.C'') / |C'|^4
        u''' = (J - 3 |C'|' u' u'' - |C'|'' u'^3) / |C'|

    (Cheng, Tsai, Cheng 2002, equations 4 to 9, carried on by one term.)  A step never goes back, nor beyond the end of
    the path; the last sample is that end, whatever the steps have accumulated.

    Parameters
    ----------
    order : int
        1, 2 or 3.
    feed, pieces
        ``TaylorTable.arrays``.
    state : (11 + 2 dim,) array
        From ``start``; changed in place.  Its last dim numbers are the sample: machine axes, mm (rad for rotary axes).

    Raises
    ------
    InputError
        If the order is another one, or the state was made for another table.
    """
    if not isinstance(state, State):
        _require_order(order)
        _require_match(feed, _FEED_WIDTH, pieces, state)
        return bool(core.taylor_step(order, feed, pieces, state))
    first, second, third, call = state.taylor
    if first is not feed or second is not pieces or third != order:
        _require_order(order)
        _require_match(feed, _FEED_WIDTH, pieces, state)
        call = core.taylor_step.bind(order, feed, pieces, state)
        state.taylor = feed, pieces, order, call
    return call() != 0


def _require_order(order: int) -> None:
    if order not in (1, 2, 3):
        raise InputError(f"order = {order!r} must be 1, 2 or 3")


def _require_match(table: FloatArray, width: int, pieces: FloatArray, state: FloatArray) -> None:
    """Raise InputError where compiled code would read beyond an array."""
    expected = [width, *pieces.shape[1:], (state.size - END) / 2]
    if state.size <= END or [table.shape[-1], state[ROWS], state[POWERS], state[DIM]] != expected:
        raise InputError(
            f"state of {state.size} numbers does not belong to these arrays, {table.shape} and {pieces.shape}; make it "
            "with start() from their table"
        )

"""Random tables for the compiled steps, as ``interp/interp.h`` lays them out, and what makes two results the same."""

from __future__ import annotations

import numpy as np

from interp import stepping
from interp.stepping import State

EXACT_PERIOD = 2.0**-10  # s


def same_bits(found, expected):
    """Whether two arrays hold the same numbers, -0 apart from 0; a nan is like any other."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    alike = np.isnan(found) & np.isnan(expected)
    return bool(((found.view(np.int64) == expected.view(np.int64)) | alike).all())


def random_pieces(rng, *, tip):
    """Pieces (m + 1, rows, powers) of up to six axes, rational or not, and their number of axes."""
    count, dim, powers = (int(rng.integers(*span)) for span in ((1, 7), (1, 7), (2, 10)))
    rational = tip or bool(rng.integers(2))
    sizes = [dim + rational] + [int(rng.integers(2, 4)) + 1] * tip
    pieces = np.zeros((count + 1, 1 + sum(sizes), powers))
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, count))])
    pieces[:-1, 0, 0], pieces[:-1, 0, 1], pieces[-1, 0, 0] = breaks[:-1], np.diff(breaks), np.inf
    pieces[:-1, 1:] = rng.normal(0.0, 10.0, (count, sum(sizes), powers))
    if rational:  # away from 0 all over [0, 1]
        for last in np.cumsum(sizes):
            pieces[:-1, last] = rng.uniform(-0.05, 0.05, (count, powers))
            pieces[:-1, last, -1] = rng.uniform(0.9, 1.1, count)
    return pieces, dim


def random_times(rng, size):
    """Times from 0 to 60 ms: one twice, and some that are samples of the exact period to the bit."""
    times = np.sort(np.concatenate([rng.uniform(0.0, 0.06, size - 3), EXACT_PERIOD * np.array([5.0, 19.0, 40.0])]))
    times[0], times[8] = 0.0, times[7]
    return times


def random_segments(rng, count):
    """Segments (n + 1, 8) within 60 ms over the pieces; their quintics leave [0, 1] now and then."""
    size = 25
    segments = np.zeros((size + 1, 8))
    times = random_times(rng, size)
    segments[:-1, 0], segments[-1, 0] = times, np.inf
    segments[:-1, 1] = rng.uniform(-0.2, 1.0, size)
    segments[:-1, 2:7] = rng.normal(0.0, 1.0, (size, 5)) * 100.0 ** np.arange(1, 6) / 3.0
    segments[:-1, 7] = np.sort(rng.integers(0, count, size))
    return segments


def random_feed(rng):
    """Feed (n + 1, 5) within 60 ms, negative now and then."""
    size = 25
    feed = np.zeros((size + 1, 5))
    times = random_times(rng, size)
    feed[:-1, 0], feed[-1, 0] = times, np.inf
    feed[:-1, 1] = rng.uniform(0.0, 300.0, size)
    feed[:-1, 2:] = rng.normal(0.0, 1.0, (size, 3)) * 100.0 ** np.arange(2, 5)
    return feed


def random_state(rng, pieces, dim, last):
    """A state at the start of the pieces, with a period of about 1 ms, every other time an exact one."""
    state = np.zeros(stepping.END + 2 * dim).view(State)
    period = EXACT_PERIOD if rng.integers(2) else float(rng.uniform(0.9e-3, 1.1e-3))
    high = float(np.float32(period))
    state[stepping.PERIOD_HIGH], state[stepping.PERIOD_LOW] = high, period - high
    state[stepping.LAST] = last
    state[stepping.U_END] = pieces[-2, 0, 0] + pieces[-2, 0, 1]
    state[stepping.DIM], state[stepping.ROWS], state[stepping.POWERS] = dim, *pieces.shape[1:]
    state[stepping.END :] = rng.normal(0.0, 10.0, 2 * dim)
    return state

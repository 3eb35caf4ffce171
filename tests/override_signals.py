"""Signals of override and hold that try to break the limits, and the measure of what comes of them.

The measure knows nothing of the governor: finite differences of the positions against the limits of the machine.
"""

from __future__ import annotations

import numpy as np


def ratios(positions, period, limits, *, ends):
    """Largest share of velocity, acceleration and jerk that samples (n, dim) use; at rest before, and after if ``ends``."""
    q = np.concatenate([np.repeat(positions[:1], 3, axis=0), positions])
    if ends:
        q = np.concatenate([q, np.repeat(positions[-1:], 3, axis=0)])
    allowed = (limits.velocity, limits.acceleration, limits.jerk)
    return np.array(
        [(np.abs(np.diff(q, k, axis=0)) / period**k / allowed[k - 1]).max() for k in (1, 2, 3)]  # a row each
    )


def random_signal(rng, count, period):
    """Override (count,) and hold (count,): noise, steps, ramps, switches and walks, at time scales of ms to seconds."""
    length = int(np.exp(rng.uniform(0.0, np.log(1.0 / period)))) + 1
    blocks = -(-count // length)
    kind = rng.integers(6)
    if kind == 0:
        override = rng.random(count)
    elif kind == 1:
        override = np.repeat(rng.random(blocks), length)[:count]
    elif kind == 2:
        override = np.interp(np.arange(count), np.arange(blocks + 1) * length, rng.random(blocks + 1))
    elif kind == 3:
        override = np.repeat(rng.integers(0, 2, blocks), length)[:count].astype(float)
    elif kind == 4:
        override = np.clip(np.cumsum(rng.normal(0.0, rng.uniform(0.001, 0.1), count)) + 0.5, 0.0, 1.0)
    else:
        override = np.repeat(np.clip(rng.normal(0.97, 0.05, blocks), 0.0, 1.0), length)[:count]
    hold = np.zeros(count, dtype=bool)
    if rng.random() < 0.5:
        hold = np.repeat(rng.random(blocks) < rng.uniform(0.05, 0.6), length)[:count]
    return override, hold


def adversary(step, limits, periods, *, ahead=3):
    """Positions of a run whose override is chosen, period by period, for the largest jerk of the next ones.

    Each of the commands 0, 1, the rate as it is, and just below it is tried for the next ``ahead`` periods, alone and
    followed by its opposite; the one after which the third differences are largest is taken for one period.
    """
    start = step.position.copy()
    rows = [start, start, start, start]
    for _ in range(periods):
        if step.done:
            break
        here, best, chosen = step.snapshot(), -1.0, 1.0
        rate = step.rate
        for command in (0.0, 1.0, rate, max(0.0, rate - 0.01), min(1.0, rate + 0.01)):
            for later in (command, 1.0 - round(command)):
                tail, _ = step.run(ahead, np.array([command] + [later] * (ahead - 1)))
                step.restore(here)
                q = np.concatenate([rows[-3:], tail])
                worst = float((np.abs(np.diff(q, 3, axis=0)) / limits.jerk).max())
                if worst > best:
                    best, chosen = worst, command
        step.step(chosen)
        rows.append(step.position.copy())
    return np.array(rows[3:])

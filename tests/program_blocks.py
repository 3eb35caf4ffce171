"""Part programs from a few moves, for the tests of paths."""

import numpy as np

from planner.geometry.curve import AXES
from planner.programs.reading.program import ARC, LINE, RAPID, Program


def line(x, y, z=0.0, *others, **words):
    """A straight move to a point: X Y Z, mm, and as many as there are of A B C, degrees, and U V W, mm."""
    return {"kind": LINE, "end": (x, y, z, *others)} | words


def rapid(x, y, z=0.0, *others):
    """A rapid move to a point."""
    return {"kind": RAPID, "end": (x, y, z, *others), "feed": np.inf}


def arc(end, centre, turns, *, normal=2, **words):
    """An arc to a point around a centre; ``turns`` gives the sense, +1 counterclockwise."""
    end, centre = _point(end, len(AXES)), _point(centre, 3)
    return {"kind": ARC, "end": end, "centre": centre, "turns": turns, "normal": normal} | words


def _point(numbers, count):
    return (*numbers, *[0.0] * (count - len(numbers)))


def program(*moves, start=(0.0, 0.0, 0.0), feed=100.0, tolerance=np.nan):
    """A program of the moves, from a start."""
    count = len(moves)
    points = np.array([_point(point, len(AXES)) for point in (start, *(move["end"] for move in moves))], dtype=float)
    starts, ends = points[:-1], points[1:]
    centres = np.array([move.get("centre", (np.nan,) * 3) for move in moves], dtype=float)
    normal = np.array([move.get("normal", 2) for move in moves], dtype=np.uint8)
    sweep = np.zeros(count)
    for k, move in enumerate(moves):
        if move["kind"] == ARC:
            i, j = (normal[k] + 1) % 3, (normal[k] + 2) % 3
            a, b = starts[k, :3] - centres[k], ends[k, :3] - centres[k]
            turn = np.arctan2(a[i] * b[j] - a[j] * b[i], a[i] * b[i] + a[j] * b[j]) % (2.0 * np.pi)
            turn = turn if turn > 1e-12 else 2.0 * np.pi
            sweep[k] = turn if move["turns"] > 0 else (turn - 2.0 * np.pi if turn < 2.0 * np.pi - 1e-12 else -turn)
            centres[k, normal[k]] = starts[k, normal[k]]
    moves_axis = np.ptp(points, axis=0) > 0.0
    return Program(
        source="blocks",
        line=np.arange(1, count + 1),
        kind=np.array([move["kind"] for move in moves], dtype=np.uint8),
        start=starts,
        end=ends,
        centre=centres,
        normal=normal,
        sweep=sweep,
        curve=np.full(count, -1),
        feed=np.array([move.get("feed", feed) for move in moves], dtype=float),
        stop_after=np.array([move.get("stop", False) for move in moves]),
        tolerance=np.array([move.get("tolerance", tolerance) for move in moves], dtype=float),
        naive_tolerance=np.full(count, np.nan),
        modal_feed=np.array([move.get("feed", feed) for move in moves], dtype=float),
        exact_stop=np.zeros(count, dtype=np.bool_),
        events=(),
        zero_lines=np.empty(0, dtype=np.int64),
        line_count=count,
        axis_lines=moves_axis.astype(np.int64),
    )


def polyline(points, **words):
    """A program of straight moves through points (n, 2) or (n, 3)."""
    p = np.asarray(points, dtype=float)
    p = np.column_stack([p, np.zeros((p.shape[0], 3 - p.shape[1]))])
    return program(*(line(*q) for q in p[1:]), start=tuple(p[0]), **words)

"""Path and feed of a few blocks as one nonlinear program, solved by IPOPT: an oracle of the joint solver.

Written from the statement of the problem, and from nothing of ``planner.joint`` but the run: jerk constant on every segment,
so that position, velocity and acceleration are its exact integrals; a stretch of segments shares a free duration.  With B_k
the blocks, V_k the points where they meet and e_k the tolerances,

    min sum of the durations
    rest at the ends, there at V_0 and V_n
    |j_i| <= J,  |a_i| <= A,  |v_i| <= V         of every axis i
    |v| <= F_k                                    on block k
    there is an x in [0, L_k] with |q - B_k(x)| <= e_k         on block k
    |q - V_k| <= min(e_k-1, e_k)                  where block k - 1 ends and block k begins

The foot x of every place on the block is an unknown of its own: no distance, no clamping, and lines and arcs are alike.  The
last three lines hold at ``PLACES`` of every segment; where the motion leaves the tube between them, they hold more narrowly
in the next pass.  So each motion found is possible, and the least of several grids is at most some 1e-4 above the optimum.

    python tests/joint_reference.py        finds the optima again and writes data/joint_optima.json, some ten minutes
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import casadi
import numpy as np

from planner.geometry.blend import Legs
from planner.joint.joint_run import JointMotion, JointRun

OPTIMA = Path(__file__).parent / "data" / "joint_optima.json"
TIME = 1e-2  # s, the unit of time in the program
PLACES = (0.0, 0.17, 0.33, 0.5, 0.67, 0.83)  # of a segment
ZONE = 6.0  # (e / J)^(1/3): how long before and after a corner the path leaves its block
WITHIN = 1.0002  # of the tolerance, what a motion may use that counts
GRIDS = (
    (4, 3, 4, False),
    (6, 4, 4, False),
    (4, 3, 4, True),
    (6, 4, 4, True),
)  # several, since on each IPOPT may stop in another local optimum
DILATED = 1.1  # how much slower than the stopping motion the start is


def polygon(points, tolerance, **changed):
    """A run along straight lines between points (n + 1, d)."""
    at = np.asarray(points, dtype=float)
    step = np.diff(at, axis=0)
    length = np.sqrt((step**2).sum(axis=1))
    vectors = np.zeros((length.size, 4, at.shape[1]))
    vectors[:, 0], vectors[:, 3] = at[:-1], step / length[:, None]
    return run_along(Legs(vectors, np.zeros((length.size, 2))), length, tolerance, **changed)


def run_along(legs, length, tolerance, **changed):
    """A run of the mill's limits: 100 mm/s along the path, 250 mm/s, 1000 mm/s^2 and 20 000 mm/s^3 an axis."""
    n, d = length.size, legs.vectors.shape[2]
    given = {
        "tolerance": np.broadcast_to(np.asarray(tolerance, dtype=float), n),
        "feed": np.full(n, 100.0),
        "velocity": np.full(d, 250.0),
        "acceleration": np.full(d, 1000.0),
        "jerk": np.full(d, 20000.0),
    }
    return JointRun(legs, length, **(given | changed))


def turning(first, turn, second, tolerance, **changed):
    """Two legs in the plane with a turn between them, in degrees, the first along x."""
    angle = np.deg2rad(turn)
    return polygon(
        [[0.0, 0.0], [first, 0.0], [first + second * np.cos(angle), second * np.sin(angle)]], tolerance, **changed
    )


def arc_and_line(radius, angle, length, corner, tolerance):
    """An arc from the origin along x, bending left by ``angle``, and a line turned by ``corner`` from its end (degrees)."""
    angle, corner = np.deg2rad(angle), np.deg2rad(corner)
    end = radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    vectors = np.zeros((2, 4, 2))
    vectors[0, :3] = [[0.0, radius], [0.0, -radius], [radius, 0.0]]
    vectors[1, 0], vectors[1, 3] = end, [np.cos(angle + corner), np.sin(angle + corner)]
    legs = Legs(vectors, np.array([[1.0 / radius, 0.0], [0.0, 0.0]]))
    return run_along(legs, np.array([radius * angle, length]), tolerance)


def cases():
    """The small runs whose optima are kept, by name."""
    return {
        "90 degrees, 1 um": turning(20.0, 90.0, 20.0, 1e-3),
        "90 degrees, 10 um": turning(20.0, 90.0, 20.0, 1e-2),
        "90 degrees, 50 um": turning(20.0, 90.0, 20.0, 5e-2),
        "135 degrees, 10 um": turning(12.0, 135.0, 12.0, 1e-2),
        "30 degrees, 20 um": turning(8.0, 30.0, 12.0, 2e-2),
        "170 degrees, 10 um": turning(10.0, 170.0, 6.0, 1e-2),
        "three legs in space, 20 um": polygon([[0, 0, 0], [8, 2, 1], [6, 7, 4], [12, 9, -2]], 2e-2),
        "arc and line, 10 um": arc_and_line(6.0, 90.0, 10.0, 60.0, 1e-2),
    }


def stopping(length, feed, acceleration, jerk):
    """Durations and jerks (7,) of the fastest motion from rest to rest along a line."""

    def ramp(speed):
        rise = min(np.sqrt(speed / jerk), acceleration / jerk)
        return rise, max(speed / (jerk * rise) - rise, 0.0)

    def way(speed):
        rise, held = ramp(speed)
        return speed * (2.0 * rise + held)  # of both ramps

    low, high = 0.0, feed
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if way(middle) < length else (low, middle)
    rise, held = ramp(high)
    cruise = max(length - way(high), 0.0) / high
    return np.array([rise, held, rise, cruise, rise, held, rise]), jerk * np.array([1, 0, -1, 0, -1, 0, 1.0])


def moved(state, jerk, h):
    """Position, velocity and acceleration a time h later."""
    p, v, a = state
    return p + h * (v + h * (a / 2.0 + h * jerk / 6.0)), v + h * (a + h * jerk / 2.0), a + h * jerk


def stopping_motion(run):
    """The motion along lines that stops at the end of each, from its closed form."""
    t, states, jerks, leg = [0.0], [np.zeros((3, run.dim))], [], []
    states[0][0] = run.starts[0]
    for block, length in enumerate(run.lengths):
        direction = run.legs.vectors[block, 3]
        share = np.abs(direction)
        with np.errstate(divide="ignore"):
            velocity, acceleration, jerk = ((a / share).min() for a in (run.velocity, run.acceleration, run.jerk))
        for h, j in zip(*stopping(length, min(velocity, run.feed[block]), acceleration, jerk), strict=True):
            if h > 1e-12:
                states.append(np.array(moved(states[-1], j * direction, h)))
                t.append(t[-1] + h)
                jerks.append(j * direction)
                leg.append(block)
    return JointMotion(np.array(t), *np.array(states).transpose(1, 0, 2), np.array(jerks), np.array(leg))


@dataclass
class Course:
    """The stopping motion along a block, and how its time is divided: stretches of ``inside`` segments each."""

    durations: np.ndarray
    jerks: np.ndarray
    stretches: np.ndarray

    @classmethod
    def of(cls, run, block, zone, middle, split):
        feed, acceleration, jerk = run.feed[block], run.acceleration.min(), run.jerk.min()
        if run.legs.curved[block]:  # slow enough for what the bend asks of the axes
            radius = float(run.legs.radius(np.array([block]))[0])
            feed = min(feed, 0.5 * np.sqrt(acceleration * radius), 0.5 * np.cbrt(jerk * radius**2))
            acceleration, jerk = 0.4 * acceleration, 0.2 * jerk
        durations, jerks = stopping(run.lengths[block], feed, acceleration, jerk)
        total = durations.sum()
        end = min(ZONE * np.cbrt(run.tolerance[block] / run.jerk.min()), 0.3 * total)
        even, near = np.linspace(end, total - end, middle + 1), np.linspace(0.0, end, zone + 1)
        if split:
            edges = np.cumsum(durations)
            edges = edges[(edges > 1.05 * end) & (edges < total - 1.05 * end)]
            apart = 0.3 * (even[1] - even[0])
            even = np.concatenate([edges, [x for x in even[1:-1] if np.abs(edges - x).min(initial=np.inf) > apart]])
        parts = np.diff(np.unique(np.concatenate([near, even, total - near])))
        return cls(durations, jerks, parts[parts > 1e-9])

    def at(self, t):
        """Way, speed and acceleration at times (k,)."""
        edges = np.concatenate([[0.0], np.cumsum(self.durations)])
        states = [(0.0, 0.0, 0.0)]
        for jerk, h in zip(self.jerks, self.durations, strict=True):
            states.append(moved(states[-1], jerk, h))
        i = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, 6)
        return moved(np.array(states)[i].T, self.jerks[i], t - edges[i])


class Program:
    """Unknowns, constraints and start of a nonlinear program, gathered piece by piece."""

    def __init__(self):
        self.unknowns, self.lower, self.upper, self.start = [], [], [], []
        self.rows, self.row_lower, self.row_upper = [], [], []

    def unknown(self, start, upper=np.inf, lower=None):
        """New unknowns between ``lower`` (-``upper`` if left out) and ``upper``."""
        start = np.atleast_1d(np.asarray(start, dtype=float))
        x = casadi.SX.sym(f"x{len(self.unknowns)}", start.size)
        self.unknowns.append(x)
        self.start.append(start)
        self.upper.append(np.broadcast_to(upper, start.size))
        self.lower.append(np.broadcast_to(-np.asarray(upper) if lower is None else lower, start.size))
        return x

    def require(self, row, upper, lower=-np.inf):
        """``lower`` <= ``row`` <= ``upper``."""
        self.rows.append(row)
        self.row_lower.append(np.broadcast_to(lower, row.numel()))
        self.row_upper.append(np.broadcast_to(upper, row.numel()))

    def solve(self, objective, wanted, tolerance):
        """The values of the expressions ``wanted`` where the objective is least, and the number of iterations."""
        x = casadi.vertcat(*self.unknowns)
        options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 3000}
        options |= {"ipopt.tol": tolerance, "ipopt.mu_init": 1e-2}
        solver = casadi.nlpsol("joint", "ipopt", {"x": x, "f": objective, "g": casadi.vertcat(*self.rows)}, options)
        found = solver(
            x0=np.concatenate(self.start),
            lbx=np.concatenate(self.lower),
            ubx=np.concatenate(self.upper),
            lbg=np.concatenate(self.row_lower),
            ubg=np.concatenate(self.row_upper),
        )
        facts = solver.stats()
        if not facts["success"]:
            raise RuntimeError(f"IPOPT: {facts['return_status']}")
        return [np.array(value) for value in casadi.Function("wanted", [x], wanted)(found["x"])], facts["iter_count"]


class Transcription:
    """The nonlinear program of a run; lengths in ``unit`` mm, times in ``TIME`` s."""

    def __init__(self, run, grid, shares):
        zone, middle, self.inside, split = grid
        self.run, self.unit = run, run.jerk.max() * TIME**3
        self.program, self.shares = Program(), shares
        self.tolerance = run.tolerance / self.unit
        axes = (run.velocity, run.acceleration, run.jerk)
        self.limits = [limit * TIME**k / self.unit for k, limit in enumerate(axes, start=1)]
        rest = np.zeros(run.dim)
        self.states = [tuple(casadi.SX(casadi.DM(x)) for x in (run.starts[0] / self.unit, rest, rest))]
        self.jerks, self.steps, self.blocks, self.total = [], [], [], casadi.SX(0)
        for block in range(run.lengths.size):
            self.add_block(block, Course.of(run, block, zone, middle, split))
            if block + 1 < run.lengths.size:
                away = self.states[-1][0] - casadi.DM(run.ends[block] / self.unit)
                self.program.require(casadi.sumsqr(away / self.tolerance[block : block + 2].min()), 1.0)
        for reached, wanted in zip(self.states[-1], (run.ends[-1] / self.unit, rest, rest), strict=True):
            self.program.require(reached, wanted, wanted)

    def started(self, block, course, t):
        """Way, position, velocity and acceleration of the start at a time along a block."""
        x, speed, bend = (float(part[0]) for part in course.at(np.array([t])))
        x = min(max(x, 0.0), self.run.lengths[block])
        q, d1, d2, _ = self.run.legs.at(np.array([block]), np.array([x]))[:, 0]
        v, a = d1 * speed / DILATED, (d2 * speed**2 + d1 * bend) / DILATED**2
        return x / self.unit, q / self.unit, v * TIME / self.unit, a * TIME**2 / self.unit

    def add_block(self, block, course):
        """Segments along a block, from the state reached so far on."""
        began = 0.0
        for share in course.stretches:
            duration = self.program.unknown(share * DILATED / TIME, np.inf, 0.02 * share / TIME)
            self.total += duration
            for k in range(self.inside):
                edges = began + share * np.array([k, k + 1]) / self.inside
                self.add_segment(block, course, edges, duration / self.inside)
            began += share

    def add_segment(self, block, course, edges, step):
        """One segment: its jerk, the state at its end, and what holds at its places."""
        program = self.program
        tolerance = self.tolerance[block] * (self.shares[len(self.steps)] if self.shares is not None else 1.0)
        begins, ends = (self.started(block, course, t) for t in edges)
        guess = (ends[3] - begins[3]) / ((edges[1] - edges[0]) * DILATED / TIME)
        jerk = program.unknown(np.clip(guess, -self.limits[2], self.limits[2]), self.limits[2])
        for place in PLACES:
            p, v, _ = moved(self.states[-1], jerk, place * step)
            x = self.started(block, course, edges[0] + place * (edges[1] - edges[0]))[0]
            foot = program.unknown(x, self.run.lengths[block] / self.unit, 0.0)
            program.require(casadi.sumsqr(p - self.point(block, foot)) / tolerance, tolerance)
            if np.isfinite(self.run.feed[block]):
                program.require(casadi.sumsqr(v * (self.unit / TIME / self.run.feed[block])), 1.0)
        bounds = (np.inf, *self.limits[:2])
        after = tuple(program.unknown(x, bound) for x, bound in zip(ends[1:], bounds, strict=True))
        for new, reached in zip(after, moved(self.states[-1], jerk, step), strict=True):
            program.require(new - reached, 0.0, 0.0)
        self.states.append(after)
        self.jerks.append(jerk)
        self.steps.append(step)
        self.blocks.append(block)

    def point(self, block, x):
        """The point of a block at way x."""
        vectors = self.run.legs.vectors[block].copy()
        vectors[:3] /= self.unit
        o, e1, e2, g = (casadi.DM(vector) for vector in vectors)
        angle = self.run.legs.rates[block, 0] * self.unit * x
        return o + e1 * casadi.cos(angle) + e2 * casadi.sin(angle) + g * x

    def solve(self, tolerance):
        """The fastest motion."""
        wanted = [casadi.horzcat(*(state[k] for state in self.states)) for k in range(3)]
        wanted += [casadi.horzcat(*self.jerks), casadi.horzcat(*self.steps)]
        (q, v, a, jerk, step), count = self.program.solve(self.total, wanted, tolerance)
        t = np.concatenate([[0.0], np.cumsum(step.ravel())]) * TIME
        states = [part.T * self.unit / TIME**k for k, part in enumerate((q, v, a, jerk))]
        return JointMotion(t, *states, np.array(self.blocks), count)


def used_tolerance(run, motion):
    """The largest distance from its block on every segment (m,), as a share of the tolerance."""
    shares = np.linspace(0.0, 1.0, 41)
    out = np.empty(motion.leg.size)
    for i, block in enumerate(motion.leg):
        state = motion.position[i], motion.velocity[i], motion.acceleration[i]
        h = shares[:, None] * (motion.t[i + 1] - motion.t[i])
        out[i] = distances(run, block, moved(state, motion.jerk[i], h)[0]).max() / run.tolerance[block]
    return out


def distances(run, block, points):
    """Distances of points (k, d) to a line or an arc in the plane, by their formulas."""
    o, e1, e2, g = run.legs.vectors[block]
    length = run.lengths[block]
    if not run.legs.curved[block]:
        x = np.clip((points - o) @ g, 0.0, length)
        return np.linalg.norm(points - o - x[:, None] * g, axis=1)
    radius, sweep = np.linalg.norm(e1), run.legs.rates[block, 0] * length
    angle = np.arctan2((points - o) @ e2, (points - o) @ e1)
    away = np.abs(np.linalg.norm(points - o, axis=1) - radius)
    ends = np.stack([np.linalg.norm(points - end, axis=1) for end in (run.starts[block], run.ends[block])])
    return np.where((angle >= 0.0) & (angle <= sweep), away, ends.min(axis=0))


def solve_reference(run, grid=GRIDS[0], *, passes=4, tolerance=1e-6):
    """The fastest motion along a run of lines and of arcs in the plane of less than half a turn.

    Where a motion leaves the tube between its places, the next pass holds the places of that segment to so much less.

    Parameters
    ----------
    run : JointRun
    grid : (int, int, int, bool)
        Numbers of stretches near each end of a block and between them, and of segments of equal duration in each;
        whether those between end where the jerk of the stopping motion changes.
    passes : int
    tolerance : float
        Of IPOPT.

    Returns
    -------
    motion : JointMotion
        Of the last pass.
    used : float
        The largest share of a tolerance that it uses.

    Raises
    ------
    RuntimeError
        IPOPT does not converge.
    """
    shares = None
    for _ in range(passes):
        transcription = Transcription(run, grid, shares)
        motion = transcription.solve(tolerance)
        used = used_tolerance(run, motion)
        shares = (1.0 if shares is None else shares) / np.maximum(used, 1.0)
        if used.max() <= WITHIN:
            break
    return motion, float(used.max())


def optimum(run):
    """Time, s, and grid of the fastest motion found that stays within its tolerance."""
    found = []
    for grid in GRIDS:
        try:
            motion, used = solve_reference(run, grid)
        except RuntimeError:
            continue
        if used <= WITHIN:
            found.append((motion.duration, grid))
    return min(found)


def main():
    optima = {}
    for name, run in cases().items():
        seconds, grid = optimum(run)
        optima[name] = {"seconds": round(seconds, 6), "grid": grid}
        print(f"{name:32} {seconds:.6f} s on {grid}", flush=True)
    OPTIMA.write_text(json.dumps(optima, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

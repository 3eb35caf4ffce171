"""Certificates by closed form, for tests: the multipliers of the time-optimal straight line, in its own time."""

import itertools

import numpy as np

from planner.certificate import Certificate, CertificateSection


def coefficients(knots, quadratics):
    """B-spline coefficients of a continuous piecewise quadratic, given as (value, slope, curvature) at interval starts."""
    h = np.diff(knots)
    start, slope, bend = np.array(quadratics, dtype=float).T
    end = start[-1] + slope[-1] * h[-1] + 0.5 * bend[-1] * h[-1] ** 2
    return np.concatenate([[start[0]], start + 0.5 * slope * h, [end]])


def line_section(length, velocity, acceleration, jerk):
    """Seven phases from rest to rest: jerk J for t1 = A / J, acceleration A until t2, jerk -J, velocity V, and back.

    The multipliers are those of Pontryagin's principle, with sigma = t: in the first phase l = 1 - b t + J/(2V) t^2, in
    the second l = 0 and m = 1 - v/V, in the third l = J/(2V) s (s - t1) at the time s before its end, then none.
    """
    t1 = acceleration / jerk
    t2 = velocity / acceleration
    t3 = t2 + t1
    total = length / velocity + t3
    assert t2 > t1, "the acceleration is not reached"
    assert total > 2.0 * t3, "the velocity is not reached"
    phases = np.array([0.0, t1, t2, t3])
    whole = np.concatenate([phases, total - phases[::-1]])
    v1 = 0.5 * acceleration * t1
    at = {
        0: (0.0, 0.0, 0.0),
        1: (v1 * t1 / 3.0, v1, acceleration),
        2: (v1 * t1 / 3.0 + 0.5 * velocity * (t2 - t1), velocity - v1, acceleration),
        3: (0.5 * velocity * t3, velocity, 0.0),
    }
    u = np.array([at[k] for k in range(4)] + [(length - at[k][0], at[k][1], -at[k][2]) for k in (3, 2, 1, 0)]).T
    b = (1.0 + v1 / velocity) / t1
    bend = jerk / velocity
    pieces = [(1.0, -b, bend), (0.0, 0.0, 0.0), (0.0, -0.5 * bend * t1, bend), (0.0, 0.0, 0.0)]
    pieces += [(0.0, -0.5 * bend * t1, bend), (0.0, 0.0, 0.0), (0.0, b - bend * t1, bend)]
    m1, m2 = 1.0 - v1 / velocity, v1 / velocity
    left = np.array([0.0, 0.0, m2, 0.0, 0.0, 0.0, -m1, 0.0])
    right = np.array([0.0, m1, 0.0, 0.0, 0.0, -m2, 0.0, 0.0])
    # Every inner knot is double: l has a kink there, and m jumps.
    twice = np.array([0, *np.repeat(np.arange(1, 7), 2), 7])
    sigma = whole[twice]
    some = []
    for k in range(7):
        some += [pieces[k], (0.0, 0.0, 0.0)]
    row = coefficients(sigma, some[:-1])
    # the coefficient of an empty interval is the value there, which is 0 at every double knot of these
    m = np.array([right[0], *np.stack([left[1:7], right[1:7]], axis=1).reshape(-1), left[7]])
    return CertificateSection(sigma, u[:, twice], row[None], m[None], 0.0, 0.0, np.nan), total


def line_certificate(curve, length, velocity, acceleration, jerk):
    section, total = line_section(length, velocity, acceleration, jerk)
    return Certificate((section,), ("jerk X",), ("acceleration X",), total, curve.fingerprint, periodic=False)


def smooth_certificate(curve, stops=(), *, seed, knots=24, jerk=0.3, acceleration=0.05, feeds=(0.0, 0.0), **others):
    """Random smooth multipliers on a smooth coordinate, double knots at the knots of the curve; it claims nothing.

    Between stops u grows as the quintic step 10 r^3 - 15 r^4 + 6 r^5, at an end with a feed linearly.
    """
    rng = np.random.default_rng(seed)
    corners = [b.u for b in curve.breaks if b.geometric == 0]
    at = [curve.domain[0], *sorted({*corners, *stops}), curve.domain[1]]
    sections = []
    for k, (u0, u1) in enumerate(itertools.pairwise(at)):
        ends = (feeds[0] if k == 0 else 0.0, feeds[1] if k == len(at) - 2 else 0.0)
        sections.append(_smooth_section(curve, u0, u1, ends, rng, knots, jerk, acceleration))
    names = [f"{{}} {axis}" for axis in curve.axes] + ["tangential {}"]
    jerk_names, acceleration_names = (tuple(name.format(what) for name in names) for what in ("jerk", "acceleration"))
    return Certificate(
        tuple(sections), jerk_names, acceleration_names, 0.0, curve.fingerprint, others.get("periodic", False)
    )


def _smooth_section(curve, u0, u1, ends, rng, count, jerk, acceleration):
    # The step with its slope at either end: u = u0 + (u1 - u0) * p(r), p' = 30 r^2 (1-r)^2 at rests.
    slopes = [0.0 if feed == 0.0 else 1.0 for feed in ends]
    basis = np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]])
    tail = np.linalg.solve(basis, [1.0 - slopes[0], slopes[1] - slopes[0], 0.0])
    p = np.polynomial.Polynomial([0.0, slopes[0], 0.0, *tail])
    breaks = curve._candidate_breaks()
    breaks = breaks[(breaks > u0) & (breaks < u1)]
    span = u1 - u0
    lo, hi = np.zeros(breaks.size), np.ones(breaks.size)
    for _ in range(70):
        middle = 0.5 * (lo + hi)
        below = u0 + span * p(middle) < breaks
        lo, hi = np.where(below, middle, lo), np.where(below, hi, middle)
    r = np.unique(np.concatenate([np.linspace(0.0, 1.0, count), hi]))
    twice = np.isin(r, hi)
    length = rng.uniform(0.5, 2.0)  # the unit of sigma must not matter
    u = np.stack([u0 + span * p(r), span * p.deriv()(r) / length, span * p.deriv(2)(r) / length**2])
    u[0, twice] = breaks
    u[0, [0, -1]] = u0, u1
    repeat = np.where(twice, 2, 1)
    sigma, u = np.repeat(r * length, repeat), np.repeat(u, repeat, axis=1)
    motions, n = curve.dim + 1, sigma.size
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, motions, 3, 1))

    def waves(which, size, places):
        return size * np.sum(np.sin(phase[which] + np.array([1.0, 2.0, 3.0])[:, None] * 4.0 * places), axis=1) / motions

    bumps = rng.uniform(-0.1, 0.1, (motions, n))
    l_row = waves(0, jerk, np.linspace(0.0, 1.0, n + 1))
    m_row = (waves(1, acceleration, sigma / length) + acceleration * bumps * np.repeat(twice, repeat)) / length
    return CertificateSection(sigma, u, l_row, m_row, *ends, np.nan)


def arc_section(line, feed, acceleration, jerk, total):
    """Constant jerk from a feed and an acceleration to whatever feed: l = 1 + a t + b t^2 with 2 b v_0 = a a_0, l(T) = 0."""
    b = -1.0 / (total**2 + 2.0 * feed * total / acceleration)
    a = 2.0 * b * feed / acceleration
    length = total * (feed + total * (acceleration / 2.0 + total * jerk / 6.0))
    end = feed + acceleration * total + 0.5 * jerk * total**2
    u = np.array([[0.0, length], [feed, end], [acceleration, acceleration + jerk * total]])
    sigma = np.array([0.0, total])
    rows = coefficients(sigma, [(1.0, a, 2.0 * b)])[None]
    section = CertificateSection(sigma, u, rows, np.zeros((0, 2)), feed, end, acceleration)
    return line(length), section, total


def pieces_of(section, count=40):
    """Gauss points and weights over a section that was laid out: interval, r, and weight in sigma."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    parts, s = section.path.parts, section.stretches
    share = (s.upper - s.lower)[:, None]
    r = (s.lower[:, None] + share * 0.5 * (nodes + 1.0)).reshape(-1)
    weight = share * parts.h[s.interval][:, None] * 0.5 * weights
    return np.repeat(s.interval, count), r, weight.reshape(-1)

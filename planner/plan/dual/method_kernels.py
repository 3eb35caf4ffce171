"""Compiled loops of the primal-dual method in ``method.py``, which explains them.

Layout: a *cell* is an interval between neighbouring knots, empty ones included; cell k has the local unknowns
``theta[k width : k width + local]``, where width = J + A: l_1..l_J and m_1..m_A of the control values k, k + 1, and the
l of k + 2.  A cell that is not empty has the points ``first[k]`` to ``first[k] + RULE``, an empty one is an atom.

    state (p, 5 + 3 J + 3 A)   y, x, t, v, mu; e, lam1, lam2 of each l; u, nu1, nu2 of each m
    atoms (n - 1, 3)           x, lower and upper multiplier
    reduced (p, 5 + 2 J + A)   M_yy, M_yx, M_xx, and two of the last right-hand side; 1/k, d of each l; 1/k_u of each m
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

F64, I64, NOTHING, FLAG = types.float64, types.int64, types.void, types.boolean
READ1, READ2 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2))
WRITE1, WRITE2 = (types.Array(F64, n, "C") for n in (1, 2))
INDEX = types.Array(I64, 1, "C", readonly=True)
# first point of each cell (-1: empty), (J, A)
CELLS = types.Tuple((INDEX, I64, I64))
# per point: quadrature weight, cap, values of the three quadratics (margins included) and the two linear B-splines, row of g
POINTS = types.Tuple((READ1, READ1, READ2, READ2, READ2))
# per empty cell: row of G, largest x
ATOMS = types.Tuple((READ2, READ1))

RULE = 4  # points of a cell
_FAST = {"reassoc", "nsz", "contract", "arcp"}


@njit(forceinline=True, error_model="numpy")
def _eliminate(state, p, cap, J, A, reduced):
    """Reduced quantities of one point."""
    y, x, t, v, mu = state[p, 0], state[p, 1], state[p, 2], state[p, 3], state[p, 4]
    root = 1.0 / np.sqrt(x)
    rho = 0.5 * root / x
    own = v / t
    total = own
    for j in range(J):
        e, k1, k2 = state[p, 5 + 3 * j], state[p, 6 + 3 * j], state[p, 7 + 3 * j]
        k1, k2 = k1 / (y - e), k2 / (y + e)
        inverse = 1.0 / (k1 + k2)
        total += 4.0 * k1 * k2 * inverse
        reduced[p, 5 + 2 * j], reduced[p, 6 + 2 * j] = inverse, (k1 - k2) * inverse
    for i in range(A):
        at = 5 + 3 * (J + i)
        u = state[p, at]
        reduced[p, 5 + 2 * J + i] = 1.0 / (state[p, at + 1] / (1.0 - u) + state[p, at + 2] / (1.0 + u))
    # The determinant of the 2 x 2 system without its cancelling part.
    inner = 0.75 * v * root / (x * x) + mu / (cap - x)
    cross = own * rho
    bend = own * rho * rho + inner
    determinant = (total - own) * bend + own * inner
    reduced[p, 0], reduced[p, 1], reduced[p, 2] = bend / determinant, -cross / determinant, total / determinant


@njit(forceinline=True, error_model="numpy")
def _add_point(om, quadratic, linear, rows, reduced, p, J, A, w, matrix):
    """Add omega D^T C D of one point to the matrix of its cell; w is the row of sum d l."""
    width, local = J + A, rows.shape[1]
    myy, myx, mxx = reduced[p, 0], reduced[p, 1], reduced[p, 2]
    for q in range(local):
        f1 = om * (mxx * rows[p, q] + myx * w[q])
        f2 = om * (myx * rows[p, q] + myy * w[q])
        for s in range(q + 1):
            matrix[q, s] += f1 * rows[p, s] + f2 * w[s]
    for a in range(3):
        for b in range(a + 1):
            product = om * quadratic[p, a] * quadratic[p, b]
            for j in range(J):
                matrix[a * width + j, b * width + j] += product * reduced[p, 5 + 2 * j]
    for a in range(2):
        for b in range(a + 1):
            product = om * linear[p, a] * linear[p, b]
            for i in range(A):
                matrix[a * width + J + i, b * width + J + i] += product * reduced[p, 5 + 2 * J + i]


@njit(NOTHING(CELLS, POINTS, ATOMS, READ2, READ2, WRITE2, WRITE2), cache=True, fastmath=_FAST, error_model="numpy")
def assemble(cells, points, atoms, state, atom_state, reduced, band):
    """Eliminate everything but theta: the reduced quantities of every point, and the band of S (row i: S[i, i - w..i])."""
    first, J, A = cells
    weight, cap, quadratic, linear, rows = points
    width, local = J + A, rows.shape[1]
    last = band.shape[1] - 1
    band[:] = 0.0
    matrix, w = np.zeros((local, local)), np.zeros(local)
    for k in range(first.size):
        matrix[:] = 0.0
        if first[k] < 0:
            x, low, high = atom_state[k, 0], atom_state[k, 1], atom_state[k, 2]
            stiff = low / x + high / (atoms[1][k] - x)
            for q in range(local):
                for s in range(q + 1):
                    matrix[q, s] = atoms[0][k, q] * atoms[0][k, s] / stiff
        else:
            for p in range(first[k], first[k] + RULE):
                _eliminate(state, p, cap[p], J, A, reduced)
                for a in range(3):
                    for j in range(J):
                        w[a * width + j] = quadratic[p, a] * reduced[p, 6 + 2 * j]
                _add_point(weight[p], quadratic, linear, rows, reduced, p, J, A, w, matrix)
        begin = k * width
        for q in range(local):
            for s in range(q + 1):
                band[begin + q, last - (q - s)] += matrix[q, s]


@njit(F64(INDEX, WRITE2), cache=True, fastmath=_FAST, error_model="numpy")
def factor_multipliers(fixed, band):
    """Cholesky factor of the band in place, unknowns in ``fixed`` (increasing) held; returns the smallest pivot."""
    count, last = band.shape[0], band.shape[1] - 1
    for at in fixed:
        for d in range(1, last + 1):
            band[at, last - d] = 0.0
            if at + d < count:
                band[at + d, last - d] = 0.0
        band[at, last] = 1.0
    smallest = np.inf
    for i in range(count):
        for j in range(max(0, i - last), i):
            shift = i - j
            total = band[i, last - shift]
            begin = max(0, last - i)
            for c in range(begin, last - shift):
                total -= band[i, c] * band[j, c + shift]
            band[i, last - shift] = total * band[j, last]
        total = band[i, last]
        for c in range(last):
            total -= band[i, c] * band[i, c]
        smallest = min(smallest, total)
        if not total > 0.0:
            return -1.0
        band[i, last] = 1.0 / np.sqrt(total)
    return smallest


@njit(NOTHING(READ2, INDEX, WRITE1), cache=True, fastmath=_FAST, error_model="numpy")
def solve_multipliers(band, fixed, b):
    """Solve with the factor, in place; 0 at the fixed unknowns."""
    count, last = band.shape[0], band.shape[1] - 1
    for at in fixed:
        b[at] = 0.0
    for i in range(count):
        total = b[i]
        for d in range(1, min(i, last) + 1):
            total -= band[i, last - d] * b[i - d]
        b[i] = total * band[i, last]
    for i in range(count - 1, -1, -1):
        value = b[i] * band[i, last]
        b[i] = value
        for d in range(1, min(i, last) + 1):
            b[i - d] -= band[i, last - d] * value


@njit(
    NOTHING(CELLS, POINTS, ATOMS, READ2, READ2, READ2, READ2, F64, F64, WRITE2, WRITE1),
    cache=True,
    fastmath=_FAST,
    error_model="numpy",
)
def right_side(cells, points, atoms, state, atom_state, step, atom_step, target, corrector, reduced, out):
    """Sum of omega D^T (z + dz0) over points and atoms, dz0 the steps at theta = 0; products of the last steps corrected."""
    first, J, A = cells
    weight, cap, quadratic, linear, rows = points
    width, local = J + A, rows.shape[1]
    out[:] = 0.0
    for k in range(first.size):
        begin = k * width
        if first[k] < 0:
            x, low, high = atom_state[k, 0], atom_state[k, 1], atom_state[k, 2]
            room = atoms[1][k] - x
            dx, dlow, dhigh = atom_step[k, 0], atom_step[k, 1], atom_step[k, 2]
            push = (target + corrector * dx * dhigh) / room - (target - corrector * dx * dlow) / x
            moved = x - push / (low / x + high / room)
            for q in range(local):
                out[begin + q] += atoms[0][k, q] * moved
            continue
        for p in range(first[k], first[k] + RULE):
            y, x, t, v = state[p, 0], state[p, 1], state[p, 2], state[p, 3]
            dy, dx, dt, dv, dmu = step[p, 0], step[p, 1], step[p, 2], step[p, 3], step[p, 4]
            root = 1.0 / np.sqrt(x)
            rho = 0.5 * root / x
            pace = (target - corrector * dt * dv) / t - v / t * (y - root - t)
            ry = 1.0 - pace
            rx = (target + corrector * dx * dmu) / (cap[p] - x) - rho * pace
            for j in range(J):
                at = 5 + 3 * j
                s1, s2 = y - state[p, at], y + state[p, at]
                de = step[p, at]
                e1 = (target - corrector * (dy - de) * step[p, at + 1]) / s1
                e2 = (target - corrector * (dy + de) * step[p, at + 2]) / s2
                ry += reduced[p, 6 + 2 * j] * (e1 - e2) - e1 - e2
            dy0 = -(reduced[p, 0] * ry + reduced[p, 1] * rx)
            dx0 = -(reduced[p, 1] * ry + reduced[p, 2] * rx)
            reduced[p, 3], reduced[p, 4] = dy0, dx0
            om = weight[p]
            for j in range(J):
                at = 5 + 3 * j
                s1, s2 = y - state[p, at], y + state[p, at]
                de = step[p, at]
                e1 = (target - corrector * (dy - de) * step[p, at + 1]) / s1
                e2 = (target - corrector * (dy + de) * step[p, at + 2]) / s2
                moved = om * (state[p, at] - (e1 - e2) * reduced[p, 5 + 2 * j] + reduced[p, 6 + 2 * j] * dy0)
                for a in range(3):
                    out[begin + a * width + j] += quadratic[p, a] * moved
            for i in range(A):
                at = 5 + 3 * (J + i)
                u, du = state[p, at], step[p, at]
                push = (target + corrector * du * step[p, at + 1]) / (1.0 - u)
                push -= (target - corrector * du * step[p, at + 2]) / (1.0 + u)
                moved = om * (u - push * reduced[p, 5 + 2 * J + i])
                for a in range(2):
                    out[begin + a * width + J + i] += linear[p, a] * moved
            moved = om * (x + dx0)
            for q in range(local):
                out[begin + q] += rows[p, q] * moved


@njit(forceinline=True, error_model="numpy")
def _atom_step(atom_state, atom_step, k, room, pull, target, corrector):
    """Replace the step of one atom, given G at the new theta."""
    x, low, high = atom_state[k, 0], atom_state[k, 1], atom_state[k, 2]
    dx, dlow, dhigh = atom_step[k, 0], atom_step[k, 1], atom_step[k, 2]
    t1, t2 = target - corrector * dx * dlow, target + corrector * dx * dhigh
    dx = -(pull + t2 / room - t1 / x) / (low / x + high / room)
    dlow, dhigh = (t1 - low * dx) / x - low, (t2 + high * dx) / room - high
    atom_step[k, 0], atom_step[k, 1], atom_step[k, 2] = dx, dlow, dhigh
    return dx, dlow, dhigh


@njit(
    NOTHING(CELLS, POINTS, ATOMS, READ2, READ2, READ1, F64, F64, READ2, WRITE2, WRITE2, WRITE1),
    cache=True,
    fastmath=_FAST,
    error_model="numpy",
)
def steps(  # noqa: PLR0915 (one pass over all arrays)
    cells, points, atoms, state, atom_state, theta, target, corrector, reduced, step, atom_step, out
):
    """Replace the steps by those that belong to the new theta; write what the driver needs to know into ``out``.

    0: largest relative fall of a slack, 1: of a multiplier, 2: of x; 3..5: sums over omega of s dl, ds l, ds dl; 6: of dy.
    """
    first, J, A = cells
    weight, cap, quadratic, linear, rows = points
    width, local = J + A, rows.shape[1]
    fall_s = fall_l = fall_x = 0.0
    s_dl = ds_l = ds_dl = hope = 0.0
    for k in range(first.size):
        begin = k * width
        if first[k] < 0:
            pull = 0.0
            for q in range(local):
                pull += atoms[0][k, q] * theta[begin + q]
            x, low, high = atom_state[k, 0], atom_state[k, 1], atom_state[k, 2]
            room = atoms[1][k] - x
            dx, dlow, dhigh = _atom_step(atom_state, atom_step, k, room, pull, target, corrector)
            fall_s = max(fall_s, -dx / x, dx / room)
            fall_l = max(fall_l, -dlow / low, -dhigh / high)
            s_dl += x * dlow + room * dhigh
            ds_l += dx * low - dx * high
            ds_dl += dx * dlow - dx * dhigh
            continue
        for p in range(first[k], first[k] + RULE):
            y, x, t, v, mu = state[p, 0], state[p, 1], state[p, 2], state[p, 3], state[p, 4]
            room = cap[p] - x
            pull = 0.0
            for q in range(local):
                pull += rows[p, q] * theta[begin + q]
            load = 0.0
            for j in range(J):
                at = begin + j
                load_j = quadratic[p, 0] * theta[at] + quadratic[p, 1] * theta[at + width]
                load_j += quadratic[p, 2] * theta[at + 2 * width]
                load += reduced[p, 6 + 2 * j] * load_j
            dy = reduced[p, 3] - reduced[p, 0] * load - reduced[p, 1] * pull
            dx = reduced[p, 4] - reduced[p, 1] * load - reduced[p, 2] * pull
            root = 1.0 / np.sqrt(x)
            rho = 0.5 * root / x
            old_dy, old_dx = step[p, 0], step[p, 1]
            t1 = target - corrector * step[p, 2] * step[p, 3]
            dt = y - root - t + dy + rho * dx
            dv = (t1 - v * dt) / t - v
            t2 = target + corrector * old_dx * step[p, 4]
            dmu = (t2 + mu * dx) / room - mu
            om = weight[p]
            fall_x = max(fall_x, -dx / x)
            fall_s = max(fall_s, -dt / t, dx / room)
            fall_l = max(fall_l, -dv / v, -dmu / mu)
            one, two, three = t * dv + room * dmu, dt * v - dx * mu, dt * dv - dx * dmu
            hope += om * dy
            step[p, 0], step[p, 1], step[p, 2], step[p, 3], step[p, 4] = dy, dx, dt, dv, dmu
            for j in range(J):
                at, c = 5 + 3 * j, begin + j
                load_j = quadratic[p, 0] * theta[c] + quadratic[p, 1] * theta[c + width]
                load_j += quadratic[p, 2] * theta[c + 2 * width]
                e, l1, l2 = state[p, at], state[p, at + 1], state[p, at + 2]
                s1, s2 = y - e, y + e
                de = step[p, at]
                t1 = target - corrector * (old_dy - de) * step[p, at + 1]
                t2 = target - corrector * (old_dy + de) * step[p, at + 2]
                de = reduced[p, 6 + 2 * j] * dy - (load_j + t1 / s1 - t2 / s2) * reduced[p, 5 + 2 * j]
                d1, d2 = (t1 - l1 * (dy - de)) / s1 - l1, (t2 - l2 * (dy + de)) / s2 - l2
                step[p, at], step[p, at + 1], step[p, at + 2] = de, d1, d2
                fall_s = max(fall_s, (de - dy) / s1, -(dy + de) / s2)
                fall_l = max(fall_l, -d1 / l1, -d2 / l2)
                one += s1 * d1 + s2 * d2
                two += (dy - de) * l1 + (dy + de) * l2
                three += (dy - de) * d1 + (dy + de) * d2
            for i in range(A):
                at, c = 5 + 3 * (J + i), begin + J + i
                m = linear[p, 0] * theta[c] + linear[p, 1] * theta[c + width]
                u, l1, l2 = state[p, at], state[p, at + 1], state[p, at + 2]
                s1, s2 = 1.0 - u, 1.0 + u
                du = step[p, at]
                t1 = target + corrector * du * step[p, at + 1]
                t2 = target - corrector * du * step[p, at + 2]
                du = -(m + t1 / s1 - t2 / s2) * reduced[p, 5 + 2 * J + i]
                d1, d2 = (t1 + l1 * du) / s1 - l1, (t2 - l2 * du) / s2 - l2
                step[p, at], step[p, at + 1], step[p, at + 2] = du, d1, d2
                fall_s = max(fall_s, du / s1, -du / s2)
                fall_l = max(fall_l, -d1 / l1, -d2 / l2)
                one += s1 * d1 + s2 * d2
                two += du * (l2 - l1)
                three += du * (d2 - d1)
            s_dl += om * one
            ds_l += om * two
            ds_dl += om * three
    out[0], out[1], out[2] = fall_s, fall_l, fall_x
    out[3], out[4], out[5], out[6] = s_dl, ds_l, ds_dl, hope


@njit(NOTHING(CELLS, POINTS, ATOMS, F64, F64, READ2, READ2, WRITE2, WRITE2, WRITE1), cache=True, error_model="numpy")
def take_step(cells, points, atoms, primal, dual, step, atom_step, state, atom_state, out):
    """Take the step; write the gap sum(omega s l) and the time sum(omega y) into ``out``."""
    first, J, A = cells
    weight, cap = points[0], points[1]
    gap = time = 0.0
    for k in range(first.size):
        if first[k] < 0:
            atom_state[k, 0] += primal * atom_step[k, 0]
            atom_state[k, 1] += dual * atom_step[k, 1]
            atom_state[k, 2] += dual * atom_step[k, 2]
            x = atom_state[k, 0]
            gap += x * atom_state[k, 1] + (atoms[1][k] - x) * atom_state[k, 2]
            continue
        for p in range(first[k], first[k] + RULE):
            state[p, 0] += primal * step[p, 0]
            state[p, 1] += primal * step[p, 1]
            y, x = state[p, 0], state[p, 1]
            # a slack becomes the larger of its linear prediction and its true value
            state[p, 2] = max(state[p, 2] + primal * step[p, 2], y - 1.0 / np.sqrt(x))
            state[p, 3] += dual * step[p, 3]
            state[p, 4] += dual * step[p, 4]
            total = state[p, 2] * state[p, 3] + (cap[p] - x) * state[p, 4]
            for c in range(J + A):
                at = 5 + 3 * c
                state[p, at] += primal * step[p, at]
                state[p, at + 1] += dual * step[p, at + 1]
                state[p, at + 2] += dual * step[p, at + 2]
                bound = y if c < J else 1.0
                total += (bound - state[p, at]) * state[p, at + 1] + (bound + state[p, at]) * state[p, at + 2]
            gap += weight[p] * total
            time += weight[p] * y
    out[0], out[1] = gap, time

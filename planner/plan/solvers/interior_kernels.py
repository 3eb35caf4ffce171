"""Compiled loops of the interior-point method in ``interior.py``, which explains them.

Layout: points run along the last axis of every array, so the loops over points are vectorised by the compiler.

    rows   (m, 3, p)   r of each two-sided row -b_down <= r . (x, a, c) <= b_up
    bounds (m, 3)      whether b_up and b_down go with the pace y (1) or not (0), and their sizes
    slack, dual, product (m, 2, p)   of the upper and the lower side
    z, step (3, p)     x, a, c at every point
    pace, pace_step (p,)   y = x^(-1/2)
    hessian (6, p)     xx, xa, xc, aa, ac, cc
    gradient (3, p)
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

F64, I64, FLAG, NOTHING = types.float64, types.int64, types.boolean, types.void
READ1, READ2, READ3 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2, 3))
WRITE1, WRITE2, WRITE3 = (types.Array(F64, n, "C") for n in (1, 2, 3))

# Sums may be reordered and nothing is nan (the driver looks at the sums that come out), but inf keeps its meaning.
_FAST = {"reassoc", "nsz", "contract", "arcp", "nnan"}
_BLOCK = 512  # points a block: its scratch stays in the first-level cache

# The loops over the points of a block read and write one-dimensional slices and carry no maximum in a scalar: in this
# form LLVM turns them into vector code, which is worth a factor 2 to 3.


@njit(
    NOTHING(READ3, READ2, READ2, READ1, READ3, READ3, READ3, F64, F64, FLAG, WRITE2, WRITE2, WRITE2),
    cache=True,
    fastmath=_FAST,
    error_model="numpy",
)
def condense(rows, bounds, z, pace, slack, dual, product, target, corrector, factorise, hessian, gradient, pace_sums):
    """Eliminate slacks and multipliers of the rows: sums at every point, as if z and the pace were independent.

    With e = (target - corrector product + l (s + residual)) / s for each side and its stiffness l / s,

        gradient    sum (e_up - e_down) r                 hessian (with ``factorise``)   sum (both stiffnesses) r r^T
        pace_sums   0: sum (e_up + e_down), 1: sum of stiffnesses, 2..4: sum (difference of stiffnesses) r,
                    5: sum of multipliers; over the jerk rows, each side times the size of its bound
    """
    points = z.shape[1]
    pull, push, stiff, twist = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    firm, held = np.empty(_BLOCK), np.empty(_BLOCK)
    for lo in range(0, points, _BLOCK):
        n = min(_BLOCK, points - lo)
        x, a, c, y = z[0, lo : lo + n], z[1, lo : lo + n], z[2, lo : lo + n], pace[lo : lo + n]
        gx, ga, gc = gradient[0, lo : lo + n], gradient[1, lo : lo + n], gradient[2, lo : lo + n]
        hxx, hxa, hxc = hessian[0, lo : lo + n], hessian[1, lo : lo + n], hessian[2, lo : lo + n]
        haa, hac, hcc = hessian[3, lo : lo + n], hessian[4, lo : lo + n], hessian[5, lo : lo + n]
        pushed, stiffness, load = pace_sums[0, lo : lo + n], pace_sums[1, lo : lo + n], pace_sums[5, lo : lo + n]
        cx, ca, cc = pace_sums[2, lo : lo + n], pace_sums[3, lo : lo + n], pace_sums[4, lo : lo + n]
        gradient[:, lo : lo + n] = 0.0
        pushed[:] = 0.0
        if factorise:
            hessian[:, lo : lo + n] = 0.0
            pace_sums[:, lo : lo + n] = 0.0
        for r in range(rows.shape[0]):
            is_jerk, most, least = bounds[r, 0], bounds[r, 1], bounds[r, 2]
            rx, ra, rc = rows[r, 0, lo : lo + n], rows[r, 1, lo : lo + n], rows[r, 2, lo : lo + n]
            up, down = slack[r, 0, lo : lo + n], slack[r, 1, lo : lo + n]
            dual_up, dual_down = dual[r, 0, lo : lo + n], dual[r, 1, lo : lo + n]
            both_up, both_down = product[r, 0, lo : lo + n], product[r, 1, lo : lo + n]
            for i in range(n):
                bound = is_jerk * y[i] + (1.0 - is_jerk)
                b1, b2 = most * bound, least * bound
                value = rx[i] * x[i] + ra[i] * a[i] + rc[i] * c[i]
                v1, v2 = 1.0 / up[i], 1.0 / down[i]
                w1, w2 = dual_up[i] * v1, dual_down[i] * v2
                e1 = (target - corrector * both_up[i]) * v1 + w1 * (up[i] + value - b1)
                e2 = (target - corrector * both_down[i]) * v2 + w2 * (down[i] - value - b2)
                pull[i], push[i] = e1 - e2, is_jerk * (most * e1 + least * e2)
                stiff[i], twist[i] = w1 + w2, is_jerk * (most * w1 - least * w2)
                held[i] = is_jerk * (most * dual_up[i] + least * dual_down[i])
                firm[i] = is_jerk * (most * most * w1 + least * least * w2)
            for i in range(n):
                gx[i] += pull[i] * rx[i]
                ga[i] += pull[i] * ra[i]
                gc[i] += pull[i] * rc[i]
                pushed[i] += push[i]
            if factorise:
                for i in range(n):
                    hxx[i] += stiff[i] * rx[i] * rx[i]
                    hxa[i] += stiff[i] * rx[i] * ra[i]
                    hxc[i] += stiff[i] * rx[i] * rc[i]
                for i in range(n):
                    haa[i] += stiff[i] * ra[i] * ra[i]
                    hac[i] += stiff[i] * ra[i] * rc[i]
                    hcc[i] += stiff[i] * rc[i] * rc[i]
                for i in range(n):
                    cx[i] += twist[i] * rx[i]
                    ca[i] += twist[i] * ra[i]
                    cc[i] += twist[i] * rc[i]
                for i in range(n):
                    stiffness[i] += firm[i]
                    load[i] += held[i]


@njit(NOTHING(READ2, READ1, READ2, FLAG, FLAG, WRITE2, WRITE2), cache=True, fastmath=_FAST, error_model="numpy")
def tie_pace(z, weight, pace_sums, clip, factorise, hessian, gradient):
    """Insert the pace x^(-1/2) into the sums of :func:`condense`, and add the objective sum(weight * pace).

    ``clip`` drops negative curvature.
    """
    for p in range(z.shape[1]):
        x = z[0, p]
        slope = -0.5 / (x * np.sqrt(x))
        gradient[0, p] += (weight[p] - pace_sums[0, p]) * slope
        if factorise:
            curvature = weight[p] - pace_sums[5, p]
            kept = max(curvature, 0.0) if clip else curvature
            hessian[0, p] += slope * (pace_sums[1, p] * slope - 2.0 * pace_sums[2, p]) - 1.5 * kept * slope / x
            hessian[1, p] -= slope * pace_sums[3, p]
            hessian[2, p] -= slope * pace_sums[4, p]


@njit(
    NOTHING(READ3, READ2, READ2, READ1, READ3, READ3, WRITE3, READ2, READ1, F64, F64, FLAG, WRITE1),
    cache=True,
    fastmath=_FAST,
    error_model="numpy",
)
def measure_iterate(rows, bounds, z, pace, slack, dual, product, step, pace_step, target, corrector, keep, out):
    """Write what a step needs to know of itself into ``out``; with ``keep`` also the products ds * dl.

    0, 1: largest relative decrease of a slack and of a multiplier; 2..4: sums of ds*l, s*dl and ds*dl; 5: largest
    relative decrease of x.
    """
    points = z.shape[1]
    down_s = down_l = down_x = 0.0
    sum_dsl = sum_sdl = sum_dsdl = 0.0
    loss = np.empty(_BLOCK)
    worst_s, worst_l = np.empty(_BLOCK), np.empty(_BLOCK)
    prod_up, prod_down = np.empty(_BLOCK), np.empty(_BLOCK)
    for lo in range(0, points, _BLOCK):
        n = min(_BLOCK, points - lo)
        x, a, c, y = z[0, lo : lo + n], z[1, lo : lo + n], z[2, lo : lo + n], pace[lo : lo + n]
        dx, da, dc, dy = step[0, lo : lo + n], step[1, lo : lo + n], step[2, lo : lo + n], pace_step[lo : lo + n]
        for i in range(n):
            loss[i] = -dx[i] / x[i]
        worst_s[:] = 0.0
        worst_l[:] = 0.0
        for r in range(rows.shape[0]):
            is_jerk, most, least = bounds[r, 0], bounds[r, 1], bounds[r, 2]
            rx, ra, rc = rows[r, 0, lo : lo + n], rows[r, 1, lo : lo + n], rows[r, 2, lo : lo + n]
            up, down = slack[r, 0, lo : lo + n], slack[r, 1, lo : lo + n]
            dual_up, dual_down = dual[r, 0, lo : lo + n], dual[r, 1, lo : lo + n]
            both_up, both_down = product[r, 0, lo : lo + n], product[r, 1, lo : lo + n]
            for i in range(n):
                bound = is_jerk * (y[i] + dy[i]) + (1.0 - is_jerk)
                b1, b2 = most * bound, least * bound
                value = rx[i] * (x[i] + dx[i]) + ra[i] * (a[i] + da[i]) + rc[i] * (c[i] + dc[i])
                ds1, ds2 = b1 - value - up[i], b2 + value - down[i]
                v1, v2 = 1.0 / up[i], 1.0 / down[i]
                dl1 = (target - corrector * both_up[i] - dual_up[i] * ds1) * v1 - dual_up[i]
                dl2 = (target - corrector * both_down[i] - dual_down[i] * ds2) * v2 - dual_down[i]
                worst_s[i] = max(worst_s[i], -ds1 * v1, -ds2 * v2)
                worst_l[i] = max(worst_l[i], -dl1 / dual_up[i], -dl2 / dual_down[i])
                sum_dsl += ds1 * dual_up[i] + ds2 * dual_down[i]
                sum_sdl += up[i] * dl1 + down[i] * dl2
                prod_up[i], prod_down[i] = ds1 * dl1, ds2 * dl2
                sum_dsdl += ds1 * dl1 + ds2 * dl2
            if keep:
                for i in range(n):
                    both_up[i] = prod_up[i]
                    both_down[i] = prod_down[i]
        for i in range(n):
            down_s, down_l, down_x = max(down_s, worst_s[i]), max(down_l, worst_l[i]), max(down_x, loss[i])
    out[0], out[1], out[5] = down_s, down_l, down_x
    out[2], out[3], out[4] = sum_dsl, sum_sdl, sum_dsdl


@njit(
    NOTHING(READ3, READ2, WRITE2, READ1, WRITE3, WRITE3, READ3, READ2, READ1, READ1, F64, F64, F64, F64, WRITE1),
    cache=True,
    fastmath=_FAST,
    error_model="numpy",
)
def advance_iterate(
    rows, bounds, z, pace, slack, dual, product, step, pace_step, new_pace, target, corrector, primal, dual_length, out
):
    """Take the step; write the gap sum(s l) and the largest relative primal residual into ``out``.

    A slack becomes the larger of its linear prediction and its true value at ``new_pace``.
    """
    points = z.shape[1]
    gap = worst = 0.0
    residual = np.empty(_BLOCK)
    for lo in range(0, points, _BLOCK):
        n = min(_BLOCK, points - lo)
        x, a, c, y = z[0, lo : lo + n], z[1, lo : lo + n], z[2, lo : lo + n], pace[lo : lo + n]
        dx, da, dc, dy = step[0, lo : lo + n], step[1, lo : lo + n], step[2, lo : lo + n], pace_step[lo : lo + n]
        new = new_pace[lo : lo + n]
        residual[:] = 0.0
        for r in range(rows.shape[0]):
            is_jerk, most, least = bounds[r, 0], bounds[r, 1], bounds[r, 2]
            rx, ra, rc = rows[r, 0, lo : lo + n], rows[r, 1, lo : lo + n], rows[r, 2, lo : lo + n]
            up, down = slack[r, 0, lo : lo + n], slack[r, 1, lo : lo + n]
            dual_up, dual_down = dual[r, 0, lo : lo + n], dual[r, 1, lo : lo + n]
            both_up, both_down = product[r, 0, lo : lo + n], product[r, 1, lo : lo + n]
            for i in range(n):
                bound = is_jerk * (y[i] + dy[i]) + (1.0 - is_jerk)
                b1, b2 = most * bound, least * bound
                value = rx[i] * x[i] + ra[i] * a[i] + rc[i] * c[i]
                change = rx[i] * dx[i] + ra[i] * da[i] + rc[i] * dc[i]
                ds1, ds2 = b1 - value - change - up[i], b2 + value + change - down[i]
                l1, l2 = dual_up[i], dual_down[i]
                l1 += dual_length * ((target - corrector * both_up[i] - l1 * ds1) / up[i] - l1)
                l2 += dual_length * ((target - corrector * both_down[i] - l2 * ds2) / down[i] - l2)
                value += primal * change
                bound = is_jerk * new[i] + (1.0 - is_jerk)
                b1, b2 = most * bound, least * bound
                s1 = max(up[i] + primal * ds1, b1 - value)
                s2 = max(down[i] + primal * ds2, b2 + value)
                up[i], down[i] = s1, s2
                dual_up[i], dual_down[i] = l1, l2
                gap += s1 * l1 + s2 * l2
                residual[i] = max(residual[i], (s1 + value - b1) / (1.0 + b1), (s2 - value - b2) / (1.0 + b2))
        for i in range(n):
            worst = max(worst, residual[i])
        for i in range(n):
            x[i] += primal * dx[i]
            a[i] += primal * da[i]
            c[i] += primal * dc[i]
    out[0], out[1] = gap, worst


@njit(F64(READ1, I64, READ2, WRITE2, WRITE1), cache=True, error_model="numpy")
def factor_barrier(h, inner, hessian, gains, root):
    """Backward Riccati recursion on the Hessian: gains (4, n-1) of the control on the state, and the first knot's P.

    ``inner`` points stand inside every interval.  Row 3 of ``gains`` is the pivot.  Returns the smallest pivot met
    (negative: the Hessian is not positive definite on the dynamics, and the gains are not usable).
    """
    last = (inner + 1) * h.size
    pxx, pxa, pxc = hessian[0, last], hessian[1, last], hessian[2, last]
    paa, pac, pcc = hessian[3, last], hessian[4, last], hessian[5, last]
    smallest = np.inf
    for k in range(h.size - 1, -1, -1):
        d = h[k]
        i = (inner + 1) * k
        # next state: x + 2d a + 2/3 d^2 c + 1/3 d^2 v,  a + d/2 c + d/2 v,  v
        t1, t2, t3, t4 = 2.0 * d, 2.0 / 3.0 * d * d, 0.5 * d, d * d / 3.0
        # P times the columns of a, c and v
        ax, aa = t1 * pxx + pxa, t1 * pxa + paa
        cx, ca, cc = t2 * pxx + t3 * pxa, t2 * pxa + t3 * paa, t2 * pxc + t3 * pac
        vx, va, vc = t4 * pxx + t3 * pxa + pxc, t4 * pxa + t3 * paa + pac, t4 * pxc + t3 * pac + pcc
        qxx, qxa, qxc, qxv = pxx + hessian[0, i], ax + hessian[1, i], cx + hessian[2, i], vx
        qaa, qac, qav = t1 * ax + aa + hessian[3, i], t1 * cx + ca + hessian[4, i], t1 * vx + va
        qcc, qcv = t2 * cx + t3 * ca + hessian[5, i], t2 * vx + t3 * va
        qvv = t4 * vx + t3 * va + vc
        for j in range(1, inner + 1):
            # inner point: x + t1 a + m1 c + m3 v,  a + m2 c + m4 v,  m5 c + m6 v
            hxx, hxa, hxc = hessian[0, i + j], hessian[1, i + j], hessian[2, i + j]
            haa, hac, hcc = hessian[3, i + j], hessian[4, i + j], hessian[5, i + j]
            m6 = j / (inner + 1.0)
            t1, m3, m4, m5 = 2.0 * m6 * d, m6**3 / 3.0 * d * d, 0.5 * m6 * m6 * d, 1.0 - m6
            m1, m2 = (m6 * m6 - m6**3 / 3.0) * d * d, (m6 - 0.5 * m6 * m6) * d
            ax, aa = t1 * hxx + hxa, t1 * hxa + haa
            cx, ca, cc = m1 * hxx + m2 * hxa + m5 * hxc, m1 * hxa + m2 * haa + m5 * hac, m1 * hxc + m2 * hac + m5 * hcc
            vx, va, vc = m3 * hxx + m4 * hxa + m6 * hxc, m3 * hxa + m4 * haa + m6 * hac, m3 * hxc + m4 * hac + m6 * hcc
            qxx += hxx
            qxa += ax
            qxc += cx
            qxv += vx
            qaa += t1 * ax + aa
            qac += t1 * cx + ca
            qav += t1 * vx + va
            qcc += m1 * cx + m2 * ca + m5 * cc
            qcv += m1 * vx + m2 * va + m5 * vc
            qvv += m3 * vx + m4 * va + m6 * vc
        smallest = min(smallest, qvv)
        if not qvv > 0.0:
            return min(smallest, -1.0)
        inverse = 1.0 / qvv
        g1, g2, g3 = qxv * inverse, qav * inverse, qcv * inverse
        gains[0, k], gains[1, k], gains[2, k], gains[3, k] = g1, g2, g3, qvv
        pxx, pxa, pxc = qxx - g1 * qxv, qxa - g1 * qav, qxc - g1 * qcv
        paa, pac, pcc = qaa - g2 * qav, qac - g2 * qcv, qcc - g3 * qcv
    root[0], root[1], root[2], root[3], root[4], root[5] = pxx, pxa, pxc, paa, pac, pcc
    return smallest


@njit(NOTHING(READ1, I64, READ2, READ1, READ2, READ1, READ1, I64, WRITE1, WRITE2), cache=True, error_model="numpy")
def solve_barrier(h, inner, gains, root, gradient, first, last, fixed, feed_forward, step):
    """Newton step for one gradient, by the gains of :func:`factor_barrier`: a backward sweep, then a forward one.

    ``first`` and ``last`` are extra gradients of the first and last state (for end conditions).  At the first knot ``fixed``
    of its states do not move: none, x, or x and a.
    """
    n = h.size
    end = (inner + 1) * n
    px = gradient[0, end] + last[0]
    pa = gradient[1, end] + last[1]
    pc = gradient[2, end] + last[2]
    for k in range(n - 1, -1, -1):
        d = h[k]
        i = (inner + 1) * k
        lx = px + gradient[0, i]
        la = 2.0 * d * px + pa + gradient[1, i]
        lc = 2.0 / 3.0 * d * d * px + 0.5 * d * pa + gradient[2, i]
        lv = d * d / 3.0 * px + 0.5 * d * pa + pc
        for j in range(1, inner + 1):
            mx, ma, mc = gradient[0, i + j], gradient[1, i + j], gradient[2, i + j]
            t = j / (inner + 1.0)
            far = t**3 / 3.0
            lx += mx
            la += 2.0 * t * d * mx + ma
            lc += (t * t - far) * d * d * mx + (t - 0.5 * t * t) * d * ma + (1.0 - t) * mc
            lv += far * d * d * mx + 0.5 * t * t * d * ma + t * mc
        px, pa, pc = lx - gains[0, k] * lv, la - gains[1, k] * lv, lc - gains[2, k] * lv
        feed_forward[k] = lv / gains[3, k]
    px, pa, pc = px + first[0], pa + first[1], pc + first[2]
    x = 0.0
    a11, a12, a22 = root[3], root[4], root[5]
    if fixed == 2:
        a, c = 0.0, -pc / a22
    elif fixed == 1:
        det = a11 * a22 - a12 * a12
        a = -(a22 * pa - a12 * pc) / det
        c = -(a11 * pc - a12 * pa) / det
    else:
        # 3 x 3 by elimination of x
        u, w = root[1] / root[0], root[2] / root[0]
        b11, b12, b22 = a11 - u * root[1], a12 - u * root[2], a22 - w * root[2]
        ra, rc = pa - u * px, pc - w * px
        det = b11 * b22 - b12 * b12
        a = -(b22 * ra - b12 * rc) / det
        c = -(b11 * rc - b12 * ra) / det
        x = -px / root[0] - u * a - w * c
    for k in range(n):
        d = h[k]
        i = (inner + 1) * k
        step[0, i], step[1, i], step[2, i] = x, a, c
        v = -(gains[0, k] * x + gains[1, k] * a + gains[2, k] * c) - feed_forward[k]
        for j in range(1, inner + 1):
            t = j / (inner + 1.0)
            far = t**3 / 3.0
            step[0, i + j] = x + 2.0 * t * d * a + d * d * ((t * t - far) * c + far * v)
            step[1, i + j] = a + d * ((t - 0.5 * t * t) * c + 0.5 * t * t * v)
            step[2, i + j] = (1.0 - t) * c + t * v
        x, a, c = x + 2.0 * d * a + d * d * (2.0 * c + v) / 3.0, a + 0.5 * d * (c + v), v
    step[0, end], step[1, end], step[2, end] = x, a, c

/* The interior-point method over the knots: the cubics between them, and the Newton system by a Riccati recursion.

   State (x, a, c) at a knot, control v, the next c; at the share t of an interval of length h

       x + 2 t h a + h^2 (t^2 - t^3/3) c + h^2 t^3/3 v,    a + h (t - t^2/2) c + h t^2/2 v,    (1 - t) c + t v. */
#include "interior_inline.h"

/* Coefficients of that cubic for one t and h: of a and c and v in x, of c and v in a, of c and v in c. */
typedef struct {
    double xa, xc, xv, ac, av, cc, cv;
} Cubic;

INLINE Cubic cubic(double t, double h) {
    const double far = t * t * t / 3.0, half = 0.5 * t * t;
    return (Cubic){2.0 * t * h, (t * t - far) * (h * h), far * (h * h), (t - half) * h, half * h, 1.0 - t, t};
}

/* ---- from knots to points, and back ---------------------------------------------------------------------------------- */

INLINE void between(int inner, int64_t count, const double *h, const double *x, const double *a, const double *c,
                    Motion *out) {
    const int64_t stride = inner + 1;
    APART
    for (int64_t k = 0; k < count; k++) {
        double *to_x = out->x + k * stride, *to_a = out->a + k * stride, *to_c = out->c + k * stride;
        to_x[0] = x[k];
        to_a[0] = a[k];
        to_c[0] = c[k];
        for (int j = 1; j <= inner; j++) {
            const Cubic at = cubic((double)j / (inner + 1), h[k]);
            to_x[j] = x[k] + at.xa * a[k] + at.xc * c[k] + at.xv * c[k + 1];
            to_a[j] = a[k] + at.ac * c[k] + at.av * c[k + 1];
            to_c[j] = at.cc * c[k] + at.cv * c[k + 1];
        }
    }
}

HOTTEST void interior_between(const Problem *problem, int64_t block, const Knots *knots, Motion *out) {
    const int64_t first = first_interval(problem, block), count = intervals_in(problem, block);
    const double *h = problem->h + first, *x = knots->x + first, *a = knots->a + first, *c = knots->c + first;
    if (problem->inner == 1) between(1, count, h, x, a, c, out);
    else between(3, count, h, x, a, c, out);
    const int64_t last = count * (problem->inner + 1);
    if (last < points_in(problem, block)) {
        out->x[last] = x[count];
        out->a[last] = a[count];
        out->c[last] = c[count];
    }
}

INLINE void gather_gradient(int inner, int64_t k, const Cubic *at, const double (*g)[BLOCK], double *gx, double *ga,
                            double *gc, double *gv) {
    const int64_t i = k * (inner + 1);
    double x = g[0][i], a = g[1][i], c = g[2][i], v = 0.0;
    for (int j = 1; j <= inner; j++) {
        const double px = g[0][i + j], pa = g[1][i + j], pc = g[2][i + j];
        x += px;
        a += at[j].xa * px + pa;
        c += at[j].xc * px + at[j].ac * pa + at[j].cc * pc;
        v += at[j].xv * px + at[j].av * pa + at[j].cv * pc;
    }
    gx[k] = x;
    ga[k] = a;
    gc[k] = c;
    gv[k] = v;
}

INLINE void gather(int inner, int64_t count, const double *h, const Condensed *sums, Gathered *out) {
    double(*q)[MOST_INTERVALS] = out->hessian, (*g)[MOST_INTERVALS] = out->gradient;
    const double(*p)[BLOCK] = sums->hessian;
    APART
    for (int64_t k = 0; k < count; k++) {
        const int64_t i = k * (inner + 1);
        double xx = p[0][i], xa = p[1][i], xc = p[2][i], aa = p[3][i], ac = p[4][i], cc = p[5][i];
        double xv = 0.0, av = 0.0, cv = 0.0, vv = 0.0;
        Cubic cubics[4];
        for (int j = 1; j <= inner; j++) {
            const Cubic at = cubics[j] = cubic((double)j / (inner + 1), h[k]);
            const double hxx = p[0][i + j], hxa = p[1][i + j], hxc = p[2][i + j];
            const double haa = p[3][i + j], hac = p[4][i + j], hcc = p[5][i + j];
            /* the point's Hessian times the columns of a, c and v */
            const double ax = at.xa * hxx + hxa, aa_ = at.xa * hxa + haa;
            const double cx = at.xc * hxx + at.ac * hxa + at.cc * hxc, ca = at.xc * hxa + at.ac * haa + at.cc * hac;
            const double cc_ = at.xc * hxc + at.ac * hac + at.cc * hcc;
            const double vx = at.xv * hxx + at.av * hxa + at.cv * hxc, va = at.xv * hxa + at.av * haa + at.cv * hac;
            const double vc = at.xv * hxc + at.av * hac + at.cv * hcc;
            xx += hxx;
            xa += ax;
            xc += cx;
            xv += vx;
            aa += at.xa * ax + aa_;
            ac += at.xa * cx + ca;
            av += at.xa * vx + va;
            cc += at.xc * cx + at.ac * ca + at.cc * cc_;
            cv += at.xc * vx + at.ac * va + at.cc * vc;
            vv += at.xv * vx + at.av * va + at.cv * vc;
        }
        const double all[10] = {xx, xa, xc, xv, aa, ac, av, cc, cv, vv};
        for (int m = 0; m < 10; m++) q[m][k] = all[m];
        gather_gradient(inner, k, cubics, sums->gradient, g[0], g[1], g[2], g[3]);
    }
}

HOTTEST void interior_gather(const Problem *problem, int64_t block, const Condensed *sums, Gathered *out) {
    const int64_t count = intervals_in(problem, block);
    const double *h = problem->h + first_interval(problem, block);
    if (problem->inner == 1) gather(1, count, h, sums, out);
    else gather(3, count, h, sums, out);
}

INLINE void gather_pulls(int inner, int64_t count, int64_t row, const double *h, const double (*g)[BLOCK], double *out) {
    APART
    for (int64_t k = 0; k < count; k++) {
        Cubic cubics[4];
        for (int j = 1; j <= inner; j++) cubics[j] = cubic((double)j / (inner + 1), h[k]);
        gather_gradient(inner, k, cubics, g, out, out + row, out + 2 * row, out + 3 * row);
    }
}

HOTTEST void interior_gather_pulls(const Problem *problem, int64_t block, const Pulls *pulls, double *out) {
    const int64_t first = first_interval(problem, block), count = intervals_in(problem, block);
    const int64_t row = problem->intervals + 1, last = count * (problem->inner + 1);
    const double *h = problem->h + first;
    for (int part = 0; part < 2; part++) {
        const double(*g)[BLOCK] = part ? pulls->corrector : pulls->target;
        double *to = out + 4 * part * row + first;
        if (problem->inner == 1) gather_pulls(1, count, row, h, g, to);
        else gather_pulls(3, count, row, h, g, to);
        if (last < points_in(problem, block))
            for (int m = 0; m < 3; m++) to[m * row + count] = g[m][last];
    }
}

/* ---- the Newton system ----------------------------------------------------------------------------------------------- */

HOTTEST int interior_factor(const Problem *problem, int64_t block, const Gathered *sums, State *state, CostToGo *cost) {
    const int64_t first = first_interval(problem, block);
    const double(*q)[MOST_INTERVALS] = sums->hessian, (*g)[MOST_INTERVALS] = sums->gradient;
    double xx = cost->h[0], xa = cost->h[1], xc = cost->h[2], aa = cost->h[3], ac = cost->h[4], cc = cost->h[5];
    double gx = cost->g[0], ga = cost->g[1], gc = cost->g[2];
    for (int64_t k = intervals_in(problem, block) - 1; k >= 0; k--) {
        const Cubic at = cubic(1.0, problem->h[first + k]);
        /* the cost to go at the next knot times the columns of a, c and v */
        const double ax = at.xa * xx + xa, aa_ = at.xa * xa + aa;
        const double cx = at.xc * xx + at.ac * xa, ca = at.xc * xa + at.ac * aa;
        const double vx = at.xv * xx + at.av * xa + xc, va = at.xv * xa + at.av * aa + ac;
        const double vc = at.xv * xc + at.av * ac + cc;
        const double qxx = xx + q[0][k], qxa = ax + q[1][k], qxc = cx + q[2][k], qxv = vx + q[3][k];
        const double qaa = at.xa * ax + aa_ + q[4][k], qac = at.xa * cx + ca + q[5][k], qav = at.xa * vx + va + q[6][k];
        const double qcc = at.xc * cx + at.ac * ca + q[7][k], qcv = at.xc * vx + at.ac * va + q[8][k];
        /* what the next turn waits for is short: the division, a product, a difference */
        const double qvv = (at.xv * vx + at.av * va) + (vc + q[9][k]);
        if (!(qvv > 0.0)) return 0;
        const double inverse = 1.0 / qvv, kx = qxv * inverse, ka = qav * inverse, kc = qcv * inverse;
        const double v = (at.xv * gx + at.av * ga) + (gc + g[3][k]);
        gc = (at.xc * gx + at.ac * ga + g[2][k]) - kc * v;
        ga = (at.xa * gx + ga + g[1][k]) - ka * v;
        gx = (gx + g[0][k]) - kx * v;
        xx = qxx - inverse * (qxv * qxv);
        xa = qxa - inverse * (qxv * qav);
        xc = qxc - inverse * (qxv * qcv);
        aa = qaa - inverse * (qav * qav);
        ac = qac - inverse * (qav * qcv);
        cc = qcc - inverse * (qcv * qcv);
        double *gains = state->gains + 4 * (first + k);
        gains[0] = kx;
        gains[1] = ka;
        gains[2] = kc;
        gains[3] = inverse;
        state->forward[first + k] = v * inverse;
    }
    *cost = (CostToGo){{xx, xa, xc, aa, ac, cc}, {gx, ga, gc}};
    return 1;
}

HOTTEST void interior_back(const Problem *problem, State *state, double target, double corrector, double at_first[3]) {
    const int64_t n = problem->intervals, row = n + 1;
    const double *t = state->pulls, *p = state->pulls + 4 * row;
    double x = target * t[n] - corrector * p[n], a = target * t[row + n] - corrector * p[row + n];
    double c = target * t[2 * row + n] - corrector * p[2 * row + n];
    for (int64_t k = n - 1; k >= 0; k--) {
        const Cubic at = cubic(1.0, problem->h[k]);
        const double *gains = state->gains + 4 * k;
        const double gx = target * t[k] - corrector * p[k], ga = target * t[row + k] - corrector * p[row + k];
        const double gc = target * t[2 * row + k] - corrector * p[2 * row + k];
        const double gv = target * t[3 * row + k] - corrector * p[3 * row + k];
        const double v = (at.xv * x + at.av * a) + (c + gv);
        c = (at.xc * x + at.ac * a + gc) - gains[2] * v;
        a = (at.xa * x + a + ga) - gains[1] * v;
        x = (x + gx) - gains[0] * v;
        state->forward[k] = v * gains[3];
    }
    at_first[0] = x;
    at_first[1] = a;
    at_first[2] = c;
}

HOTTEST void interior_back_from(const Problem *problem, State *state, const double last[3], double at_first[3]) {
    double x = last[0], a = last[1], c = last[2];
    for (int64_t k = problem->intervals - 1; k >= 0; k--) {
        const Cubic at = cubic(1.0, problem->h[k]);
        const double *gains = state->gains + 4 * k;
        const double v = at.xv * x + at.av * a + c;
        c = at.xc * x + at.ac * a - gains[2] * v;
        a = at.xa * x + a - gains[1] * v;
        x = x - gains[0] * v;
        state->forward[k] = v * gains[3];
    }
    at_first[0] = x;
    at_first[1] = a;
    at_first[2] = c;
}

/* The first state that minimises the cost to go, as far as it may move. */
static void first_state(const Problem *problem, const double h[6], const double g[3], double z[3]) {
    double aa = h[3], ac = h[4], cc = h[5], ga = g[1], gc = g[2];
    z[0] = z[1] = 0.0;
    if (problem->fixed == 2) {
        z[2] = -gc / cc;
        return;
    }
    const double u = h[1] / h[0], w = h[2] / h[0];
    if (problem->fixed == 0) { /* x eliminated */
        aa -= u * h[1];
        ac -= u * h[2];
        cc -= w * h[2];
        ga -= u * g[0];
        gc -= w * g[0];
    }
    const double det = aa * cc - ac * ac;
    z[1] = -(cc * ga - ac * gc) / det;
    z[2] = -(aa * gc - ac * ga) / det;
    if (problem->fixed == 0) z[0] = -g[0] / h[0] - u * z[1] - w * z[2];
}

HOTTEST void interior_forth(const Problem *problem, const State *state, const double at_first[3], Knots step) {
    double z[3];
    first_state(problem, state->root, at_first, z);
    double x = z[0], a = z[1], c = z[2];
    for (int64_t k = 0; k < problem->intervals; k++) {
        const Cubic at = cubic(1.0, problem->h[k]);
        const double *gains = state->gains + 4 * k;
        step.x[k] = x;
        step.a[k] = a;
        step.c[k] = c;
        const double v = (gains[0] * x + gains[1] * a) + (gains[2] * c + state->forward[k]);
        x = (x + at.xa * a + at.xc * c) - at.xv * v;
        a = (a + at.ac * c) - at.av * v;
        c = -v;
    }
    step.x[problem->intervals] = x;
    step.a[problem->intervals] = a;
    step.c[problem->intervals] = c;
}

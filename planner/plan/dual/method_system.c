#include "planner/plan/dual/dual.h"

#include <string.h>

#include "planner/plan/dual/method_inline.h"

/* Reduced quantities of the points of a cell. */
static inline void eliminate(const Problem *p, int64_t block, const double *restrict state, double *restrict reduced)
{
    const double *cap = p->cap + block * RULE;
    const double *y = state + Y * RULE, *x = state + X * RULE, *t = state + T * RULE, *v = state + V * RULE;
    const double *mu = state + MU * RULE;
    double own[RULE], rest[RULE];
    EACH {
        own[i] = v[i] / t[i];
        rest[i] = 0.0;
    }
    for (int64_t j = 0; j < p->jerks; j++) {
        const double *e = state + (MOTIONS + 3 * j) * RULE, *low = e + RULE, *high = low + RULE;
        double *inverse = reduced + (STIFF + 2 * j) * RULE, *lean = inverse + RULE;
        EACH {
            const double k1 = low[i] / (y[i] - e[i]), k2 = high[i] / (y[i] + e[i]);
            inverse[i] = 1.0 / (k1 + k2);
            lean[i] = (k1 - k2) * inverse[i];
            rest[i] += 4.0 * k1 * k2 * inverse[i];
        }
    }
    for (int64_t m = 0; m < p->accelerations; m++) {
        const double *u = state + (MOTIONS + 3 * (p->jerks + m)) * RULE, *low = u + RULE, *high = low + RULE;
        double *inverse = reduced + (STIFF + 2 * p->jerks + m) * RULE;
        EACH inverse[i] = 1.0 / (low[i] / (1.0 - u[i]) + high[i] / (1.0 + u[i]));
    }
    EACH {
        const double root = 1.0 / sqrt(x[i]), rho = 0.5 * root / x[i];
        /* The determinant of the 2 x 2 system without its cancelling part. */
        const double inner = 0.75 * v[i] * root / (x[i] * x[i]) + mu[i] / (cap[i] - x[i]);
        const double bend = own[i] * rho * rho + inner;
        const double determinant = rest[i] * bend + own[i] * inner;
        reduced[MYY * RULE + i] = bend / determinant;
        reduced[MYX * RULE + i] = -own[i] * rho / determinant;
        reduced[MXX * RULE + i] = (rest[i] + own[i]) / determinant;
    }
}

/* Add omega D^T C D of the points of a cell to its rows of the band. */
static inline void add_points(const Problem *p, int64_t block, const double *restrict reduced, double *restrict band,
                              double *restrict load)
{
    const int64_t local = p->local, width = p->width;
    const double *weight = p->weight + block * RULE, *rows = p->rows + block * RULE * local;
    const double *quadratic = p->quadratic + block * 3 * RULE, *linear = p->linear + block * 2 * RULE;
    const double *myy = reduced + MYY * RULE, *myx = reduced + MYX * RULE, *mxx = reduced + MXX * RULE;
    memset(load, 0, (size_t)(RULE * local) * sizeof *load); /* the rows of sum d l */
    for (int64_t a = 0; a < 3; a++)
        for (int64_t j = 0; j < p->jerks; j++)
            EACH load[i * local + a * width + j] = quadratic[a * RULE + i] * reduced[(STIFF + 2 * j + 1) * RULE + i];
    for (int64_t q = 0; q < local; q++) {
        double f[RULE], g[RULE];
        EACH {
            const double row = rows[i * local + q], w = load[i * local + q];
            f[i] = weight[i] * (mxx[i] * row + myx[i] * w);
            g[i] = weight[i] * (myx[i] * row + myy[i] * w);
        }
        double *to = band + q * local;
        const double *r = rows + q, *w = load + q;
        for (int64_t s = 0; s < local - q; s++) {
            const double one = (f[0] * r[s] + g[0] * w[s]) + (f[1] * r[local + s] + g[1] * w[local + s]);
            const double two = (f[2] * r[2 * local + s] + g[2] * w[2 * local + s]) +
                               (f[3] * r[3 * local + s] + g[3] * w[3 * local + s]);
            to[s] += one + two;
        }
    }
    for (int64_t c = 0; c < width; c++) {
        const int is_jerk = c < p->jerks;
        const double *basis = is_jerk ? quadratic : linear;
        const double *inverse = reduced + (STIFF + (is_jerk ? 2 * c : p->jerks + c)) * RULE;
        for (int64_t a = 0; a < (is_jerk ? 3 : 2); a++)
            for (int64_t b = 0; b <= a; b++) {
                double part[RULE];
                EACH part[i] = weight[i] * basis[a * RULE + i] * basis[b * RULE + i] * inverse[i];
                band[(b * width + c) * local + (a - b) * width] += total_of(part);
            }
    }
}

HOT void method_assemble(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place,
                         const double *weight, const double *cap, const double *quadratic, const double *linear,
                         const double *rows, const double *atom_rows, const double *atom_caps, const double *state,
                         const double *atom_state, int64_t unknowns, double *reduced, double *band, double *scratch)
{
    const Problem p = problem_of(cells, jerks, accelerations, place, weight, cap, quadratic, linear, rows, atom_rows,
                                 atom_caps);
    const int64_t local = p.local;
    memset(band, 0, (size_t)(unknowns * local) * sizeof *band);
    for (int64_t k = 0; k < cells; k++) {
        double *here = band + k * p.width * local;
        if (place[k] < 0) {
            const double *atom = atom_state + 3 * k, *row = atom_rows + k * local;
            const double stiff = atom[1] / atom[0] + atom[2] / (atom_caps[k] - atom[0]);
            for (int64_t q = 0; q < local; q++)
                for (int64_t s = q; s < local; s++)
                    here[q * local + s - q] += row[q] * row[s] / stiff;
        } else {
            double *block = reduced + place[k] * reduced_size(&p);
            eliminate(&p, place[k], state + place[k] * state_size(&p), block);
            add_points(&p, place[k], block, here, scratch);
        }
    }
}

HOT double method_factor(int64_t count, int64_t local, int64_t held, const int64_t *fixed, double *band)
{
    for (int64_t n = 0; n < held; n++) {
        const int64_t at = fixed[n];
        for (int64_t d = 1; d < local; d++) {
            band[at * local + d] = 0.0;
            if (at >= d)
                band[(at - d) * local + d] = 0.0;
        }
        band[at * local] = 1.0;
    }
    double smallest = INFINITY;
    for (int64_t i = 0; i < count; i++) {
        double *restrict row = band + i * local;
        const double pivot = row[0];
        smallest = smaller(smallest, pivot);
        if (!(pivot > 0.0))
            return -1.0;
        const double inverse = 1.0 / sqrt(pivot);
        const int64_t reach = count - i < local ? count - i : local;
        row[0] = inverse;
        for (int64_t d = 1; d < reach; d++)
            row[d] *= inverse;
        for (int64_t d = 1; d < reach; d++) {
            double *restrict below = band + (i + d) * local;
            const double factor = row[d];
            for (int64_t s = 0; s < local - d; s++)
                below[s] -= factor * row[d + s];
        }
    }
    return smallest;
}

HOT void method_solve(int64_t count, int64_t local, int64_t held, const int64_t *fixed, const double *band, double *b)
{
    for (int64_t n = 0; n < held; n++)
        b[fixed[n]] = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double *row = band + i * local, value = b[i] * row[0];
        const int64_t reach = count - i < local ? count - i : local;
        b[i] = value;
        for (int64_t d = 1; d < reach; d++)
            b[i + d] -= row[d] * value;
    }
    for (int64_t i = count - 1; i >= 0; i--) {
        const double *row = band + i * local;
        const int64_t reach = count - i < local ? count - i : local;
        double total = b[i];
        for (int64_t d = reach - 1; d > 0; d--) /* what was found last comes last: the others need not wait for it */
            total -= row[d] * b[i + d];
        b[i] = total * row[0];
    }
}

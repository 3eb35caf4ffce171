/* The interior-point method of tube.py: every row |r| <= 1 + e is exceeded by an elastic e at a price; slacks s1 = 1 + e - r
   and s2 = 1 + e + r, multipliers z1, z2, and y of the elastic.  These are eliminated row by row, and what remains is the
   objective's band plus D a a^T of each row a.  Band matrices are kept column by column here: (n, width). */
#include "planner/programs/path/path.h"

#include "planner/core.h"

static const double GAP = 1e-4;         /* of the objective */
static const double INFEASIBLE = 1e-6;  /* of half a width, by which the slacks' equations may be off */
static const double TO_BOUNDARY = 0.99; /* share of the way */
static const double PENALTY = 1e3;      /* times the largest multiplier of the start */
static const double LEAST_CENTRING = 1e-5;
static const double LEAST = 1e-12, LEAST_COST = 1e-8;
static const double BOOSTS[] = {0.0, 1e-13, 1e-11, 1e-9}; /* of the pivots: what rounding takes from the smallest */
enum { MOST_ITERATIONS = 60, BOOST_COUNT = 4 };

/* The rows, and where they act. */
typedef struct {
    int64_t count, width, dim, n;
    const int64_t *first;
    const double *rows, *offset;
} Rows;

/* A point of the method, or a step of it; (count,) each. */
typedef struct {
    double *s1, *s2, *e, *z1, *z2, *y;
} Point;

/* What a row's right side was made of. */
typedef struct {
    double g1, g2, h0, h1, d1, d2, p1, p2, py;
} Part;

static Point point_at(double *work, int64_t count) {
    return (Point){work,             work + count,     work + 2 * count,
                   work + 3 * count, work + 4 * count, work + 5 * count};
}

static void products(const Rows *a, const double *x, double *restrict out) {
    tube_apply_rows(a->count, a->width, a->dim, a->first, a->rows, x, out);
}

static void add_transposed(const Rows *a, const double *y, double *restrict out) {
    tube_add_transposed(a->count, a->width, a->dim, a->first, a->rows, y, out);
}

/* Strictly inside, complementarity the share of each row in the objective; returns the price of an elastic. */
static double start(const Rows *a, const double *value, double cost, Point at) {
    const double mu = larger(cost, LEAST_COST) / (2.0 * (double)a->count);
    double most = 0.0;
    for (int64_t k = 0; k < a->count; k++) {
        at.e[k] = larger(fabs(value[k]) - 0.9, 0.0) + 0.01;
        at.s1[k] = 1.0 + at.e[k] - value[k];
        at.s2[k] = 1.0 + at.e[k] + value[k];
        at.z1[k] = mu / at.s1[k];
        at.z2[k] = mu / at.s2[k];
        most = larger(most, at.z1[k] + at.z2[k]);
    }
    const double price = PENALTY * larger(larger(most, cost), LEAST_COST);
    for (int64_t k = 0; k < a->count; k++) at.y[k] = price;
    return price;
}

/* Sum of all complementarity products, after a step of these lengths. */
static double gap_after(int64_t count, Point at, Point by, double primal, double dual) {
    double gap = 0.0;
    for (int64_t k = 0; k < count; k++)
        gap += (at.s1[k] + primal * by.s1[k]) * (at.z1[k] + dual * by.z1[k]) +
               (at.s2[k] + primal * by.s2[k]) * (at.z2[k] + dual * by.z2[k]) +
               (at.e[k] + primal * by.e[k]) * (at.y[k] + dual * by.y[k]);
    return gap;
}

/* One row's elimination, aiming at the products mu less m1, m2, m3 of the affine step. */
static inline Part part_of(Point at, int64_t k, double value, double price, double mu, const double affine[3]) {
    const double s1 = at.s1[k], s2 = at.s2[k], e = at.e[k], z1 = at.z1[k], z2 = at.z2[k], y = at.y[k];
    Part p = {.d1 = z1 / s1, .d2 = z2 / s2, .py = price - z1 - z2 - y};
    p.p1 = value - 1.0 - e + s1;
    p.p2 = -value - 1.0 - e + s2;
    p.g1 = (mu - s1 * z1 - affine[0] + z1 * p.p1) / s1;
    p.g2 = (mu - s2 * z2 - affine[1] + z2 * p.p2) / s2;
    const double total = p.d1 + p.d2 + y / e;
    p.h0 = ((mu - e * y - affine[2]) / e + p.g1 + p.g2 - p.py) / total;
    p.h1 = (p.d1 - p.d2) / total;
    return p;
}

static void affine_products(Point affine, int64_t k, double out[3]) {
    out[0] = affine.s1[k] * affine.z1[k];
    out[1] = affine.s2[k] * affine.z2[k];
    out[2] = affine.e[k] * affine.y[k];
}

/* Right-hand sides of the rows; ``affine``: the step whose products the corrector takes off, or none. */
static void right_sides(const Rows *a, Point at, const double *value, double price, double mu, const Point *affine,
                        double *restrict out) {
    double of[3] = {0.0, 0.0, 0.0};
    for (int64_t k = 0; k < a->count; k++) {
        if (affine) affine_products(*affine, k, of);
        const Part p = part_of(at, k, value[k], price, mu, of);
        out[k] = p.g1 - p.g2 - (p.d1 - p.d2) * p.h0;
    }
}

/* The step that goes with the step ``dr`` of the rows; may be written over the affine one. */
static void step_of(const Rows *a, Point at, const double *value, double price, double mu, const Point *affine,
                    const double *dr, Point by) {
    double of[3] = {0.0, 0.0, 0.0};
    for (int64_t k = 0; k < a->count; k++) {
        if (affine) affine_products(*affine, k, of);
        const Part p = part_of(at, k, value[k], price, mu, of);
        const double de = p.h0 + p.h1 * dr[k];
        by.s1[k] = -p.p1 - dr[k] + de;
        by.s2[k] = -p.p2 + dr[k] + de;
        by.e[k] = de;
        by.z1[k] = p.g1 + p.d1 * (dr[k] - de);
        by.z2[k] = p.g2 - p.d2 * (dr[k] + de);
        by.y[k] = p.py - by.z1[k] - by.z2[k];
    }
}

static double length_of(double fall, double fraction) { return fall > fraction ? fraction / fall : 1.0; }

/* Primal and dual step lengths that stay positive, a fraction of the way to the boundary. */
static void lengths(int64_t count, Point at, Point by, double fraction, double *primal, double *dual) {
    double falls[2] = {0.0, 0.0};
    for (int64_t k = 0; k < count; k++) {
        falls[0] = larger(falls[0], larger(-by.s1[k] / at.s1[k], larger(-by.s2[k] / at.s2[k], -by.e[k] / at.e[k])));
        falls[1] = larger(falls[1], larger(-by.z1[k] / at.z1[k], larger(-by.z2[k] / at.z2[k], -by.y[k] / at.y[k])));
    }
    *primal = length_of(falls[0], fraction);
    *dual = length_of(falls[1], fraction);
}

static void advance(int64_t count, Point at, Point by, double primal, double dual) {
    for (int64_t k = 0; k < count; k++) {
        at.s1[k] += primal * by.s1[k];
        at.s2[k] += primal * by.s2[k];
        at.e[k] += primal * by.e[k];
        at.z1[k] += dual * by.z1[k];
        at.z2[k] += dual * by.z2[k];
        at.y[k] += dual * by.y[k];
    }
}

/* The Newton system: the objective, and what is left of every row's complementarity. */
HOT static void newton_system(const Rows *a, const double *objective, Point at, int64_t frozen_count,
                              const int64_t *frozen, double *restrict columns) {
    const int64_t width = a->width, n = a->n;
    for (int64_t j = 0; j < n; j++)
        for (int64_t i = 0; i < width; i++) columns[j * width + i] = objective[i * n + j];
    for (int64_t k = 0; k < a->count; k++) {
        const double d1 = at.z1[k] / at.s1[k], d2 = at.z2[k] / at.s2[k];
        const double curvature = d1 + d2 - square(d1 - d2) / (d1 + d2 + at.y[k] / at.e[k]);
        const double *row = a->rows + k * width;
        for (int64_t j = 0; j < width; j++) {
            const double value = curvature * row[j];
            double *column = columns + (a->first[k] * a->dim + j) * width;
            for (int64_t i = j; i < width; i++) column[i - j] += value * row[i];
        }
    }
    for (int64_t f = 0; f < frozen_count; f++) {
        const int64_t j = frozen[f];
        columns[j * width] = 1.0;
        for (int64_t i = 1; i < width; i++) {
            columns[j * width + i] = 0.0;
            if (j >= i) columns[(j - i) * width + i] = 0.0;
        }
    }
}

/* Cholesky's factor of a band with raised pivots; 0 where one is not positive. */
HOT static int cholesky(int64_t n, int64_t width, const double *columns, double boost, double *restrict factor) {
    for (int64_t j = 0; j < n * width; j++) factor[j] = columns[j];
    for (int64_t j = 0; j < n; j++) factor[j * width] *= 1.0 + boost;
    for (int64_t j = 0; j < n; j++) {
        double *column = factor + j * width;
        if (!(column[0] > 0.0)) return 0;
        column[0] = sqrt(column[0]);
        const double inverse = 1.0 / column[0];
        const int64_t end = n - j < width ? n - j : width;
        for (int64_t i = 1; i < end; i++) column[i] *= inverse;
        for (int64_t i = 1; i < end; i++) {
            double *after = factor + (j + i) * width;
            const double share = column[i];
            for (int64_t m = i; m < end; m++) after[m - i] -= share * column[m];
        }
    }
    return 1;
}

/* Solve with the factor, in place. */
static void solve(int64_t n, int64_t width, const double *factor, double *restrict x) {
    for (int64_t j = 0; j < n; j++) {
        const double *column = factor + j * width;
        const int64_t end = n - j < width ? n - j : width;
        x[j] /= column[0];
        for (int64_t i = 1; i < end; i++) x[j + i] -= column[i] * x[j];
    }
    for (int64_t j = n - 1; j >= 0; j--) {
        const double *column = factor + j * width;
        const int64_t end = n - j < width ? n - j : width;
        double sum = x[j];
        for (int64_t i = 1; i < end; i++) sum -= column[i] * x[j + i];
        x[j] = sum / column[0];
    }
}

/* Step of the control points for right sides of the rows, and of the rows. */
static void newton_step(const Rows *a, const double *factor, const double *dual, const double *right,
                        int64_t frozen_count, const int64_t *frozen, double *dx, double *dr) {
    for (int64_t j = 0; j < a->n; j++) dx[j] = dual[j];
    add_transposed(a, right, dx);
    for (int64_t j = 0; j < a->n; j++) dx[j] = -dx[j];
    for (int64_t f = 0; f < frozen_count; f++) dx[frozen[f]] = 0.0;
    solve(a->n, a->width, factor, dx);
    products(a, dx, dr);
}

/* What the rows are at control points, and the objective there with its gradient. */
static double measure(const Rows *a, const double *objective, const double *x, double *value, double *gradient) {
    products(a, x, value);
    for (int64_t k = 0; k < a->count; k++) value[k] -= a->offset[k];
    tube_apply_band(a->width, a->n, objective, x, gradient);
    double cost = 0.0;
    for (int64_t j = 0; j < a->n; j++) cost += gradient[j] * x[j];
    return 0.5 * cost;
}

int64_t tube_solve_work(int64_t count, int64_t width, int64_t n) { return 15 * count + (2 * width + 3) * n; }

int64_t tube_solve(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                   const double *offset, int64_t n, const double *objective, int64_t frozen_count, const int64_t *frozen,
                   double *x, double *work) {
    const Rows a = {count, width, dim, n, first, rows, offset};
    const Point at = point_at(work, count), by = point_at(work + 6 * count, count);
    double *value = work + 12 * count, *right = value + count, *dr = right + count;
    double *gradient = dr + count, *dual = gradient + n, *dx = dual + n, *columns = dx + n, *factor = columns + width * n;
    double cost = measure(&a, objective, x, value, gradient), primal, reach;
    const double price = start(&a, value, cost, at);
    for (int64_t iteration = 1; iteration <= MOST_ITERATIONS; iteration++) {
        newton_system(&a, objective, at, frozen_count, frozen, columns);
        int boost = 0;
        while (boost < BOOST_COUNT && !cholesky(n, width, columns, BOOSTS[boost], factor)) boost++;
        if (boost == BOOST_COUNT) return iteration;
        for (int64_t k = 0; k < count; k++) right[k] = at.z1[k] - at.z2[k];
        for (int64_t j = 0; j < n; j++) dual[j] = gradient[j];
        add_transposed(&a, right, dual);
        right_sides(&a, at, value, price, 0.0, 0, right);
        newton_step(&a, factor, dual, right, frozen_count, frozen, dx, dr);
        step_of(&a, at, value, price, 0.0, 0, dr, by);
        lengths(count, at, by, 1.0, &primal, &reach);
        const double gap = gap_after(count, at, by, 0.0, 0.0), share = gap_after(count, at, by, primal, reach) / gap;
        const double centring = smaller(1.0, larger(share * share * share, LEAST_CENTRING));
        const double mu = centring * gap / (3.0 * (double)count);
        right_sides(&a, at, value, price, mu, &by, right);
        newton_step(&a, factor, dual, right, frozen_count, frozen, dx, dr);
        step_of(&a, at, value, price, mu, &by, dr, by);
        lengths(count, at, by, TO_BOUNDARY, &primal, &reach);
        for (int64_t j = 0; j < n; j++) x[j] += primal * dx[j];
        advance(count, at, by, primal, reach);
        cost = measure(&a, objective, x, value, gradient);
        double off = 0.0;
        for (int64_t k = 0; k < count; k++) off = larger(off, fabs(at.s1[k] - (1.0 + at.e[k] - value[k])));
        if (gap_after(count, at, by, 0.0, 0.0) <= GAP * larger(cost, LEAST) && off <= INFEASIBLE) return iteration;
    }
    return MOST_ITERATIONS;
}

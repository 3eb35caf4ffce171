/* The rows of a problem in a block of points, as the passes of the interior-point method see them. */
#ifndef FEEDPLAN_INTERIOR_ROWS_INLINE_H
#define FEEDPLAN_INTERIOR_ROWS_INLINE_H

#include "interior_inline.h"

enum { ACCELERATION, JERK };

/* Slacks and multipliers are kept with 24 bits.  A slack is rounded down: where it is the true one it may not seem violated.
   All that follows from a rounded one follows from it alone, so that nothing adds up. */
static const double ROUND_DOWN = 1.0 - 0x1p-24;

INLINE double keep_slack(float *to, double slack) {
    *to = (float)(slack * ROUND_DOWN);
    return (double)*to;
}

INLINE double keep_dual(float *to, double dual) {
    *to = (float)dual;
    return (double)*to;
}

/* One row in a block: its coefficients, the sizes of its bounds, what violations are divided by (times 1 + pace), slacks and
   multipliers of its two sides. */
typedef struct {
    const double *x, *a, *c;
    double up, down, per_up, per_down;
    float *s1, *l1, *s2, *l2;
} Row;

/* Coefficients of a row, tightened. */
typedef struct {
    double x[BLOCK], a[BLOCK], c[BLOCK];
} Tightened;

INLINE void tighten(int64_t count, const double *by, Row *row, int jerk, Tightened *to) {
    APART
    for (int64_t i = 0; i < count; i++) {
        to->x[i] = row->x[i] * by[i];
        to->a[i] = row->a[i] * by[i];
        if (jerk) to->c[i] = row->c[i] * by[i];
    }
    row->x = to->x;
    row->a = to->a;
    row->c = to->c;
}

INLINE Row row_of(const Problem *problem, int64_t block, int64_t i, float *pairs, Tightened *tightened) {
    const int64_t points = problem->points, at = block * BLOCK, k = i - problem->accelerations;
    const double *r = k < 0 ? problem->acceleration + 2 * i * points + at : problem->jerk + 3 * k * points + at;
    const double *bounds = problem->bounds + 2 * i;
    float *own = pairs + 2 * BLOCK * (block * problem->sides + 1 + 2 * i);
    Row row = {
        .x = r,
        .a = r + points,
        .c = r + 2 * points,
        .up = bounds[0],
        .down = bounds[1],
        .per_up = 1.0 / larger(bounds[0], 1.0),
        .per_down = 1.0 / larger(bounds[1], 1.0),
        .s1 = own,
        .l1 = own + BLOCK,
        .s2 = own + 2 * BLOCK,
        .l2 = own + 3 * BLOCK,
    };
    if (k < 0 && problem->steady) tighten(points_in(problem, block), problem->steady + at, &row, 0, tightened);
    else if (k >= 0 && problem->jerky) tighten(points_in(problem, block), problem->jerky + at, &row, 1, tightened);
    return row;
}

INLINE double value_of(int kind, const Row *row, int64_t i, const Motion *z) {
    const double value = row->x[i] * z->x[i] + row->a[i] * z->a[i];
    return kind == JERK ? value + row->c[i] * z->c[i] : value;
}

/* The bound per unit of its size: the pace, or 1. */
INLINE double pace_of(int kind, int64_t i, const Motion *z) { return kind == JERK ? z->pace[i] : 1.0; }

/* Derivative of the pace by x. */
INLINE double pace_slope(double pace) { return -0.5 * pace * pace * pace; }

/* 1 / a and 1 / b, by one division: they are what takes longest. */
typedef struct {
    double a, b;
} Inverses;

INLINE Inverses inverses(double a, double b) {
    const double both = 1.0 / (a * b);
    return (Inverses){b * both, a * both};
}

#endif

/* Legs and blends at one point, for compiled code: the formulas of blend.py. */
#ifndef PLANNER_GEOMETRY_BLEND_INLINE_H
#define PLANNER_GEOMETRY_BLEND_INLINE_H

#include "planner/geometry/curve_inline.h"
#include "planner/geometry/differential_inline.h"

/* Most columns: nine axes, and those of the path that a feed is measured on beside X Y Z; coefficients of a panel of the
 * inverse of the arc length. */
enum { CHAIN_COLUMNS = 15, BLEND_TERMS = 12 };

/* Position and three derivatives of each column. */
typedef double Derivatives[4][CHAIN_COLUMNS];

/* Vectors o, e1, e2 and g (4, dim) and rates w and k (2) of a leg. */
typedef struct {
    int64_t dim;
    const double *vectors, *rates;
} Leg;

/* (1 + k x) (e1 cos wx + e2 sin wx) + g x and its first three derivatives. */
static inline void leg_turning(const Leg *leg, double x, Derivatives out)
{
    const int64_t dim = leg->dim;
    const double *e1 = leg->vectors + dim, *e2 = e1 + dim, *g = e2 + dim;
    const double w = leg->rates[0], k = leg->rates[1];
    if (w == 0.0 && k == 0.0) { /* lines are most of a program, and need no sine */
        for (int64_t j = 0; j < dim; j++) {
            out[0][j] = e1[j] + g[j] * x;
            out[1][j] = g[j];
            out[2][j] = out[3][j] = 0.0;
        }
        return;
    }
    const double cosine = cos(w * x), sine = sin(w * x), grown = 1.0 + k * x;
    for (int64_t j = 0; j < dim; j++) {
        const double circle = e1[j] * cosine + e2[j] * sine, along = w * (e2[j] * cosine - e1[j] * sine);
        out[0][j] = grown * circle + g[j] * x;
        out[1][j] = grown * along + k * circle + g[j];
        out[2][j] = -grown * (w * w) * circle + 2.0 * k * along;
        out[3][j] = -grown * (w * w) * along - 3.0 * k * (w * w) * circle;
    }
}

/* Value of a Chebyshev series at x, by Clenshaw's recurrence. */
static inline double chebyshev_value(const double *series, int64_t terms, double x)
{
    double b1 = 0.0, b2 = 0.0;
    for (int64_t k = terms - 1; k > 0; k--) {
        const double b0 = series[k] - b2 + 2.0 * x * b1;
        b2 = b1;
        b1 = b0;
    }
    return series[0] - b2 + x * b1;
}

/* tau of a shape at a share of its length, by the panels of blend_tabulate, of which guess was the last; those of shape i are
 * from first_panel[i] on, with one edge more than panels for each shape. */
static inline double tau_of_share(const int64_t *first_panel, const double *edges, const double *series, int64_t shape,
                                  double share, int64_t *guess)
{
    const int64_t first = first_panel[shape], panels = first_panel[shape + 1] - first;
    edges += first + shape;
    const int64_t panel = *guess = find_piece(panels, edges, share, 0, *guess);
    const double x = 2.0 * (share - edges[panel]) / (edges[panel + 1] - edges[panel]) - 1.0;
    return smaller(larger(chebyshev_value(series + (first + panel) * BLEND_TERMS, BLEND_TERMS, x), -1.0), 1.0);
}

/* Derivatives 0..3 with respect to tau of the blend between two legs from its corner, of size A. */
static inline void blend_at(const double *vertex, const Leg *before, const Leg *after, double size, double tau,
                            Derivatives out)
{
    const Leg *legs[2] = {before, after};
    const int64_t dim = before->dim;
    for (int64_t j = 0; j < dim; j++) {
        out[0][j] = vertex[j];
        out[1][j] = out[2][j] = out[3][j] = 0.0;
    }
    for (int side = 0; side < 2; side++) {
        const double sign = side ? 1.0 : -1.0, reach = 1.0 + sign * tau;
        const double x = size * (reach * reach * reach);
        const double x1 = 3.0 * sign * size * (reach * reach), x2 = 6.0 * size * reach, x3 = 6.0 * sign * size;
        Derivatives d;
        leg_turning(legs[side], x, d);
        for (int64_t j = 0; j < dim; j++) {
            const Triple moved = chain_rule(d[1][j], d[2][j], d[3][j], x1, x2, x3);
            out[0][j] += d[0][j] - legs[side]->vectors[dim + j];
            out[1][j] += moved.first;
            out[2][j] += moved.second;
            out[3][j] += moved.third;
        }
    }
}

/* Derivatives with respect to another parameter turned into those with respect to the arc length, in place; weight (dim) is what
 * the square of each column counts in the length. */
static inline void by_arc_length(int64_t dim, const double *weight, Derivatives d)
{
    double squared = 0.0, along = 0.0, bend = 0.0;
    for (int64_t j = 0; j < dim; j++) {
        squared += weight[j] * square(d[1][j]);
        along += weight[j] * (d[1][j] * d[2][j]);
        bend += weight[j] * (square(d[2][j]) + d[1][j] * d[3][j]);
    }
    const Triple speeds = speed_derivatives(squared, along, bend);
    const double v = speeds.first;
    for (int64_t j = 0; j < dim; j++) {
        const double first = d[1][j] / v, second = (d[2][j] - speeds.second * first) / (v * v);
        const double third = d[3][j] - 3.0 * v * speeds.second * second - speeds.third * first;
        d[1][j] = first;
        d[2][j] = second;
        d[3][j] = third / (v * v * v);
    }
}

#endif

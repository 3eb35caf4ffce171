/* Rational Bezier curves at a distance along them, for compiled code: the formulas of bezier.py. */
#ifndef PLANNER_GEOMETRY_BEZIER_INLINE_H
#define PLANNER_GEOMETRY_BEZIER_INLINE_H

#include "planner/geometry/curve_inline.h"
#include "planner/geometry/differential_inline.h"

/* Most columns: nine axes, and those of the path that a feed is measured on beside X Y Z; coefficients of a panel of the
 * inverse of an arc length. */
enum { CHAIN_COLUMNS = 15, SHARE_TERMS = 12 };

/* Position and three derivatives of each column. */
typedef double Derivatives[4][CHAIN_COLUMNS];

/* Curves, each over w in [0, 1] from its start: powers (., dim + 1, terms), the denominator last; the length of each; and the
 * panels of 2 w - 1 over the share of its length, from first_panel[i] on, with one edge more than panels for each curve. */
typedef struct {
    int64_t dim, terms;
    const double *powers, *length;
    const int64_t *first_panel;
    const double *edges, *series;
    const double *weight; /* what the square of each column counts in the length; NULL: 1 */
} Beziers;

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
    return smaller(larger(chebyshev_value(series + (first + panel) * SHARE_TERMS, SHARE_TERMS, x), -1.0), 1.0);
}

/* Derivatives with respect to another parameter turned into those with respect to the arc length, in place; weight (dim) is what
 * the square of each column counts in the length, 1 where it is NULL. */
static inline void by_arc_length(int64_t dim, const double *weight, Derivatives d)
{
    double squared = 0.0, along = 0.0, bend = 0.0;
    for (int64_t j = 0; j < dim; j++) {
        const double counts = weight ? weight[j] : 1.0;
        squared += counts * square(d[1][j]);
        along += counts * (d[1][j] * d[2][j]);
        bend += counts * (square(d[2][j]) + d[1][j] * d[3][j]);
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

/* w of curve i at the distance s along it. */
static inline double bezier_parameter(const Beziers *beziers, int64_t i, double s, int64_t *guess)
{
    const double length = beziers->length[i];
    if (!(s > 0.0))
        return 0.0;
    if (s >= length)
        return 1.0;
    return 0.5 * (1.0 + tau_of_share(beziers->first_panel, beziers->edges, beziers->series, i, s / length, guess));
}

/* Way from the start of curve i to w, and its derivatives 1..3 over w. */
static inline void bezier_over_parameter(const Beziers *beziers, int64_t i, double w, Derivatives out)
{
    const int64_t dim = beziers->dim, terms = beziers->terms;
    const double *row = beziers->powers + i * (dim + 1) * terms;
    Taylor v = expand(row + dim * terms, terms, w);
    v.c0 = 1.0 / v.c0;
    for (int64_t j = 0; j < dim; j++, row += terms) {
        Taylor c = expand(row, terms, w);
        c.c0 *= v.c0;
        c.c1 = (c.c1 - v.c1 * c.c0) * v.c0;
        c.c2 = (c.c2 - v.c1 * c.c1 - v.c2 * c.c0) * v.c0;
        c.c3 = (c.c3 - v.c1 * c.c2 - v.c2 * c.c1 - v.c3 * c.c0) * v.c0;
        out[0][j] = c.c0;
        out[1][j] = c.c1;
        out[2][j] = 2.0 * c.c2;
        out[3][j] = 6.0 * c.c3;
    }
}

/* Way from the start of curve i to the distance s along it, and its derivatives 1..3 over s. */
static inline void bezier_along(const Beziers *beziers, int64_t i, double s, Derivatives out)
{
    int64_t guess = 0;
    bezier_over_parameter(beziers, i, bezier_parameter(beziers, i, s, &guess), out);
    by_arc_length(beziers->dim, beziers->weight, out);
}

#endif

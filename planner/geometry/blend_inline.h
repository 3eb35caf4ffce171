/* Legs and blends at one point, for compiled code: the formulas of blend.py. */
#ifndef PLANNER_GEOMETRY_BLEND_INLINE_H
#define PLANNER_GEOMETRY_BLEND_INLINE_H

#include "planner/geometry/bezier_inline.h"

/* Vectors o, e1, e2 and g (4, dim) and rates w and k (2) of a leg; and where that is a stretch of a curve (way no NULL, way[0] no
 * -1): which one, from what distance along it on, and in which direction (way: 3). */
typedef struct {
    int64_t dim;
    const double *vectors, *rates, *way;
    const Beziers *beziers;
} Leg;

static inline int is_stretch(const Leg *leg) { return leg->way && leg->way[0] >= 0.0; }

/* (1 + k x) (e1 cos wx + e2 sin wx) + g x and its first three derivatives; on a curve the way from its start. */
static inline void leg_turning(const Leg *leg, double x, Derivatives out)
{
    const int64_t dim = leg->dim;
    if (is_stretch(leg)) {
        const double direction = leg->way[2];
        bezier_along(leg->beziers, (int64_t)leg->way[0], leg->way[1] + direction * x, out);
        for (int64_t j = 0; j < dim; j++) {
            out[1][j] *= direction;
            out[3][j] *= direction;
        }
        return;
    }
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

#endif

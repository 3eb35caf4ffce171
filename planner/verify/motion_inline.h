/* What each point of a plan means for axes and tool tip.
 *
 * The quantities of a point, in the rows of quantities.py, follow from the derivatives d of the machine axes and p of the tool
 * tip with respect to u, and from the first three time derivatives of u.  A block of points is measured at a time, each
 * operation on all of them, for that is what the vector units of a processor do.
 */
#ifndef PLANNER_VERIFY_MOTION_INLINE_H
#define PLANNER_VERIFY_MOTION_INLINE_H

#include "planner/geometry/differential_inline.h"

/* Inlined whatever its size: so a HOT caller has it for both processors. */
#define INLINED static inline __attribute__((always_inline))

enum { FEED, ALONG_ACCELERATION, ALONG_JERK, REVERSAL, FIRST_AXIS, MAX_AXES = 9, ROWS = FIRST_AXIS + 3 * MAX_AXES };
enum { BLOCK = 32 }; /* points of a block */

typedef double Points[BLOCK];

/* First to third derivative of each coordinate of axes or tip at the points of a block. */
typedef struct {
    int64_t dim;
    Points q[3][MAX_AXES];
} Path;

/* Time derivatives of u at the points of a block, and what rounding can change in them. */
typedef struct {
    Points u1, u2, u3;
    Points off1, off2, off3;
} Rates;

typedef struct {
    Points value[ROWS], granted[ROWS];
} Quantities;

/* The arrays of a pass: derivatives of axes d (4, points, dim) and tip p (4, points, tip; NULL: the same), rates (3, points), and
 * what rounding can change in these, slack (., 3), a row for so many points each. */
typedef struct {
    int64_t points, dim, tip;
    const double *d, *p, *rates, *slack;
    int64_t each;
} States;

/* Sums over the coordinates of the tip at the points of a block. */
typedef struct {
    Points speed, scale; /* |p_u|; 1 / |p_u|, or where the tip rests 1 / |p_uu| */
    Points bend;         /* p_uu.t */
    Points turn;         /* square of the part of p_uu across t */
    Points second, third, off1, off2, off3;
} Tip;

INLINED void path_load(Path *path, int64_t points, int64_t dim, const double *d, int64_t first, int64_t count)
{
    path->dim = dim;
    for (int order = 0; order < 3; order++) {
        const double *from = d + ((order + 1) * points + first) * dim;
        for (int64_t k = 0; k < count; k++)
            for (int64_t j = 0; j < dim; j++)
                path->q[order][j][k] = from[k * dim + j];
    }
}

/* What errors of up to off1, off2 and off3 in the time derivatives of u can change in those of C, to first order and beyond: the chain rule
 * takes no larger value than from the sizes of all its terms. */
INLINED Triple rounded(double c1, double c2, double c3, double u1, double u2, double u3, double off1, double off2,
                       double off3)
{
    c1 = fabs(c1), c2 = fabs(c2), c3 = fabs(c3), u1 = fabs(u1), u2 = fabs(u2), u3 = fabs(u3);
    const Triple high = chain_rule(c1, c2, c3, u1 + off1, u2 + off2, u3 + off3);
    const Triple low = chain_rule(c1, c2, c3, u1, u2, u3);
    const Triple change = {high.first - low.first, high.second - low.second, high.third - low.third};
    return change;
}

/* Time derivatives of coordinate j of a path, and what rounding can change in them, into rows that stand apart. */
INLINED void measure_coordinate(const Path *path, int64_t j, const Rates *rates, int64_t count, int64_t apart,
                                Points *value, Points *granted)
{
    const double *c1 = path->q[0][j], *c2 = path->q[1][j], *c3 = path->q[2][j];
    double *restrict v1 = value[0], *restrict v2 = value[apart], *restrict v3 = value[2 * apart];
    double *restrict off1 = granted[0], *restrict off2 = granted[apart], *restrict off3 = granted[2 * apart];
    for (int64_t k = 0; k < count; k++) {
        const double u1 = rates->u1[k], u2 = rates->u2[k], u3 = rates->u3[k];
        const Triple here = chain_rule(c1[k], c2[k], c3[k], u1, u2, u3);
        const Triple off = rounded(c1[k], c2[k], c3[k], u1, u2, u3, rates->off1[k], rates->off2[k], rates->off3[k]);
        v1[k] = here.first, v2[k] = here.second, v3[k] = here.third;
        off1[k] = off.first, off2[k] = off.second, off3[k] = off.third;
    }
}

INLINED void tip_tangent(const Path *path, int64_t count, Tip *tip)
{
    Points size;
    for (int64_t k = 0; k < count; k++)
        tip->speed[k] = size[k] = tip->bend[k] = 0.0;
    for (int64_t j = 0; j < path->dim; j++)
        for (int64_t k = 0; k < count; k++) {
            tip->speed[k] += square(path->q[0][j][k]);
            size[k] += square(path->q[1][j][k]);
        }
    for (int64_t k = 0; k < count; k++) {
        const double speed = sqrt(tip->speed[k]), bent = sqrt(size[k]);
        const double along = speed > 0.0 ? speed : bent;
        tip->speed[k] = speed;
        tip->scale[k] = along > 0.0 ? 1.0 / along : 0.0;
    }
    for (int64_t j = 0; j < path->dim; j++)
        for (int64_t k = 0; k < count; k++) {
            const double second = path->q[1][j][k], first = path->q[0][j][k];
            tip->bend[k] += second * (tip->speed[k] > 0.0 ? first : second) * tip->scale[k];
        }
}

INLINED void tip_sums(const Path *path, int64_t j, int64_t count, int64_t apart, const Points *value,
                      const Points *granted, Tip *tip)
{
    const double *acceleration = value[apart], *jerk = value[2 * apart];
    const double *off1 = granted[0], *off2 = granted[apart], *off3 = granted[2 * apart];
    for (int64_t k = 0; k < count; k++) {
        const double first = path->q[0][j][k], second = path->q[1][j][k];
        const double tangent = (tip->speed[k] > 0.0 ? first : second) * tip->scale[k];
        tip->turn[k] += square(second - tip->bend[k] * tangent);
        tip->second[k] += acceleration[k] * tangent;
        tip->third[k] += jerk[k] * tangent;
        tip->off1[k] += square(off1[k]);
        tip->off2[k] += square(off2[k]);
        tip->off3[k] += square(off3[k]);
    }
}

/* Feed, tangential acceleration and jerk.  A cartesian tip is made of the axes, which have been measured.
 *
 * Along the tip p with unit tangent t:  s' = p'.t,  s'' = p''.t,  s''' = p'''.t + p''.t', where p''.t' = |n|^2 u'^3 / |p_u|
 * with n the part of p_uu across t.  Where the tip rests in the parameter, it leaves along its second derivative. */
INLINED void measure_tip(const Path *path, int cartesian, const Rates *rates, int64_t count, Quantities *out)
{
    Tip tip;
    Points value[3], granted[3];
    tip_tangent(path, count, &tip);
    for (int64_t k = 0; k < count; k++)
        tip.turn[k] = tip.second[k] = tip.third[k] = tip.off1[k] = tip.off2[k] = tip.off3[k] = 0.0;
    for (int64_t j = 0; j < path->dim; j++) {
        if (cartesian) {
            tip_sums(path, j, count, path->dim, out->value + FIRST_AXIS + j, out->granted + FIRST_AXIS + j, &tip);
        } else {
            measure_coordinate(path, j, rates, count, 1, value, granted);
            tip_sums(path, j, count, 1, value, granted, &tip);
        }
    }
    for (int64_t k = 0; k < count; k++) {
        const double u1 = rates->u1[k], size = fabs(u1), wide = size + rates->off1[k];
        const double turning = tip.turn[k] / tip.speed[k], turn = tip.speed[k] > 0.0 ? turning : 0.0;
        out->value[FEED][k] = tip.speed[k] * u1;
        out->value[ALONG_ACCELERATION][k] = tip.second[k];
        out->value[ALONG_JERK][k] = tip.third[k] + turn * (u1 * u1 * u1);
        out->granted[FEED][k] = sqrt(tip.off1[k]);
        out->granted[ALONG_ACCELERATION][k] = sqrt(tip.off2[k]);
        out->granted[ALONG_JERK][k] = sqrt(tip.off3[k]) + turn * (wide * wide * wide - size * size * size);
    }
}

/* Measure count points, at most BLOCK, from the first on. */
INLINED void measure_block(const States *states, int64_t first, int64_t count, Quantities *out)
{
    Path axes, tip;
    Rates rates;
    const int64_t dim = states->dim, points = states->points;
    path_load(&axes, points, dim, states->d, first, count);
    const double *slack = states->slack + first / states->each * 3;
    for (int64_t k = 0, within = first % states->each; k < count; k++) {
        rates.off1[k] = slack[0], rates.off2[k] = slack[1], rates.off3[k] = slack[2];
        if (++within == states->each) {
            within = 0;
            slack += 3;
        }
    }
    for (int64_t k = 0; k < count; k++) {
        rates.u1[k] = states->rates[first + k];
        rates.u2[k] = states->rates[points + first + k];
        rates.u3[k] = states->rates[2 * points + first + k];
        out->value[REVERSAL][k] = -rates.u1[k];
        out->granted[REVERSAL][k] = rates.off1[k];
    }
    for (int64_t j = 0; j < dim; j++)
        measure_coordinate(&axes, j, &rates, count, dim, out->value + FIRST_AXIS + j, out->granted + FIRST_AXIS + j);
    if (states->p) {
        path_load(&tip, points, states->tip, states->p, first, count);
        measure_tip(&tip, 0, &rates, count, out);
    } else {
        measure_tip(&axes, 1, &rates, count, out);
    }
}

#endif

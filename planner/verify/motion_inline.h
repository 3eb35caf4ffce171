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
enum { BLOCK = 32 };      /* points of a block */
enum { COURSE_SIZES = 5 }; /* of a span's course, before its two ends */

typedef double Points[BLOCK];

/* First to third derivative of each coordinate of axes or tip at the points of a block. */
typedef struct {
    int64_t dim;
    Points q[3][MAX_AXES];
} Path;

/* Time derivatives of u at the points of a block, and what rounding can change in them; further the powers and products of them
 * that the chain rule takes, u'^2, u'^3 and 3 u' u'', and what rounding can change in the sizes of these. */
typedef struct {
    Points u1, u2, u3;
    Points off1, off2, off3;
    Points square, cube, mixed;
    Points off_square, off_cube, off_mixed;
} Rates;

typedef struct {
    Points value[ROWS], granted[ROWS];
    /* Squares, of the tip: of the acceleration across its path, INFINITY where it goes back, and along it; of the rate at which its direction
     * turns, INFINITY where it has none; of its jerk along the path and across it. */
    Points across, along, swing, jolt[2];
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
    Points second, third, off2, off3;
    Points jolt; /* square of the jerk */
} Tip;

/* Coordinates of so many points, one after the other, each into a row of its own. */
INLINED void rows_load(int64_t dim, const double *from, int64_t count, Points *row)
{
    if (dim == 2) /* most curves: the compiler makes vectors of both at once */
        for (int64_t k = 0; k < count; k++) {
            row[0][k] = from[2 * k];
            row[1][k] = from[2 * k + 1];
        }
    else if (dim == 3)
        for (int64_t k = 0; k < count; k++) {
            row[0][k] = from[3 * k];
            row[1][k] = from[3 * k + 1];
            row[2][k] = from[3 * k + 2];
        }
    else
        for (int64_t k = 0; k < count; k++)
            for (int64_t j = 0; j < dim; j++)
                row[j][k] = from[k * dim + j];
}

INLINED void path_load(Path *path, int64_t points, int64_t dim, const double *d, int64_t first, int64_t count)
{
    path->dim = dim;
    for (int order = 0; order < 3; order++)
        rows_load(dim, d + ((order + 1) * points + first) * dim, count, path->q[order]);
}

/* What the chain rule takes of the rates is the same for every coordinate. */
INLINED void rates_expand(Rates *rates, int64_t count)
{
    for (int64_t k = 0; k < count; k++) {
        const double u1 = rates->u1[k], u2 = rates->u2[k], size = fabs(u1);
        const double off1 = rates->off1[k], off2 = rates->off2[k];
        rates->square[k] = u1 * u1;
        rates->cube[k] = u1 * u1 * u1;
        rates->mixed[k] = 3.0 * u1 * u2;
        rates->off_square[k] = off1 * (2.0 * size + off1);
        rates->off_cube[k] = off1 * (3.0 * size * (size + off1) + off1 * off1);
        rates->off_mixed[k] = 3.0 * (off1 * (fabs(u2) + off2) + size * off2);
    }
}

/* Time derivatives of coordinate j of a path, and what rounding can change in them, into rows that stand apart.
 *
 * What errors of up to off1, off2 and off3 in the time derivatives of u can change, to first order and beyond: the chain rule takes
 * no larger value than from the sizes of all its terms.  Of its powers and products the gain is written out, (u + off)^2 - u^2 =
 * off (2 u + off): a difference would leave some digits of so small an error. */
INLINED void measure_coordinate(const Path *path, int64_t j, const Rates *rates, int64_t count, int64_t apart,
                                Points *value, Points *granted)
{
    const double *c1 = path->q[0][j], *c2 = path->q[1][j], *c3 = path->q[2][j];
    double *restrict v1 = value[0], *restrict v2 = value[apart], *restrict v3 = value[2 * apart];
    double *restrict off1 = granted[0], *restrict off2 = granted[apart], *restrict off3 = granted[2 * apart];
    for (int64_t k = 0; k < count; k++) {
        v1[k] = c1[k] * rates->u1[k];
        v2[k] = c2[k] * rates->square[k] + c1[k] * rates->u2[k];
        v3[k] = c3[k] * rates->cube[k] + c2[k] * rates->mixed[k] + c1[k] * rates->u3[k];
    }
    for (int64_t k = 0; k < count; k++) {
        const double size1 = fabs(c1[k]), size2 = fabs(c2[k]), size3 = fabs(c3[k]);
        off1[k] = size1 * rates->off1[k];
        off2[k] = size2 * rates->off_square[k] + size1 * rates->off2[k];
        off3[k] = size3 * rates->off_cube[k] + size2 * rates->off_mixed[k] + size1 * rates->off3[k];
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
        const double along = sqrt(tip->speed[k] > 0.0 ? tip->speed[k] : size[k]);
        tip->speed[k] = tip->speed[k] > 0.0 ? along : 0.0;
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
    const double *off2 = granted[apart], *off3 = granted[2 * apart];
    for (int64_t k = 0; k < count; k++) {
        const double first = path->q[0][j][k], second = path->q[1][j][k];
        const double tangent = (tip->speed[k] > 0.0 ? first : second) * tip->scale[k];
        tip->turn[k] += square(second - tip->bend[k] * tangent);
        tip->second[k] += acceleration[k] * tangent;
        tip->third[k] += jerk[k] * tangent;
        tip->jolt[k] += square(jerk[k]);
        tip->off2[k] += square(off2[k]);
        tip->off3[k] += square(off3[k]);
    }
}

/* What is no number is infinite. */
static inline double bounded(double size) { return size < INFINITY ? size : INFINITY; }

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
        tip.turn[k] = tip.second[k] = tip.third[k] = tip.off2[k] = tip.off3[k] = tip.jolt[k] = 0.0;
    for (int64_t j = 0; j < path->dim; j++) {
        if (cartesian) {
            tip_sums(path, j, count, path->dim, out->value + FIRST_AXIS + j, out->granted + FIRST_AXIS + j, &tip);
        } else {
            measure_coordinate(path, j, rates, count, 1, value, granted);
            tip_sums(path, j, count, 1, value, granted, &tip);
        }
    }
    for (int64_t k = 0; k < count; k++) {
        const double u1 = rates->u1[k];
        const double turn = tip.speed[k] > 0.0 ? tip.turn[k] * tip.scale[k] : 0.0;
        out->value[FEED][k] = tip.speed[k] * u1;
        out->value[ALONG_ACCELERATION][k] = tip.second[k];
        out->value[ALONG_JERK][k] = tip.third[k] + turn * rates->cube[k];
        out->granted[FEED][k] = tip.speed[k] * rates->off1[k];
        out->granted[ALONG_ACCELERATION][k] = sqrt(tip.off2[k]);
        out->granted[ALONG_JERK][k] = sqrt(tip.off3[k]) + turn * rates->off_cube[k];
        out->across[k] = bounded(u1 >= 0.0 ? tip.turn[k] * square(rates->square[k]) : INFINITY);
        out->along[k] = bounded(square(tip.second[k]));
        out->swing[k] = bounded(tip.speed[k] > 0.0 ? tip.turn[k] * square(tip.scale[k] * u1) : INFINITY);
        out->jolt[0][k] = bounded(square(tip.third[k]));
        out->jolt[1][k] = bounded(tip.jolt[k] - square(tip.third[k]));
    }
}

/* Measure count points, at most BLOCK, from the first on. */
INLINED void measure_block(const States *states, int64_t first, int64_t count, Quantities *out)
{
    Path axes, tip;
    Rates rates;
    const int64_t dim = states->dim, points = states->points;
    path_load(&axes, points, dim, states->d, first, count);
    for (int64_t k = 0, point = first; k < count;) {
        const double *slack = states->slack + point / states->each * 3, off1 = slack[0], off2 = slack[1], off3 = slack[2];
        const int64_t rest = states->each - point % states->each, end = k + rest < count ? k + rest : count;
        point += end - k;
        for (; k < end; k++)
            rates.off1[k] = off1, rates.off2[k] = off2, rates.off3[k] = off3;
    }
    for (int64_t k = 0; k < count; k++) {
        rates.u1[k] = states->rates[first + k];
        rates.u2[k] = states->rates[points + first + k];
        rates.u3[k] = states->rates[2 * points + first + k];
        out->value[REVERSAL][k] = -rates.u1[k];
        out->granted[REVERSAL][k] = rates.off1[k];
    }
    rates_expand(&rates, count);
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

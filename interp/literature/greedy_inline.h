/* Algorithms 1 to 4 (2022): the path, the limits of the feed at a point, the S-curves.

   Sums and products are in the order of the published loops: a count of points depends on them. */
#ifndef FEEDPLAN_GREEDY_INLINE_H
#define FEEDPLAN_GREEDY_INLINE_H

#include "planner/core.h"

/* What a loop returns. */
enum {
    RUNNING,    /* there is no more room */
    DONE,       /* u has reached 1 */
    SINGULAR,   /* |C'| vanishes */
    NOT_FINITE, /* the step is not a positive number */
    NO_ADVANCE, /* u + du = u, or five steps below 1e-12 */
    BACK_OFF,   /* the factor theta reached 0, or too many passes */
    TOO_LONG    /* a step beyond a tenth of the range */
};

/* Indices into the settings. */
enum {
    PERIOD,        /* T, s */
    FEED,          /* F, mm/s */
    TOLERANCE,     /* chord error, mm */
    SAFETY,        /* lambda */
    RISE,          /* end of the rising S-curve */
    FALL,          /* start of the falling one */
    FLOOR,         /* mm/s */
    JERK,          /* mm/s^3, of the planned feedrate */
    ALGORITHM,     /* 1 to 4 */
    ROOT,          /* 1: the step is solved for; 0: multiplied by theta as published */
    EXACT_TAYLOR,  /* 1: the second term of the step has C'.C''/|C'|; 0: |C''| */
    PLANNED_FEED,  /* 1: the planned feedrate drives the step; 0: the command */
    WRONG_BEND,    /* scale of the butterfly whose published C'' is added; 0: the exact C'' */
    SOFT,          /* 1: brake within acceleration and jerk, at the price of the feedrate limit */
    SINGULAR_SPEED /* |C'| at which the curve has no direction */
};

/* Indices into the state. */
enum {
    U,
    PLANNED, /* feedrate, mm/s */
    RATE,    /* its change over the last period, mm/s^2 */
    PIECE,
    ERROR_PIECE,
    TINY_STEPS,
    COUNT, /* points written by the last call */
    DU,    /* the last step */
    THETA, /* the last factor */
    SPEED  /* |C'| at u */
};

/* Columns of what greedy_along writes. */
enum {
    LENGTH,       /* of the chord to the next point, mm */
    ERROR,        /* its distance from the curve, mm */
    AXIS_LIMIT,   /* limit 2, mm/s */
    NORMAL_LIMIT, /* limit 4, mm/s */
    CURVATURE,    /* 1/mm */
    SHAPE,        /* S-curve factor */
    LOWEST,       /* tangential acceleration allowed at the feed of the step before, mm/s^2 */
    HIGHEST,
    PUBLISHED_BOUND, /* the bound that the published program clips to, mm/s^2 */
    COLUMNS
};

enum { MOST_AXES = 9 }; /* a curve has no more */

static const double PI = 3.14159265358979323846;
static const double NEGLIGIBLE = 1e-12; /* a component of the unit tangent below which an axis bounds no acceleration */

/* Pieces over u in [0, 1]; beyond the ends the outermost goes on, since the last step of the published program overshoots.
   breaks (last + 2), coefficients (last + 1, dim + 1, powers), ascending; the last row of a piece is its denominator. */
typedef struct {
    const double *breaks, *coefficients;
    int64_t last, dim, powers, rational;
} Path;

static inline int64_t piece_of(const Path *path, double u, int64_t piece)
{
    while (piece < path->last && u >= path->breaks[piece + 1])
        piece++;
    while (piece > 0 && u < path->breaks[piece])
        piece--;
    return piece;
}

static inline const double *row_of(const Path *path, int64_t piece, int64_t row)
{
    return path->coefficients + (piece * (path->dim + 1) + row) * path->powers;
}

static inline double value(const double *row, int64_t powers, double w)
{
    double found = row[powers - 1];
    for (int64_t k = powers - 2; k >= 0; k--)
        found = found * w + row[k];
    return found;
}

/* Write the point at u, out (dim); returns its piece. */
static inline int64_t point(const Path *path, double u, int64_t piece, double *out)
{
    piece = piece_of(path, u, piece);
    const double w = (u - path->breaks[piece]) / (path->breaks[piece + 1] - path->breaks[piece]);
    double scale = 1.0;
    if (path->rational)
        scale = 1.0 / value(row_of(path, piece, path->dim), path->powers, w);
    for (int64_t j = 0; j < path->dim; j++)
        out[j] = scale * value(row_of(path, piece, j), path->powers, w);
    return piece;
}

/* Value and first two derivatives with respect to u. */
typedef struct {
    double c0, c1, c2;
} Derivatives;

static inline Derivatives polynomial(const double *row, int64_t powers, double w, double scale)
{
    double b0 = row[powers - 1], b1 = 0.0, b2 = 0.0;
    for (int64_t k = powers - 2; k >= 0; k--) {
        b2 = b2 * w + b1;
        b1 = b1 * w + b0;
        b0 = b0 * w + row[k];
    }
    return (Derivatives){b0, b1 * scale, 2.0 * b2 * scale * scale};
}

/* Write C' and C'' at u, first and second (dim); returns the piece. */
static inline int64_t derivatives(const Path *path, double u, int64_t piece, double *first, double *second)
{
    piece = piece_of(path, u, piece);
    const double scale = 1.0 / (path->breaks[piece + 1] - path->breaks[piece]);
    const double w = (u - path->breaks[piece]) * scale;
    Derivatives d = {1.0, 0.0, 0.0};
    if (path->rational)
        d = polynomial(row_of(path, piece, path->dim), path->powers, w, scale);
    for (int64_t j = 0; j < path->dim; j++) {
        Derivatives c = polynomial(row_of(path, piece, j), path->powers, w, scale);
        if (path->rational) {
            c.c0 = c.c0 / d.c0;
            c.c1 = (c.c1 - d.c1 * c.c0) / d.c0;
            c.c2 = (c.c2 - 2.0 * d.c1 * c.c1 - d.c2 * c.c0) / d.c0;
        }
        first[j] = c.c1;
        second[j] = c.c2;
    }
    return piece;
}

/* Add to the butterfly's C'' what three wrong terms of the published program make of it.
   x'': d(sin^2) without its cosine, and a sine in place of a cosine; y'': a factor sin t left out. */
static inline void add_wrong_bend(double u, double scale, double *second)
{
    const double t = 2.0 * PI * u, s = sin(t), c = cos(t), e = exp(c);
    const double k = scale * square(2.0 * PI);
    second[0] += k * ((2.0 * s * c - 2.0 * s) * e + 32.0 * s * (sin(4.0 * t) - cos(4.0 * t)));
    second[1] += k * ((s + s * c) * e + (c * c - s * s - s * s * c) * e);
}

static inline double dot(const double *a, const double *b, int64_t dim)
{
    double total = 0.0;
    for (int64_t j = 0; j < dim; j++)
        total += a[j] * b[j];
    return total;
}

/* |C'|, C'.C'', limits 2 and 4, and the curvature. */
typedef struct {
    double speed, along, axis, normal, curvature;
} FeedLimits;

static inline FeedLimits feed_limits(const double *first, const double *second, int64_t dim, const double *velocity,
                                     const double *acceleration, double safety)
{
    const double speed2 = dot(first, first, dim), speed = sqrt(speed2), along = dot(first, second, dim);
    double axis = INFINITY, normal = INFINITY, curvature2 = 0.0;
    for (int64_t j = 0; j < dim; j++) {
        const double k = (second[j] - first[j] * (along / speed2)) / speed2; /* component of d2C/ds2 */
        curvature2 += k * k;
        axis = smaller(axis, velocity[j] * speed / fabs(first[j]));
        normal = smaller(normal, sqrt(safety * acceleration[j] / fabs(k)));
    }
    return (FeedLimits){speed, along, axis, normal, sqrt(curvature2)};
}

/* (2/T) sqrt(2 rho e - e^2): limit 3, the feed whose chord leaves a circle of radius rho by e. */
static inline double chord_limit(double curvature, double error, double period)
{
    if (error == INFINITY)
        return INFINITY;
    if (curvature * error >= 1.0)
        error = 1.0 / curvature;
    return 2.0 / period * sqrt(2.0 * error / curvature - error * error);
}

/* (1 + exp(-5z))^-8, given -5z; which is clamped, as exp would overflow far outside either ramp. */
static inline double sigmoid(double exponent)
{
    return 1.0 / square(square(square(1.0 + exp(smaller(exponent, 80.0)))));
}

/* Rising and falling factor. */
static inline double s_curve(double u, const double *settings)
{
    const double z = 3.0 * (u - settings[FALL]) / (1.0 - settings[FALL]);
    return sigmoid(-15.0 * u / settings[RISE]) * (1.0 - sigmoid(-5.0 * z));
}

typedef struct {
    double lowest, highest;
} Range;

/* Tangential accelerations A with |t_j A + k_j V^2| <= A_j on every axis. */
static inline Range acceleration_range(const double *first, const double *second, int64_t dim, double speed, double along,
                                       double feed, const double *acceleration)
{
    Range range = {-INFINITY, INFINITY};
    for (int64_t j = 0; j < dim; j++) {
        const double t = first[j] / speed;
        if (fabs(t) > NEGLIGIBLE) {
            const double k = (second[j] - first[j] * (along / (speed * speed))) / (speed * speed);
            const double centre = -k * feed * feed / t, half = acceleration[j] / fabs(t);
            range.lowest = larger(range.lowest, centre - half);
            range.highest = smaller(range.highest, centre + half);
        }
    }
    return range;
}

#endif

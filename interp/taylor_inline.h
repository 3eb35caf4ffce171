/* The Taylor step of the literature: derivatives of a curve piece, the speed of the tool tip, and the series. */
#ifndef FEEDPLAN_TAYLOR_INLINE_H
#define FEEDPLAN_TAYLOR_INLINE_H

#include "interp/step_inline.h"
#include "planner/geometry/differential_inline.h"

/* Numbers in a row of the feed. */
enum { FEED_WIDTH = 5 };

/* Value of a coordinate and its first three derivatives with respect to u. */
typedef struct {
    double c0, c1, c2, c3;
} Derivatives;

/* Rows of the tool tip within a piece, from first to last, and that of its denominator behind them, if there is one. */
typedef struct {
    int64_t first, last, rational;
} Tip;

static inline Tip tip_of(Shape shape)
{
    const int64_t rational = shape.rows > shape.dim + 1;
    const int64_t first = shape.rows > shape.dim + 2 ? shape.dim + 2 : 1;
    return (Tip){first, rational ? shape.rows - 1 : shape.rows, rational};
}

/* Local parameter of u. */
static inline double local(const double *piece, double u)
{
    return (u - piece[0]) / piece[1];
}

/* Value and first order derivatives of a polynomial with respect to u, dw/du = scale; the others stay 0. */
static inline Derivatives polynomial(const double *row, int64_t powers, double w, double scale, int64_t order)
{
    double b0 = row[0], b1 = 0.0, b2 = 0.0, b3 = 0.0;
    for (int64_t n = 1; n < powers; n++) {
        if (order > 2)
            b3 = b3 * w + b2;
        if (order > 1)
            b2 = b2 * w + b1;
        b1 = b1 * w + b0;
        b0 = b0 * w + row[n];
    }
    return (Derivatives){b0, b1 * scale, 2.0 * b2 * scale * scale, 6.0 * b3 * scale * scale * scale};
}

/* The quotient of two polynomials by the quotient rule, one derivative from those before it. */
static inline Derivatives quotient(Derivatives c, Derivatives d)
{
    c.c0 = c.c0 / d.c0;
    c.c1 = (c.c1 - d.c1 * c.c0) / d.c0;
    c.c2 = (c.c2 - 2.0 * d.c1 * c.c1 - d.c2 * c.c0) / d.c0;
    c.c3 = (c.c3 - 3.0 * d.c1 * c.c2 - 3.0 * d.c2 * c.c1 - d.c3 * c.c0) / d.c0;
    return c;
}

/* |C'| of the tool tip and, as far as the order needs them, its first and second derivative with respect to u. */
static inline Triple tip_speed(const double *piece, Shape shape, double u, int64_t order)
{
    const Tip tip = tip_of(shape);
    const double scale = 1.0 / piece[1], w = (u - piece[0]) * scale;
    Derivatives d = {1.0, 0.0, 0.0, 0.0};
    if (tip.rational)
        d = polynomial(piece + tip.last * shape.powers, shape.powers, w, scale, order);
    double squared = 0.0, along = 0.0, bend = 0.0;
    for (int64_t j = tip.first; j < tip.last; j++) {
        Derivatives c = polynomial(piece + j * shape.powers, shape.powers, w, scale, order);
        if (tip.rational)
            c = quotient(c, d);
        squared += c.c1 * c.c1;
        along += c.c1 * c.c2;
        bend += c.c2 * c.c2 + c.c1 * c.c3;
    }
    return speed_derivatives(squared, along, bend);
}

/* T u' + T^2/2 u'' + T^3/6 u''' as far as the order goes, from feed, acceleration and jerk; see taylor_step. */
static inline double taylor_series(int64_t order, double period, Triple speeds, double v, double a, double j)
{
    const Triple rates = rates_of_parameter(speeds, v, a, j);
    double step = period * rates.first;
    if (order > 1)
        step += 0.5 * period * period * rates.second;
    if (order > 2)
        step += period * period * period / 6.0 * rates.third;
    return step;
}

/* The feed of a plan t seconds after its row began, its first derivative, and its second. */
static inline double feed_at(const double *c, double t)
{
    return c[1] + t * (c[2] + t * (c[3] + t * c[4]));
}

static inline double acceleration_at(const double *c, double t)
{
    return c[2] + t * (2.0 * c[3] + t * 3.0 * c[4]);
}

static inline double jerk_at(const double *c, double t)
{
    return 2.0 * c[3] + t * 6.0 * c[4];
}

#endif

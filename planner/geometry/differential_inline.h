/* The formulas of differential.py and chord.py at one point, for compiled code. */
#ifndef PLANNER_GEOMETRY_DIFFERENTIAL_INLINE_H
#define PLANNER_GEOMETRY_DIFFERENTIAL_INLINE_H

#include "planner/core.h"

typedef struct {
    double first, second, third;
} Triple;

/* First three derivatives of q(u(t)) with respect to t. */
static inline Triple chain_rule(double q1, double q2, double q3, double u1, double u2, double u3)
{
    const Triple rates = {q1 * u1, q2 * (u1 * u1) + q1 * u2, q3 * (u1 * u1 * u1) + q2 * (3.0 * u1 * u2) + q1 * u3};
    return rates;
}

/* |C'| > 0 and its first two derivatives with respect to u, from |C'|^2, C'.C'' and |C''|^2 + C'.C'''. */
static inline Triple speed_derivatives(double squared, double along, double bend)
{
    const double speed = sqrt(squared), slope = along / speed;
    const Triple speeds = {speed, slope, (bend - slope * slope) / speed};
    return speeds;
}

/* First three time derivatives of an arc length, given |C'| and its first two derivatives, from those of u. */
static inline Triple rates_along(Triple speeds, double u1, double u2, double u3)
{
    const double s1 = speeds.first, s2 = speeds.second, s3 = speeds.third;
    const Triple rates = {s1 * u1, s1 * u2 + s2 * (u1 * u1), s1 * u3 + s2 * (3.0 * u1 * u2) + s3 * (u1 * u1 * u1)};
    return rates;
}

/* First three time derivatives of u from those of the arc length, given |C'| and its first two derivatives. */
static inline Triple rates_of_parameter(Triple speeds, double v, double a, double j)
{
    const double speed = speeds.first, slope = speeds.second, bend = speeds.third;
    const double u1 = v / speed, u2 = (a - slope * u1 * u1) / speed;
    const Triple rates = {u1, u2, (j - 3.0 * slope * u1 * u2 - bend * u1 * u1 * u1) / speed};
    return rates;
}

/* Half the length of the chord that leaves a circle by an error, as in chord.py. */
static inline double half_chord(double radius, double error)
{
    const double sagitta = smaller(error, radius);
    return sqrt(sagitta * (2.0 * radius - sagitta));
}

#endif

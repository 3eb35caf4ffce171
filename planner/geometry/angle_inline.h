/* Angles of many points at once, the same bits on every processor.
 *
 * The angle of (x, y) within the first octants is atan t, t = |y| / |x|; it is that of a place nearby, atan 0, 1/2, 1, 3/2 or
 * infinity, and the arctangent of a quotient z of less than 7/16, by a minimax polynomial (coefficients: Ng, fdlibm 1993).  Right to
 * two units in the last place. */
#ifndef PLANNER_GEOMETRY_ANGLE_INLINE_H
#define PLANNER_GEOMETRY_ANGLE_INLINE_H

#include "planner/core.h"

/* Write the angles of (x, y), n points each, in -pi .. pi. */
static inline __attribute__((always_inline)) void angles(int64_t n, const double *y, const double *x, double *restrict out)
{
    const double pi = 3.141592653589793116, pi_rest = 1.2246467991473531772e-16;
    int64_t ordinary = 0;
    for (int64_t i = 0; i < n; i++) {
        const double most = larger(fabs(x[i]), fabs(y[i]));
        ordinary += (1e-280 < most) & (most < 1e280) & (fabs(x[i]) < 1e280) & (fabs(y[i]) < 1e280);
    }
    if (ordinary < n) { /* zeros, what is no number, and what overflows in the quotient */
        for (int64_t i = 0; i < n; i++)
            out[i] = atan2(y[i], x[i]);
        return;
    }
    for (int64_t i = 0; i < n; i++) {
        const double a = fabs(y[i]), b = fabs(x[i]);
        const int half = a >= 0.4375 * b, one = a >= 0.6875 * b, more = a >= 1.1875 * b, beyond = a >= 2.4375 * b;
        /* tan(angle - place) = (a - t b) / (b + t a) with t the tangent of the place */
        const double t = more ? 1.5 : one ? 1.0 : half ? 0.5 : 0.0;
        const double upper = beyond ? -b : a - t * b, lower = beyond ? a : b + t * a;
        const double place = beyond ? 1.57079632679489655800e+00
                                    : more ? 9.82793723247329054082e-01
                                           : one ? 7.85398163397448278999e-01 : half ? 4.63647609000806093515e-01 : 0.0;
        const double rest = beyond ? 6.12323399573676603587e-17
                                   : more ? 1.39033110312309984516e-17
                                          : one ? 3.06161699786838301793e-17 : half ? 2.26987774529616870924e-17 : 0.0;
        const double z = upper / lower, z2 = z * z, z4 = z2 * z2;
        const double odd = z2 * (3.33333333333329318027e-01 + z4 * (1.42857142725034663711e-01 + z4 *
                           (9.09088713343650656196e-02 + z4 * (6.66107313738753120669e-02 + z4 *
                           (4.97687799461593236017e-02 + z4 * 1.62858201153657823623e-02)))));
        const double even = z4 * (-1.99999999998764832476e-01 + z4 * (-1.11111104054623557880e-01 + z4 *
                            (-7.69187620504482999495e-02 + z4 * (-5.83357013379057348645e-02 + z4 *
                            -3.65315727442169155270e-02))));
        const double angle = place - ((z * (odd + even) - rest) - z);
        const double turned = x[i] < 0.0 ? pi - (angle - pi_rest) : angle;
        out[i] = copysign(turned, y[i]);
    }
}

#endif

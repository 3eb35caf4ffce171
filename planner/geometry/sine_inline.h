/* Sines and cosines of many numbers at once, the same bits on every processor; the C library's differ from one to the next.
 *
 * x = q pi/2 + y with |y| <= pi/4, by pi/2 in three parts of which the first two have few digits, so that q times them is exact
 * (Cody and Waite 1980); then minimax polynomials of sine and cosine on that range (coefficients: Ng, fdlibm 1993), of which q
 * says which is which.  Right to one unit in the last place. */
#ifndef PLANNER_GEOMETRY_SINE_INLINE_H
#define PLANNER_GEOMETRY_SINE_INLINE_H

#include <string.h>

#include "planner/core.h"

/* Beyond it q has too many digits for its product with a part of pi/2 to be exact. */
#define SINE_LIMIT 4e5

/* Write the sine and the cosine of x (n). */
static inline __attribute__((always_inline)) void sine_cosine(int64_t n, const double *x, double *restrict sine,
                                                              double *restrict cosine)
{
    const double round = 6755399441055744.0; /* 1.5 2^52: added, it leaves no digits behind the point */
    const double two_over_pi = 6.36619772367581382433e-01;
    const double part1 = 1.57079632673412561417e+00, part2 = 6.07710050630396597660e-11;
    const double part3 = 2.02226624879595063154e-21;
    double largest = 0.0;
    for (int64_t i = 0; i < n; i++)
        largest = fabs(x[i]) <= SINE_LIMIT ? largest : 1.0;
    if (largest > 0.0) {
        for (int64_t i = 0; i < n; i++) {
            sine[i] = sin(x[i]);
            cosine[i] = cos(x[i]);
        }
        return;
    }
    for (int64_t i = 0; i < n; i++) {
        const double sum = x[i] * two_over_pi + round, q = sum - round;
        int64_t bits;
        memcpy(&bits, &sum, sizeof bits); /* its last two are those of q */
        const double first = x[i] - q * part1, away = q * part2, second = first - away;
        const double lost = q * part3 - ((first - second) - away);
        const double y = second - lost, tail = (second - y) - lost;
        const double z = y * y;
        const double s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 +
                         z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10));
        const double t = 8.33333333332248946124e-03 + z * s, cube = z * y;
        const double sine_y = y - ((z * (0.5 * tail - cube * t) - tail) - cube * -1.66666666666666324348e-01);
        const double c = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 +
                         z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
        const double r = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c));
        const double half = 0.5 * z, w = 1.0 - half;
        const double cosine_y = w + (((1.0 - w) - half) + (z * r - y * tail));
        const double odd = bits & 1 ? cosine_y : sine_y, even = bits & 1 ? sine_y : cosine_y;
        sine[i] = bits & 2 ? -odd : odd;
        cosine[i] = (bits + 1) & 2 ? -even : even;
    }
}

#endif

/* Solvers of the time-optimal plan, compiled. */
#ifndef PLANNER_PLAN_SOLVERS_SOLVERS_H
#define PLANNER_PLAN_SOLVERS_SOLVERS_H

#include <stdint.h>

/* Passes of the plan without a jerk limit, see accelerations.py.  Each of n intervals has points from its left to its
 * right end, both included: rows (count, 2, n, points) hold the coefficients of x and of its half slope, bounds
 * (count, 2) the sizes of the upper and the lower bound of each row, cap and offset (n, points) the largest x and the
 * way from the left end.  With the length h and the lean d (n) of an interval its points at w have
 *
 *     x = x_k + 2 w a + 2 d w (1 - w/h),     a + d (1 - 2 w/h)
 *
 * as x and its half slope, a being the mean of the latter. */

/* Write the least and the largest x from which an x within slowest and fastest can end the section into reach (2, n +
 * 1); nan where there is none.  Where a lean would forbid rest it is set to 0. */
void accelerations_controllable(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                                const double *cap, const double *offset, double *lean, double slowest, double fastest,
                                double *reach);

/* Write the largest x (n + 1) that can be reached from x = start within the controllable reach. */
void accelerations_fastest(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                           const double *cap, const double *offset, const double *lean, const double *reach,
                           double start, double *x);

/* Write the lean (n) of each interval that follows the row nearest to its bound there, given a law x (n + 1) and its
 * lean; 0 where none is near. */
void accelerations_follow_rows(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                               const double *offset, const double *x, const double *lean, double *out);

#endif

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

/* ---- interior.c: the interior-point method; interior.py explains it --------------------------------------------------

   A problem is given by
       h (intervals,), inner, cap (p,), weight (p,)    points p = (inner + 1) intervals + 1, inner 1 or 3
       acceleration (accelerations, 2, p), jerk (rows - accelerations, 3, p)    coefficients of the rows
       steady, jerky (p,)                              by what they are tightened, NULL where they are not
       bounds (rows, 2)                                sizes of the upper and lower bounds, finite
   The iterate is
       z (3, intervals + 1)                            x, a, c at the knots
       pairs (blocks, 2 rows + 1, 2, 128)              slacks and multipliers of all sides: blocks of 128 points, the last filled up;
                                                       24 bits of each will do, a slack never more than the true one
       totals (4,)                                     sum(s l), time, largest relative violation, 1 where work is up to date */

/* Begin: scale z until it uses a share ``inside`` of the limits (0: leave it), make slacks of at least ``least``, and
   multipliers: ``duals`` (blocks, 2 rows + 1, 128), or where these are NULL so that sum(s l) is ``centring`` times the time. */
void interior_begin(const double *h, int64_t intervals, int64_t inner, const double *cap, const double *weight,
                    int64_t accelerations, const double *acceleration, const double *steady, int64_t rows,
                    const double *jerk, const double *jerky, const double *bounds, double inside, double least,
                    double centring, const float *duals, double *z, float *pairs, double *totals);

/* Doubles of the array ``work``. */
int64_t interior_work(int64_t intervals, int64_t priced);

/* Iterate until sum(s l) is below ``tolerance`` of the time and the largest violation below ``feasible``, ``most`` times at most;
   their number is added to ``count``.  ``fixed``: how many of x, a, c are prescribed at the first knot; ``priced``: equations at the last, 1
   (x is as it is in z) or 3 (the state is that of the first), or none.  ``hope``: weight of the hoped-for gain in the centring.
   Returns 0: most reached, 1: done, 2: the Newton system is singular, 3: no step is possible. */
int64_t interior_run(const double *h, int64_t intervals, int64_t inner, const double *cap, const double *weight,
                     int64_t accelerations, const double *acceleration, const double *steady, int64_t rows,
                     const double *jerk, const double *jerky, const double *bounds, int64_t fixed, int64_t priced,
                     double hope, double tolerance, double feasible, int64_t most, double *z, float *pairs, double *work,
                     double *totals, int64_t *count);

#endif

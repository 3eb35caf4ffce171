/* Path and feed as one problem, compiled.  solve.py has the problem, the equations and the rules.
 *
 * Every function takes the same description of a problem.  sizes (3): axes d, stages n, legs.  Of each stage: switches (n), 1 where
 * it is the switch to a new phase, 0 for a segment; share (n) of the phase's time that a segment has, scale (n) of the phase's
 * duration, leg (n) that the segment runs along.  legs: vectors (legs, 4, d), rates (legs, 2) and lengths (legs), as in
 * geometry/blend.py.  near (n, 2): 1 / distance^2 that is allowed at the start of each segment, and within it; pace (n, 2):
 * 1 / speed^2, 0 for none.  walls (legs, d + 2), NULL where both sides of the legs are allowed: the unit normal of each leg, a line, that
 * points to its allowed side, 0 for none, and whether the motion along it keeps to the allowed sides of the legs before and after too.  axes (3, d): 1 / limit of velocity (0: none), acceleration (0: none) and jerk; least: the
 * cube of the least duration of a phase.  All in one system of units in which
 * the jerk limits are near 1.
 *
 * x (n + 1, 3d + 1): position p, V = v T, A = a T^2 and c = T^3 before each stage and after the last; u (n, d): j T^3 of a segment,
 * the next c of a switch (the rest is not used). */
#ifndef PLANNER_JOINT_JOINT_H
#define PLANNER_JOINT_JOINT_H

#include <stdint.h>

/* Numbers (doubles) of work that joint_solve wants. */
int64_t joint_work(const int64_t *sizes);

/* Iterate from x and u on, at most so many times, until the time is within a share gap of the least one; target (3d) is the last
 * state but c.  start: product of a slack and its multiplier; open: largest defect on the way.  Returns 0 where it has converged, 1
 * where iterations ran out, 2 where the system became singular.  found (6): time, largest defect, sum of products, largest
 * violation, distance of the last state from the target, iterations. */
int64_t joint_solve(const int64_t *sizes, const uint8_t *switches, const double *share, const double *scale,
                    const int64_t *leg, const double *vectors, const double *rates, const double *lengths,
                    const double *near, const double *pace, const double *walls, const double *axes, double least,
                    const double *target, double gap, double start, double open, int64_t most, double *x, double *u,
                    double *work, double *found);

/* One Newton step dx, du, from slacks and multipliers as at the start; aim (3): product of slacks and multipliers, weight of the
 * distance from the target, hold of the durations; prices (n + 1, 3d + 1) of the dynamics and price (3d) of the target.  Returns 0
 * where the system is not positive definite.  For its test. */
int64_t joint_newton(const int64_t *sizes, const uint8_t *switches, const double *share, const double *scale,
                     const int64_t *leg, const double *vectors, const double *rates, const double *lengths,
                     const double *near, const double *pace, const double *walls, const double *axes, double least,
                     const double *target, double start, const double *aim, double *x, double *u, double *work,
                     const double *prices, const double *price, double *dx, double *du);

/* Of every stage, at parts - 1 places within it: the largest distance from its leg and the largest speed into found (n, 2); 0 of a
 * switch. */
void joint_between(const int64_t *sizes, const uint8_t *switches, const double *share, const int64_t *leg,
                   const double *vectors, const double *rates, const double *lengths, const double *x, const double *u,
                   int64_t parts, double *found);

#endif

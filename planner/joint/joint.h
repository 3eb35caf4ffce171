/* Path and feed as one problem, compiled.  solve.py has the problem, the equations and the rules.
 *
 * Every function takes the same description of a problem.  sizes (4): axes d, segments n, legs, and whether anything but lines is
 * among the legs.  Of each segment: begins (n), 1 where a phase begins; share (n) of the phase's time; leg (n) that it runs along.
 * legs: vectors (legs, 4, d), rates (legs, 2) and lengths (legs), as in geometry/blend.py.  near (n, 3): 1 / distance^2 that is
 * allowed at the start of each segment, and at 1/3 and 2/3 of it; pace (n, 3): 1 / speed^2, 0 for none.  axes (3, d): 1 / limit of
 * velocity (0: none), acceleration (0: none) and jerk; scalars (2): 1 / acceleration^2 of all axes together (0: none), and the
 * least time of a phase.  All in one system of units in which the jerk limits are near 1.
 *
 * x (n + 1, 3d + 1): position, velocity, acceleration at the nodes, and the duration of the phase before each; u (n, d + 1): jerk,
 * and the duration of the phase that begins. */
#ifndef PLANNER_JOINT_JOINT_H
#define PLANNER_JOINT_JOINT_H

#include <stdint.h>

/* Numbers (doubles) of work that joint_solve wants. */
int64_t joint_work(const int64_t *sizes);

/* Iterate from x and u on, at most so many times, until the time is within a share gap of the least one; target (3d) is the last
 * state.  start: product of a slack and its multiplier.  Returns 0 where it has converged, 1 where iterations ran out, 2 where the
 * system became singular, 3 where steps became too short.  found (6): time, largest defect, sum of products, largest violation,
 * distance of the last state from the target, iterations. */
int64_t joint_solve(const int64_t *sizes, const uint8_t *begins, const double *share, const int64_t *leg,
                    const double *vectors, const double *rates, const double *lengths, const double *near,
                    const double *pace, const double *axes, const double *scalars, const double *target, double gap,
                    double start, int64_t most, double *x, double *u, double *work, double *found);

#endif

/* What the whole planner stands on, compiled: plans as functions of time. */
#ifndef PLANNER_PLANNER_H
#define PLANNER_PLANNER_H

#include <stdint.h>

/* Write the third time derivative of u at the n nodes of a law into jerk (n): that of the interval after a node; before a break,
 * and at the end, of the one before it.  u and its first two time derivatives at the nodes; durations and their powers 3, 4 and 5
 * (3, n - 1) from node to node, 1 in place of 0. */
void profile_jerk(int64_t n, const double *u, const double *rate, const double *acceleration, const uint8_t *forward,
                  const double *duration, const double *powers, double *jerk);

/* Time derivatives of the tip's arc length at n points into along (3, n), and which limit holds them back into binding (n).
 *
 * q (4, n, dim) and tip (4, n, tip_dim): derivatives of axes and tip over u; rates (3, n) of u, and the cube (n) of the first;
 * slowed (n) and its cube: by which factor each point was slowed down, or NULL; feed (n): commanded; chord_error may be inf.
 * bounds (rows, 5): weights of velocity, acceleration and jerk, lower and upper bound of each limit row; kinds (rows, 2): its
 * motion, and the number by which binding names it, increasing.  feed_name, chord_name: those of the feed and the chord error,
 * below all of these; 0 is named where no share reaches the least. */
void profile_binding(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip, const double *rates,
                     const double *cube, const double *slowed, const double *slowed_cube, const double *feed,
                     double chord_error, double period, int64_t rows, const double *bounds, const int64_t *kinds,
                     int64_t feed_name, int64_t chord_name, double least, double *along, uint8_t *binding);

#endif

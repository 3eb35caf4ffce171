/* Planning, compiled. */
#ifndef PLANNER_PLAN_PLAN_H
#define PLANNER_PLAN_PLAN_H

#include <stdint.h>

/* Write the largest share of speed, acceleration and jerk limits used in the n intervals index (n) into those columns of out
 * (4, intervals); the fourth row is the largest rate at which u falls back, 1/s.  Returns 0 where memory runs out or there are
 * too many axes, else 1.
 *
 * Pieces of the machine axes as in geometry.h; those of the tool tip are the same arrays where every axis moves it.  u and its
 * first two time derivatives at the nodes (intervals + 1); of each interval its duration, how far u advances in it, powers 3, 4
 * and 5 (3, intervals) of the duration, what a digit of the law is worth in u, the end of its stretch between breaks, the feed
 * limit, and into how many equal parts, 2 to 80, it is cut to be looked at: into twice as many, at most 80, until the parabolas
 * between points tell whether a limit is kept.  bounds (rows, 5): weights of velocity, acceleration and jerk in each limit row,
 * and its lower and upper bound; kinds (rows, 2): its motion (the axes, last the arc length of the tip), and whether it is about
 * speeds (0), accelerations (1) or jerks (2). */
int64_t utilisation_shares(int64_t pieces, int64_t dim, int64_t terms, const double *breaks,
                           const double *coefficients, int64_t rational, const uint8_t *resting, const double *origin,
                           int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms, const double *tip_breaks,
                           const double *tip_coefficients, int64_t tip_rational, const uint8_t *tip_resting,
                           const double *tip_origin, int64_t n, const int64_t *index, int64_t intervals,
                           const double *u, const double *rate, const double *acceleration, const double *duration,
                           const double *advance, const double *powers, const double *digit, const double *stretch_end,
                           const double *feed, const int64_t *points, int64_t rows, const double *bounds,
                           const int64_t *kinds, double chord_error, double period, double *out);

/* The highest of the equidistant values (parts + 1) of a share, with the peaks of the parabolas through three of them, less what
 * is granted, into top (1); returns whether a peak between them may be higher and decide.  For its test. */
int64_t utilisation_peak(int64_t parts, const double *values, double granted, double *top);

/* The highest curvatures beside the samples, 16 a piece, of count pieces from the first on, at which it may reach 1 / radius: their
 * places and themselves into u_found and bend_found (each 32 count); returns how many.  Two for each such sample, one from the
 * least |C'| beside it.  The radius is the given one, or of_digit times the way that a digit of u is worth if that is larger.
 * weights (dim) of the axes; scratch (6, 16 count). */
int64_t stops_sharpest(int64_t pieces, int64_t dim, int64_t terms, const double *breaks, const double *coefficients,
                       int64_t rational, const uint8_t *resting, const double *origin, const double *weights,
                       int64_t first, int64_t count, double least_radius, double of_digit, double *scratch,
                       double *u_found, double *bend_found);

/* Say what keeps n nodes from being a time law: 0 nothing, 1 a number that is not finite, 2 t or u that falls back from a node to
 * the next, 3 u that does beyond rounding between two; at (1): the first such node. */
int64_t guard_first_defect(int64_t n, const double *t, const double *u, const double *rate, const double *acceleration,
                           int64_t *at);

/* What limits the speed at n points, where all is seen along the weighted arc length of the axes: into found (5, n) the feed that
 * every velocity, acceleration by the curvature, feed and chord error allows, and the cube of that by jerk alone; the tangential
 * acceleration and jerk that the axes allow; the curvature.  inf where nothing limits.
 *
 * q (4, n, dim) and tip (4, n, tip_dim): derivatives of axes and tip over the parameter; weights (dim) of the axes; speed (n) of
 * the weighted arc length over it, and its cube (n); along (n): speed of the tip over that.  velocity, acceleration, jerk (dim)
 * are limits times weights; feed (n) is commanded; chord_error may be inf. */
void guess_ceiling(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip, const double *weights,
                   const double *speed, const double *cube, const double *along, const double *velocity,
                   const double *acceleration, const double *jerk, const double *feed, double chord_error,
                   double period, double tangential_acceleration, double tangential_jerk, double *found);

/* Lower each of n values to at most either neighbour's plus the step (n - 1) between them; one by one, for sums over all steps
 * would swamp the small ones. */
void guess_limit_growth(int64_t n, double *values, const double *steps);

/* The nodes of a time law at the knots (n) of a grid with x, a, c there, and between: counts to each interval that is not empty.
 * macro (n) of each knot; edges, u (macros + 1), piece (macros), powers (6, macros) of the map, and whether it ends at a stop (rests); at_breaks
 * (macros): which of them end at breaks; from_start and to_end (6): powers of the way from the stops at its ends, or NULL; digits:
 * what is not more is rounding.  Writes at every node (count) x, a, c into states (3, count); u, the derivatives of the
 * piece's own parameter v, and v into path (5, count), u not a number where it follows from v; by how much rounding moved u; width and time from it on; its macro; and
 * kind: 1 where u is exact, 2 at ends of macros that are no breaks. */
void speed_law_nodes(int64_t n, const double *sigma, const double *x, const double *a, const double *c,
                     const int64_t *macro, const int64_t *counts, int64_t macros, const double *edges, const double *u,
                     const int64_t *piece, const double *powers, int64_t rests, const uint8_t *at_breaks,
                     const double *from_start, const double *to_end, double digits, int64_t count, double *states,
                     double *path, double *moved, double *width, double *time, uint8_t *kind, int64_t *of_macro);

/* Rates and accelerations of u at n nodes from x, a, c and u (path: u and its derivatives, (4, n) or more); where rounding
 * moved u, the node is the moment at which the law has the rounded one, and the times change. */
void speed_law_rates(int64_t n, const double *states, const double *path, const double *moved, double *rate,
                     double *acceleration, double *time);

/* How far u goes from node to node (n - 1) over those widths: by Hermite's formula where the digits of u end. */
void speed_law_advance(int64_t n, const double *width, const double *path, const double *moved, double *advance);

/* Make u (n) and its steps (n - 1) agree to a digit of u; kind: 1 where u is exact.  work (4, n). */
void speed_law_in_step(int64_t n, const uint8_t *kind, const double *time, double *advance, double *u, double *work);

/* The kept nodes, those of another kind than 2: times, u, rates and accelerations into table (4, kept), steps of t and u into
 * steps (2, kept - 1). */
void speed_law_table(int64_t n, const uint8_t *kind, const double *time, const double *advance, const double *u,
                     const double *rate, const double *acceleration, int64_t kept, double *table, double *steps);

/* Into count (cells + 1) the accumulated number of intervals at a spacing in each cell, between edges fine (cells + 1): spacing
 * times a scale, most at most, and no more than growth times the distance beyond that of any other cell; so scaled, rounds times,
 * that intervals come out, but what most asks for comes on top.  grown (cells) is work. */
void time_knots_count(int64_t cells, const double *fine, const double *spacing, const double *most, double intervals,
                      double growth, int64_t rounds, double max_wider, double *grown, double *count);

/* The parameter at n places sigma of their macros, (n) each, on a map as above; into path (5, n) u, the first three derivatives of
 * the piece's own parameter v, and v; u is not a number where it follows from v.  left (n): where the path is to be taken from
 * the left. */
void time_map_along(int64_t n, const double *sigma, const int64_t *macro, int64_t macros, const double *edges,
                    const double *u, const int64_t *piece, const double *powers, int64_t rests, double *path,
                    uint8_t *left);

/* Limits at n points, those from first on of all: the largest x, which limit sets it (0 the feed, 1 the chord error, 2 and on the
 * velocities) and by how many percent it grows with one percent of that into cap, which and power (points), coefficients of rows
 * into acceleration (accelerations, 2, points) and jerk (rows - accelerations, 3, points), where they are times units (3).
 *
 * q (4, n, dim), tip (4, n, tip_dim): derivatives of axes and tip over a parameter, rates (3, n) its derivatives over sigma; feed
 * (n) is commanded, velocity (dim), chord_error and period are limits.  Rows: the motion of each (the axes, last the arc
 * length of the tip), its weight, and what it is divided by. */
void rows_fill(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip, const double *rates,
               const double *feed, const double *velocity, double chord_error, double period, int64_t accelerations,
               int64_t rows, const int64_t *motion, const double *weights, const double *scales, const double *units,
               int64_t first, int64_t points, double *cap, uint8_t *which, float *power, double *acceleration,
               double *jerk);

/* Add to by_speed the multipliers of the speed, times power (points), of each limit which (points); to by_row (rows) those of
 * every row, of the jerks times x^(-1/2).  The problem and its iterate as in solvers.h. */
void sensitivity_sums(int64_t intervals, const double *h, int64_t inner, const double *z, int64_t accelerations,
                      int64_t rows, const float *pairs, const uint8_t *which, const float *power, double *by_speed,
                      double *by_row);

/* Whether the multipliers of the jerk rows, times the sizes of their bounds (rows, 2), are nowhere more than weight (points), but
 * for a share ``room``; points that coincide count as one. */
int64_t sensitivity_proven(int64_t intervals, const double *h, int64_t inner, const double *weight,
                           int64_t accelerations, int64_t rows, const double *bounds, double room, const float *pairs);

#endif

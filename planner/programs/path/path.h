/* The smooth path of a part program, compiled. */
#ifndef PLANNER_PROGRAMS_PATH_PATH_H
#define PLANNER_PROGRAMS_PATH_PATH_H

#include <stdint.h>

/* Banded algebra of the tube.  Its rows (count, width) are sparse: row k acts on the width numbers of x from dim *
 * first[k] on, control point by control point.  The symmetric band (depth, n) that they fill is LAPACK's lower form:
 * band[i, j] is the entry (j + i, j); depth is at least width. */

/* Add the sum of weight[k] rows[k] rows[k]^T to the band. */
void tube_add_rows(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                   const double *weight, int64_t n, double *band);

/* Write rows[k] . x into out (count). */
void tube_apply_rows(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                     const double *x, double *out);

/* Add the sum of y[k] rows[k] to out. */
void tube_add_transposed(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                         const double *y, double *out);

/* Write the product of the symmetric band and x (n) into out (n). */
void tube_apply_band(int64_t depth, int64_t n, const double *band, const double *x, double *out);

/* Minimise 1/2 x . objective x over x (n), where every row keeps |rows[k] . x - offset[k]| <= 1 or pays for what is beyond,
 * from x, in place; of x the numbers frozen (frozen_count) stay as they are.  The objective is a band (width, n).
 * work holds as many numbers as tube_solve_work says.  Returns the number of iterations. */
int64_t tube_solve(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                   const double *offset, int64_t n, const double *objective, int64_t frozen_count, const int64_t *frozen,
                   double *x, double *work);

int64_t tube_solve_work(int64_t count, int64_t width, int64_t n);

/* Write the distance of each point (n, dim) to the blocks between abscissa - window and abscissa + window (n) into out
 * (n). Block i runs from edges[i] to edges[i + 1] along its leg: vectors (blocks, 4, dim), rates (blocks, 2), and where some are
 * stretches of curves ways (blocks, 3).  Curves: as for bezier_at. */
void deviation_to_blocks(int64_t blocks, int64_t dim, const double *edges, const double *vectors, const double *rates,
                         const double *ways, int64_t terms, const double *powers, const double *curve_length,
                         const int64_t *first_curve_panel, const double *curve_edges, const double *curve_panels,
                         int64_t n, const double *points, const double *abscissa, const double *window, double *out);

/* Write the places (n, dim) of a quartic spline at s (n): knots (spans + 1) and ascending powers (spans, dim, 5) of the share
 * of a span. */
void spline_places(int64_t spans, int64_t dim, const double *knots, const double *powers, int64_t n, const double *s,
                   double *out);

/* Write the distance of each of points (n, dim) to that spline near s (n), within [lo, hi] (n), into out (n). */
void spline_distances(int64_t spans, int64_t dim, const double *knots, const double *powers, int64_t n,
                      const double *points, const double *s, const double *lo, const double *hi, double *out);

/* Choose the vertices that stay: kept (blocks + 1) becomes 1 at these.
 *
 * points (blocks + 1, dim) are the vertices.  rows (blocks, 6) hold of every block its length, the distance of its
 * points from its chord, its feed, its tolerance, the distance it is off already, and the length below which its feed
 * may be that of its longest neighbour.  Only a loose (blocks + 1) vertex may go. */
void absorb_runs(int64_t blocks, int64_t dim, const double *points, const double *rows, const uint8_t *loose,
                 double share, uint8_t *kept);

#endif

/* Lower bounds on the time of a plan, compiled. */
#ifndef PLANNER_PLAN_DUAL_DUAL_H
#define PLANNER_PLAN_DUAL_DUAL_H

#include <stdint.h>

/* Loops of the primal-dual method in method.py, which explains them.
 *
 * A cell is an interval between neighbouring knots, empty ones included; cell k has the local unknowns theta[k * width]
 * to theta[k * width + local - 1], where width = jerks + accelerations: the l and the m of the control values k and
 * k + 1, and the l of k + 2, so local = 2 * width + jerks.  An empty cell is an atom (place[k] < 0); the others have 4
 * points each, whose numbers stand side by side in block place[k] of the arrays of points.
 *
 * Every function begins with the structure:
 *
 *     cells, jerks, accelerations, place (cells)
 *     weight, cap (blocks, 4)      of the quadrature, and of x
 *     quadratic (blocks, 3, 4)     values of the three quadratic B-splines, margins included
 *     linear (blocks, 2, 4)        values of the two linear ones
 *     rows (blocks, 4, local)      of g
 *     atom_rows (cells, local), atom_caps (cells)     of the empty cells: G, and largest x
 *
 * and goes on with what it needs of
 *
 *     state, step (blocks, 5 + 3 width, 4)     y, x, t, v, mu; e, lam1, lam2 of each l; u, nu1, nu2 of each m
 *     atom_state, atom_step (cells, 3)         x, lower and upper multiplier
 *     reduced (blocks, 5 + 2 jerks + accelerations, 4)     M_yy, M_yx, M_xx, two of the last right side; 1/k and d of
 *                                              each l; 1/k_u of each m
 *     control (4)                              target of the products, share of the last steps' products that is taken
 *                                              off it, lengths of the primal and of the dual step
 *     scratch (4, local)                       whatever was there is lost
 */

/* Eliminate everything but theta: writes reduced (but for the right side) and the band (unknowns, local) of S, whose
 * row i holds S[i, i] to S[i, i + local - 1]. */
void method_assemble(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place, const double *weight,
                     const double *cap, const double *quadratic, const double *linear, const double *rows,
                     const double *atom_rows, const double *atom_caps, const double *state, const double *atom_state,
                     int64_t unknowns, double *reduced, double *band, double *scratch);

/* Cholesky factor of the band (count, local) in place, the unknowns fixed (held, increasing) kept at 0; the diagonal
 * becomes its inverse.  Returns the smallest pivot; where one is not positive, -1 at once. */
double method_factor(int64_t count, int64_t local, int64_t held, const int64_t *fixed, double *band);

/* Solve with the factor, b (count) in place; 0 at the fixed unknowns. */
void method_solve(int64_t count, int64_t local, int64_t held, const int64_t *fixed, const double *band, double *b);

/* Write the sum of omega D^T (z + dz0) over points and atoms into out (unknowns), dz0 the steps at theta = 0; and two
 * columns of reduced. */
void method_right_side(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place, const double *weight,
                       const double *cap, const double *quadratic, const double *linear, const double *rows,
                       const double *atom_rows, const double *atom_caps, const double *state,
                       const double *atom_state, const double *step, const double *atom_step, const double *control,
                       int64_t unknowns, double *reduced, double *out, double *scratch);

/* Replace the steps by those that belong to the new theta (unknowns).  Writes what the driver needs to know, out (7):
 * largest relative fall of a slack, of a multiplier, of x; sums over omega of s dl, ds l, ds dl, and of dy. */
void method_steps(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place, const double *weight,
                  const double *cap, const double *quadratic, const double *linear, const double *rows,
                  const double *atom_rows, const double *atom_caps, const double *state, const double *atom_state,
                  const double *theta, const double *control, const double *reduced, double *step, double *atom_step,
                  double *out);

/* Take the step.  Writes the gap sum(omega s l) and the time sum(omega y) into out (2). */
void method_take_step(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place, const double *weight,
                      const double *cap, const double *quadratic, const double *linear, const double *rows,
                      const double *atom_rows, const double *atom_caps, const double *control, const double *step,
                      const double *atom_step, double *state, double *atom_state, double *out);

/* The path of a section as a bound sees it, track_inline.h; terms.py explains it.  Every function begins with a track:
 *
 *     cells, motions                       K motions: the axes, and last the way of the tool tip
 *     sigma (cells + 1), u (3, cells + 1)  knots; the curve parameter and two derivatives over sigma there
 *     pieces ... origin                    the curve as curve_evaluate takes it; of K - 1 coordinates
 *     tip_pieces ... tip_origin            the same of the tool tip, of tip_dim coordinates; 0 pieces: the curve itself
 *     stretches, cap_edges, cap_feed       feeds that the curve commands, inf on rapids; stretches 0: none
 *     scalars (4)                          feed, rapid, chord error, period
 *     velocity (K - 1), acceleration, jerk (K), axis_weight (K - 1)    limits, and what makes the axes comparable
 *     start_speed, end_speed (K)           known speed of each motion at the ends; NULL: it is free
 *     way (2, K, cells + 1), rise (K, cells), ramps (2, K, cells), near (2, cells)    as in terms.py
 *
 * and goes on with points: n of them, at r (n) in the cells k (n).
 */

/* Write derivatives of the motions over sigma into first and second (K, n), the cap of x = sigma_dot^2 into cap (n). */
void track_points(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces, int64_t terms,
                  const double *breaks, const double *coefficients, int64_t rational, const uint8_t *resting,
                  const double *origin, int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms,
                  const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                  const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                  const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                  const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                  const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t n,
                  const int64_t *k, const double *r, double *first, double *second, double *cap);

/* Write the derivatives of the motions over u into first (K, n), the cap of u_dot^2 by all but the ways into cap (n);
 * what the motions reach from either end into reached (2, n), inf where its speed is free; NULL: not asked for. */
void track_reach(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces, int64_t terms,
                 const double *breaks, const double *coefficients, int64_t rational, const uint8_t *resting,
                 const double *origin, int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms,
                 const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                 const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                 const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                 const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                 const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t n,
                 const int64_t *k, const double *r, double *first, double *cap, double *reached);

/* Weight 1 - sum |l| of the pace, coefficient g of x, and its cap at points, (n) each.  Multipliers: those of the jerk of
 * the motions jerk_motions, of which most_jerk (jerks) is allowed, as Bernstein coefficients controls (3, jerks, cells) of
 * each l; those of the acceleration likewise, spline (accelerations, cells + 1) being the m at the knots. */
void value_integrand(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces,
                     int64_t terms, const double *breaks, const double *coefficients, int64_t rational,
                     const uint8_t *resting, const double *origin, int64_t tip_pieces, int64_t tip_dim,
                     int64_t tip_terms, const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                     const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                     const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                     const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                     const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t jerks,
                     const int64_t *jerk_motions, const double *most_jerk, const double *controls,
                     int64_t accelerations, const int64_t *acceleration_motions, const double *most_acceleration,
                     const double *spline, int64_t n, const int64_t *k, const double *r, double *weight, double *pull,
                     double *cap);

/* Smallest w x^(-1/2) + g x over 0 < x <= cap at n points, into out (n). */
void value_min_price(int64_t n, const double *w, const double *g, const double *cap, double *out);

#endif

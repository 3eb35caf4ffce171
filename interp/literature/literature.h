/* The interpolators of the literature.  Tables and state are those of interp/interp.h. */
#ifndef FEEDPLAN_LITERATURE_H
#define FEEDPLAN_LITERATURE_H

#include <stdint.h>

/* ---- feed shapes of 2002 (feedshapes.py) ---- */

/* Write feed (mm/s) and acceleration (mm/s^2) of a shape at every time: t, feed, acceleration (count).
   shape (6): which (0 trapezoid, 1 exponential, 2 bell), feed F, mm/s, time of a ramp, begin of the falling ramp, end, s,
   rate of an exponential ramp, 1/s. */
void feedshape_feed(const double *shape, int64_t count, const double *t, double *feed, double *acceleration);

/* Take count - 1 Taylor steps of order 1 or 2 from u[0] with the feed of a shape (2002, equations 8, 9).
   u (count); feed, acceleration (count) get V_k and A_k of every sample; positions (count, dim) the machine axes. */
void feedshape_run(int64_t order, const double *shape, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                   double period, double u_end, int64_t count, double *u, double *feed, double *acceleration,
                   double *positions);

/* ---- the other forms of a replay (forms.py) ---- */

/* Take up to count steps of a form; returns how many, less where the path ends before.  With V the plan's feed,
   f(t, u) = V(t) / |C'(u)| and T the period,

       0  Taylor with V(u)  the time at which the plan was at u_k gives V, A, J; then the Taylor step of taylor_step
       1  Runge-Kutta       p = u_k + T f(t_k, u_k),   u_{k+1} = u_k + T/2 (f(t_k, u_k) + f(t_{k+1}, p))
       2  chord             with L = T/6 (V(t_k) + 4 V(t_k + T/2) + V(t_{k+1})), p = u_k + L / |C'(u_k)|, then order times
                            p := u_k + (p - u_k) L / |C(p) - C(u_k)|

   The forms with V(t) are at the end of the path at the plan's last sample, whatever they have accumulated; those with V(u)
   when they get there.  At an end at rest the second-order step shrinks to nothing one period before it: a step that crawls
   there is taken to the end.  course (n + 1, 7), read with V(u) alone, holds the plan's u(t): start times and quintics of u,
   closed by a row that starts at inf; duration is the plan's, s.  u (count), positions (count, dim). */
int64_t form_run(int64_t form, int64_t order, const double *feed, const double *course, const double *pieces,
                 double duration, double *state, int64_t count, double *u, double *positions);

/* ---- adaptive feed with look-ahead, 2007 (lookahead.py) ---- */

/* Place one point a period at the adaptive feed (2007, equations 5 to 7), from u[0] to the end of the path.
   limits (4): command feed, normal acceleration, chord error, period.  Writes u_i, V_i and the chords s_i between them;
   returns the number of points, or -1 where there is no room for them, or -2 - i where point i does not move. */
int64_t lookahead_points(const double *limits, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                         double u_end, int64_t count, double *u, double *feed, double *lengths);

/* Lower the squared feeds, squares (count + 1), until every segment can be crossed within the acceleration (2007, equations
   8 and 9): lengths (count), twice = 2 a_max.  Returns the farthest that braking reached back, mm. */
double lookahead_brake(double twice, int64_t count, const double *lengths, double *squares);

/* Interpolate at the feeds after look-ahead by Taylor steps of order 1 or 2 with the feed V_k, one a period.

       0  averaged  V_k is the mean of V_{k-1} and of the feed at the next point (figure 3 of 2007), at least least
       1  uniform   V_k is what constant acceleration between the points makes of the period that follows

   points, squares (count), lengths (count - 1); writes u_k, V_k (room) and the positions (room, dim).  Returns the number
   of samples, or -1 where there is no room for them. */
int64_t lookahead_run(int64_t rule, int64_t order, int64_t count, const double *points, const double *squares,
                      const double *lengths, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                      double period, double least, int64_t room, double *u, double *feed, double *positions);

/* ---- Algorithms 1 to 4, 2022 (greedy.py) ----

   A path is breaks (pieces + 1), from 0 to 1, coefficients (pieces, dim + 1, powers), ascending, the last row of a piece its
   denominator, which is looked at where the path is rational.  velocity, acceleration (dim): limits of the axes, mm/s,
   mm/s^2.  settings, state, codes and columns: interp/literature/greedy_inline.h. */

/* Run the published program until u reaches 1, for up to room points; the path named error_ is the one its chord error is
   of.  u may pass 1 in the last step; feed takes the feedrate that drove each step, u and feed (room).  Returns a code; called
   again with the same state it goes on. */
int64_t greedy_compat_run(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                          int64_t rational, int64_t dim, const double *error_breaks, const double *error_coefficients,
                          int64_t error_pieces, int64_t error_powers, int64_t error_rational, int64_t error_dim,
                          const double *velocity, const double *acceleration, const double *settings, double *state,
                          int64_t room, double *u, double *feed);

/* Run the algorithms with the planned feedrate in the step for up to room points; the last is at 1.  As above. */
int64_t greedy_physical_run(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                            int64_t rational, int64_t dim, const double *velocity, const double *acceleration,
                            const double *settings, double *state, int64_t room, double *u, double *feed);

/* Write the chord error between u[k] and u[k + 1] to out[k]: u (count), out (count - 1). */
void greedy_chord_errors(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                         int64_t rational, int64_t dim, int64_t count, const double *u, double *out);

/* Write what there is to know at every point, out (count, COLUMNS).  feed (count) is that of the step before each point;
   where it is NULL, the chord over the period is. */
void greedy_along(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers, int64_t rational,
                  int64_t dim, int64_t count, const double *u, const double *feed, const double *velocity,
                  const double *acceleration, const double *settings, double *out);

#endif

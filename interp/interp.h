/* The interpolators that a controller calls once a period: plain arrays, no allocation, no library but math.

   pieces (m + 1, rows, powers): the curve as (rational) polynomials of a local parameter w in [0, 1], highest power first,
   as Horner reads them.  The rows of a piece are

       0         first parameter and width of the piece: u = pieces[i][0][0] + pieces[i][0][1] w
       1 .. dim  the machine axes, mm (rad for rotary axes)
       dim + 1   their denominator; a polynomial curve has none
       behind    where the tool tip is not made of these rows: the tip's coordinates, then their denominator

   segments (n + 1, 8): time at which the plan goes over to another quintic or another piece, s; the quintic of w in
   ascending powers of the time since then; the index of the piece.

   feed (n + 1, 5): time, s; the cubic of the path speed V(t), mm/s, in ascending powers of the time since then.

   Each of the three is closed by a row that starts at inf, so that an index advances by comparison alone.

   state (STATE_END + 2 dim): what is remembered between two periods, see interp/step_inline.h; its last dim numbers are
   the sample.  A copy of it is a snapshot that continues identically. */
#ifndef FEEDPLAN_INTERP_H
#define FEEDPLAN_INTERP_H

#include <stdint.h>

/* Go to the next sample of the plan: with t = k T the quintic of its segment gives the curve parameter, and the curve piece
   the position.  Returns 1 once it is the last one, which is then held.  It passes over the segments that begin within the
   period, one comparison each, and nothing else depends on the plan: that bounds its time. */
int64_t quintic_step(const double *segments, const double *pieces, double *state);

/* Take count steps; u (count), positions (count, dim). */
void quintic_run(const double *segments, const double *pieces, double *state, int64_t count, double *u, double *positions);

/* Go to the next sample by a Taylor step of order 1, 2 or 3; returns 1 once it is the last one, which is then held.

       u_{k+1} = u_k + T u' + T^2/2 u'' + T^3/6 u'''  with V, A, J of the plan at t_k and C', C'', C''' at u_k:

       u'   = V / |C'|
       u''  = A / |C'| - V^2 (C'.C'') / |C'|^4
       u''' = (J - 3 |C'|' u' u'' - |C'|'' u'^3) / |C'|

   (Cheng, Tsai, Cheng 2002, equations 4 to 9, carried on by one term.)  A step never goes back, nor beyond the end of the
   path; the last sample is that end, whatever the steps have accumulated. */
int64_t taylor_step(int64_t order, const double *feed, const double *pieces, double *state);

/* Take count Taylor steps; u (count), positions (count, dim). */
void taylor_run(int64_t order, const double *feed, const double *pieces, double *state, int64_t count, double *u,
                double *positions);

#endif

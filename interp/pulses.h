/* Step pulses of a plan: the times at which an axis passes halfway from one step to the next.

   Layout of the tables: see interp/interp.h.  The law of an axis is exact here, not sampled: on a segment of the plan
   S q(w(t)), with w(t) the quintic of the segment and q(w) the (rational) polynomial of the axis. */
#ifndef FEEDPLAN_PULSES_H
#define FEEDPLAN_PULSES_H

#include <stdint.h>

/* Find the pulses of one axis from where the state is up to a time, in order of time; returns how many were found.

   A counter c follows S q: it is raised when S q exceeds c + 1/2 and lowered when S q falls below c - 1/2, so it is never
   further than half a step from S q.  Between two places where the axis turns (S q)' has one sign, so each level is passed
   once: Newton's method inside a bracket that shrinks finds the time.

   Of capacity pulses at most; where that many are returned, call again with the same end.

   count        segments that there are, without the one that closes them
   rows, powers of a piece; powers at most 32
   axis         index of the axis, dim the number of axes
   steps        S, steps per mm or rad
   end          time up to which to go, s; inf for the whole plan, whose duration is the second time
   state (3)    segment, time since it began (s), counter c; changed in place
   times        (capacity) of the pulses, s
   up           (capacity) 1 where the counter is raised, 0 where it is lowered */
int64_t pulses_run(int64_t count, int64_t dim, int64_t rows, int64_t powers, int64_t axis, int64_t capacity, double steps,
                   double end, double duration, const double *restrict segments, const double *restrict pieces,
                   double *restrict state, double *restrict times, uint8_t *restrict up);

#endif

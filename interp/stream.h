/* A long plan in packets: a planner puts them in a ring, the controller's thread runs them, and stops on the path where they come
   late.

   Every packet is a plan file (docs/format-plan.md) of a stretch of one plan, cut at samples of it.  Behind its own stretch a
   packet carries the stretch after it once more: its stop tail.  The tail is so long that the governor of step.h stops within it
   from any state.  A step that begins behind a packet's own stretch goes over to the next packet if that is there; if not, it
   holds, until it is.  So there is no step at which the machine could run out of plan, and none at which it jumps: going over
   changes no number of the motion, and holding is the hold of step.h.

   One producer, one consumer, in threads of one process or with the memory mapped at one address; neither ever waits for the
   other.  A producer that died is replaced by another that goes on with packet feedplan_stream_put_count.

       feedplan_stream *stream = feedplan_stream_open(memory, size, 4, 1e-3);        before both begin
       feedplan_stream_put(stream, &place, bytes, size);                             the planner: FEEDPLAN_FULL is "later"
       feedplan_stream_step(stream, override, hold, position);                       the controller, once a period

   Freestanding C11, nothing is allocated; the counters are lock-free atomics. */
#ifndef FEEDPLAN_STREAM_H
#define FEEDPLAN_STREAM_H

#include "interp/step.h"

/* What feedplan_stream_put returns beside the errors of feedplan_open. */
enum {
    FEEDPLAN_FULL = 100, /* no slot is free: not an error */
    FEEDPLAN_NO_RESERVE, /* the plan was made without one, and cannot be stopped */
    FEEDPLAN_TOO_LARGE,  /* for a slot */
    FEEDPLAN_NOT_NEXT,   /* does not begin where the packet before has its end, or is of another plan */
    FEEDPLAN_SHORT_TAIL, /* the machine could not always be stopped within it */
    FEEDPLAN_JUMP        /* its first samples are not those of the tail before it */
};

/* What feedplan_stream_step returns. */
enum {
    FEEDPLAN_RUNNING,
    FEEDPLAN_DONE,  /* the end of the plan is reached, and held */
    FEEDPLAN_LATE,  /* holds, since the next packet is not there */
    FEEDPLAN_EMPTY  /* no packet ever was; no position is written */
};

/* Where a packet belongs: samples of the whole plan at which its own stretch begins and ends.  The last packet has no tail. */
typedef struct {
    int64_t first, next;
    int64_t is_last;
} feedplan_place;

typedef struct feedplan_stream feedplan_stream;

/* Bytes of memory for so many slots, of so many bytes each; 0 where that is no size. */
size_t feedplan_stream_size(int64_t slots, size_t packet_size);

/* Make an empty stream in memory that begins at a multiple of 8; period in s.  Returns NULL where slots < 2, the period is not
   positive, or the memory has no room or another alignment. */
feedplan_stream *feedplan_stream_open(void *memory, size_t size, int64_t slots, double period);

/* Producer: check a packet, and hand it over.  Its bytes are copied.  Returns 0, or why it was not taken. */
int feedplan_stream_put(feedplan_stream *stream, const feedplan_place *place, const void *bytes, size_t size);

/* Number of packets that were put: that of the next one. */
int64_t feedplan_stream_put_count(const feedplan_stream *stream);

/* Consumer: go to the next sample, as feedplan_step.  position (dim).  The first packet of all starts at once. */
int feedplan_stream_step(feedplan_stream *stream, double override, int hold, double *position);

/* Consumer: time of the whole plan, s; curve parameter; rate of the plan; program line. */
double feedplan_stream_time(const feedplan_stream *stream);
double feedplan_stream_parameter(const feedplan_stream *stream);
double feedplan_stream_rate(const feedplan_stream *stream);
int64_t feedplan_stream_line(const feedplan_stream *stream);

/* Plan time, s, that a stop takes at most from any state of the rate: the least that a tail must have. */
double feedplan_stop_room(const feedplan_plan *plan, double period);

#endif

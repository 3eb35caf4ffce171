/* The calls of stream.h for Python, which has arrays and no structs: a stream is the bytes of its memory. */
#ifndef FEEDPLAN_STREAM_RUN_H
#define FEEDPLAN_STREAM_RUN_H

#include <stdint.h>

/* Bytes of memory for so many slots, of so many bytes each; 0 where that is no size. */
int64_t stream_size(int64_t slots, int64_t packet_size);

/* Make a stream in memory (size).  Returns 0, or 1 where there can be none. */
int64_t stream_open(uint8_t *memory, int64_t size, int64_t slots, double period);

/* Put a packet: place (3) has first, next, is_last; bytes (size).  Returns what feedplan_stream_put does. */
int64_t stream_put(uint8_t *memory, const int64_t *place, const uint8_t *bytes, int64_t size);

/* Number of packets that were put. */
int64_t stream_put_count(const uint8_t *memory);

/* One step: command (2) is the override, and whether to hold; position (dim); course (3) gets the plan time, s, the curve
   parameter and the rate.  Returns what feedplan_stream_step does. */
int64_t stream_step(uint8_t *memory, const double *command, double *position, double *course);

/* Plan time, s, that a tail must have at least, of an opened plan (see step_run.h). */
double stop_room(const uint8_t *plan, double period);

#endif

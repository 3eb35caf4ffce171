/* The calls of stream.h on bytes; see stream_run.h. */
#include "interp/stream_run.h"

#include "interp/stream.h"

static feedplan_stream *stream_of(const uint8_t *memory) { return (feedplan_stream *)(void *)(uintptr_t)memory; }

int64_t stream_size(int64_t slots, int64_t packet_size)
{
    return packet_size < 0 ? 0 : (int64_t)feedplan_stream_size(slots, (size_t)packet_size);
}

int64_t stream_open(uint8_t *memory, int64_t size, int64_t slots, double period)
{
    return feedplan_stream_open(memory, (size_t)size, slots, period) == NULL;
}

int64_t stream_put(uint8_t *memory, const int64_t *place, const uint8_t *bytes, int64_t size)
{
    const feedplan_place where = {place[0], place[1], place[2]};
    return feedplan_stream_put(stream_of(memory), &where, bytes, (size_t)size);
}

int64_t stream_put_count(const uint8_t *memory)
{
    return feedplan_stream_put_count(stream_of(memory));
}

int64_t stream_step(uint8_t *memory, const double *command, double *position, double *course)
{
    feedplan_stream *stream = stream_of(memory);
    const int found = feedplan_stream_step(stream, command[0], command[1] != 0.0, position);
    course[0] = feedplan_stream_time(stream);
    course[1] = feedplan_stream_parameter(stream);
    course[2] = feedplan_stream_rate(stream);
    return found;
}

double stop_room(const uint8_t *plan, double period)
{
    return feedplan_stop_room((const feedplan_plan *)(const void *)plan, period);
}

/* Packets of a plan in a ring; see stream.h.

   filled counts the packets that were put and is written by the producer alone, freed those that were run through, by the consumer.
   A slot is the producer's from the load of freed that finds it free to the store of filled that hands it over (release, against
   the consumer's acquire), and the consumer's from there to its store of freed.  The packet being run is never freed before the
   next one is there; so the producer may read the one before that which it puts. */
#include "interp/stream.h"

#include <stdatomic.h>
#include <string.h>

double sqrt(double);

/* Samples of a packet that are compared with the tail before it: as many agree in position, velocity and acceleration. */
enum { COMPARED = 4 };
#define SAME 1e-9 /* mm, or of the coordinate where that is larger than 1 */

typedef struct {
    feedplan_plan plan; /* its arrays stand in the bytes of the slot */
    feedplan_place place;
} Packet;

struct feedplan_stream {
    _Atomic uint32_t filled, freed; /* 32 bits are lock-free on the least processors, and enough for 200 years of packets of 2 s */
    uint32_t slots;
    uint64_t slot_size; /* with the Packet before the bytes, a multiple of 8 */
    double period;
    feedplan_state state; /* the consumer's */
    int64_t started;
};

static uint64_t rounded(uint64_t size)
{
    return (size + 7u) & ~(uint64_t)7;
}

static Packet *packet_at(const feedplan_stream *stream, uint32_t number)
{
    unsigned char *slots = (unsigned char *)(uintptr_t)stream + rounded(sizeof *stream);
    return (Packet *)(void *)(slots + (uint64_t)(number % stream->slots) * stream->slot_size);
}

size_t feedplan_stream_size(int64_t slots, size_t packet_size)
{
    const uint64_t slot = rounded(sizeof(Packet)) + rounded(packet_size);
    if (slots < 2 || slots > UINT32_MAX || packet_size > SIZE_MAX / 4 || (uint64_t)slots > (SIZE_MAX / 2) / slot)
        return 0;
    return (size_t)(rounded(sizeof(feedplan_stream)) + (uint64_t)slots * slot);
}

feedplan_stream *feedplan_stream_open(void *memory, size_t size, int64_t slots, double period)
{
    const uint64_t head = rounded(sizeof(feedplan_stream));
    if ((uintptr_t)memory % 8 || slots < 2 || slots > UINT32_MAX || !(period > 0.0) || period - period != 0.0 || size < head ||
        (size - head) / (uint64_t)slots < rounded(sizeof(Packet)) + 8)
        return NULL;
    feedplan_stream *stream = memory;
    memset(stream, 0, sizeof *stream);
    atomic_init(&stream->filled, 0);
    atomic_init(&stream->freed, 0);
    stream->slots = (uint32_t)slots;
    stream->slot_size = (size - head) / (uint64_t)slots & ~(uint64_t)7;
    stream->period = period;
    return stream;
}

/* From any state the rate may still rise for fastest / H, then falls with H and comes to rest with L; the governor rounds each of
   these to whole periods.  The rate is at most 1 before it falls with L, and L t^2 / 2 while it does. */
double feedplan_stop_room(const feedplan_plan *plan, double period)
{
    const double high = plan->rate_jerk_high, low = period <= plan->longest_period ? plan->rate_jerk_low : high;
    const double fastest = sqrt(2.0 * high * low / (high + low)), last = fastest / low;
    return 2.0 * fastest / high + low * last * last * last / 6.0 + 4.0 * period;
}

static int same_plan(const feedplan_plan *a, const feedplan_plan *b)
{
    const size_t limits = (size_t)a->dim * sizeof(double);
    return a->dim == b->dim && a->rate_jerk_high == b->rate_jerk_high && a->rate_jerk_low == b->rate_jerk_low &&
           a->low_until == b->low_until && a->longest_period == b->longest_period &&
           !memcmp(a->velocity, b->velocity, limits) && !memcmp(a->acceleration, b->acceleration, limits) &&
           !memcmp(a->jerk, b->jerk, limits);
}

/* The position of a sample of a plan. */
static int sample_of(const feedplan_plan *plan, double period, int64_t sample, double *position)
{
    feedplan_state state;
    int wrong = feedplan_start(plan, &state, period);
    if (!wrong)
        wrong = feedplan_seek_sample(plan, &state, sample, 1.0);
    if (!wrong)
        feedplan_position(plan, &state, position);
    return wrong;
}

/* Whether a packet begins with the samples of the tail of the one before it. */
static int continues(const feedplan_stream *stream, const Packet *before, const Packet *packet)
{
    double left[FEEDPLAN_MAX_AXES], right[FEEDPLAN_MAX_AXES];
    for (int64_t k = 0; k < COMPARED; k++) {
        if (sample_of(&before->plan, stream->period, before->place.next - before->place.first + k, left) ||
            sample_of(&packet->plan, stream->period, k, right))
            return 0;
        for (int64_t j = 0; j < packet->plan.dim; j++) {
            const double size = left[j] < 0.0 ? -left[j] : left[j], off = left[j] - right[j];
            const double allowed = size > 1.0 ? SAME * size : SAME;
            if (!(off <= allowed && -off <= allowed))
                return 0;
        }
    }
    return 1;
}

/* What is wrong with a packet whose bytes are in its slot. */
static int check_packet(const feedplan_stream *stream, const Packet *packet, const Packet *before)
{
    const feedplan_plan *plan = &packet->plan;
    const int64_t own = packet->place.next - packet->place.first;
    feedplan_state state;
    const int wrong = feedplan_start(plan, &state, stream->period);
    if (wrong)
        return wrong;
    if (!plan->governed)
        return FEEDPLAN_NO_RESERVE;
    if (packet->place.first < 0 || own < COMPARED)
        return FEEDPLAN_NOT_NEXT;
    if (before ? before->place.is_last || before->place.next != packet->place.first || !same_plan(&before->plan, plan)
               : packet->place.first != 0)
        return FEEDPLAN_NOT_NEXT;
    const double room = packet->place.is_last ? 0.0 : feedplan_stop_room(plan, stream->period);
    if (!((double)own * stream->period + room <= plan->duration + stream->period))
        return FEEDPLAN_SHORT_TAIL;
    return before && !continues(stream, before, packet) ? FEEDPLAN_JUMP : FEEDPLAN_OK;
}

int feedplan_stream_put(feedplan_stream *stream, const feedplan_place *place, const void *bytes, size_t size)
{
    const uint32_t number = atomic_load_explicit(&stream->filled, memory_order_relaxed);
    if (number - atomic_load_explicit(&stream->freed, memory_order_acquire) >= stream->slots)
        return FEEDPLAN_FULL;
    if (rounded(sizeof(Packet)) + (uint64_t)size > stream->slot_size)
        return FEEDPLAN_TOO_LARGE;
    Packet *packet = packet_at(stream, number);
    unsigned char *own = (unsigned char *)packet + rounded(sizeof(Packet));
    memcpy(own, bytes, size);
    packet->place = *place;
    int wrong = feedplan_open(&packet->plan, own, size);
    if (!wrong)
        wrong = check_packet(stream, packet, number > 0 ? packet_at(stream, number - 1) : NULL);
    if (!wrong)
        atomic_store_explicit(&stream->filled, number + 1, memory_order_release);
    return wrong;
}

int64_t feedplan_stream_put_count(const feedplan_stream *stream)
{
    return atomic_load_explicit(&((feedplan_stream *)(uintptr_t)stream)->filled, memory_order_acquire);
}

static const Packet *current(const feedplan_stream *stream)
{
    return packet_at(stream, atomic_load_explicit(&((feedplan_stream *)(uintptr_t)stream)->freed, memory_order_relaxed));
}

/* Whether a state is behind the stretch that is the packet's own. */
static int is_behind(const Packet *packet, const feedplan_state *state)
{
    const double beyond = state->sample - (double)(packet->place.next - packet->place.first);
    return beyond > 0.0 || (beyond == 0.0 && state->behind >= 0.0);
}

/* Go over to the next packet: the same state of the motion, counted from where that packet begins. */
static void go_over(feedplan_stream *stream, const Packet *from, const Packet *to)
{
    feedplan_state next;
    feedplan_start(&to->plan, &next, stream->period); /* was tried when the packet was put */
    next.sample = stream->state.sample - (double)(to->place.first - from->place.first);
    next.behind = stream->state.behind;
    next.rate = stream->state.rate;
    next.rate_slope = stream->state.rate_slope;
    next.u = stream->state.u;
    next.begun = 1;
    stream->state = next;
}

int feedplan_stream_step(feedplan_stream *stream, double override, int hold, double *position)
{
    const uint32_t filled = atomic_load_explicit(&stream->filled, memory_order_acquire);
    uint32_t number = atomic_load_explicit(&stream->freed, memory_order_relaxed);
    if (filled == 0)
        return FEEDPLAN_EMPTY;
    const Packet *packet = packet_at(stream, number);
    if (!stream->started) {
        feedplan_start(&packet->plan, &stream->state, stream->period);
        stream->started = 1;
    }
    while (!packet->place.is_last && is_behind(packet, &stream->state) && filled - number >= 2) {
        const Packet *next = packet_at(stream, number + 1);
        go_over(stream, packet, next);
        packet = next;
        number++;
        atomic_store_explicit(&stream->freed, number, memory_order_release);
    }
    const int late = !packet->place.is_last && is_behind(packet, &stream->state);
    const int done = feedplan_step(&packet->plan, &stream->state, override, hold || late, position);
    return late ? FEEDPLAN_LATE : done ? FEEDPLAN_DONE : FEEDPLAN_RUNNING;
}

double feedplan_stream_time(const feedplan_stream *stream)
{
    if (!stream->started)
        return 0.0;
    const Packet *packet = current(stream);
    return (double)packet->place.first * stream->period + feedplan_time(&packet->plan, &stream->state);
}

double feedplan_stream_parameter(const feedplan_stream *stream)
{
    return stream->started ? stream->state.u : 0.0;
}

double feedplan_stream_rate(const feedplan_stream *stream)
{
    return stream->started ? stream->state.rate : 0.0;
}

int64_t feedplan_stream_line(const feedplan_stream *stream)
{
    return stream->started ? feedplan_line(&current(stream)->plan, &stream->state) : 0;
}

/* The interpolator of a controller; see step.h.

   Override.  The plan q(tau) runs at the rate r = dtau/dt, and r'' is constant over a period or over each of two parts of it.
   In the plane of r and y = r'^2 a constant r'' is a straight line of slope 2 r'', whatever the period.  The states that are
   allowed are a triangle,

       y <= 2 L r   and   y <= 2 H (1 - r),

   and |r''| is at most L up to the rate low_until, which lies a little above the tip of the triangle, and at most H <= L above.
   A line between two points of a triangle stays in it; that is the proof that no signal leads out, in docs/override.md.  What
   the plan may use of the limits so that all of it holds at every point is computed with the plan (rate_limits.py). */
#include "step.h"

#include "step_inline.h"

#include <string.h>

double sqrt(double);

/* Roundings of the triangle and of its lines: the bounds in the file have ten times as much in reserve. */
#define ROUNDING 1e-9
/* A time this close to a multiple of the period, in periods, is that multiple: see periods.py. */
#define WHOLE_PERIOD 1e-9
#define MAX_SAMPLE 8589934592.0 /* 2^33: products with the leading 20 bits of the period are exact */

/* ---- the file ---------------------------------------------------------------------------------------------------------- */

enum { HEADER_SIZE = 320, AXIS_SIZE = 16, MAX_ROWS = 16, MAX_POWERS = 64 };

/* Where the numbers of the header stand, in bytes. */
enum {
    AT_VERSION = 8,
    AT_ORDER = 12,
    AT_SIZE = 16,
    AT_CHECKSUM = 24,
    CHECKED_FROM = 32,
    AT_COUNTS = 32,  /* dim, rows, powers, pieces, segments, lines, governed: 4 bytes each */
    AT_NUMBERS = 64  /* of 8 bytes each, see Header */
};

/* The numbers of the header, from AT_NUMBERS on. */
typedef struct {
    double duration, u_start, u_end, period;
    double feed, rapid, chord_error, tangential_acceleration, tangential_jerk;
    double reserve, acceleration_share, jerk_share;
    double rate_jerk_high, rate_jerk_low, low_until, longest_period, stop_time;
    double start_feed, end_feed;
} Header;

static uint32_t word_at(const unsigned char *bytes, size_t at)
{
    uint32_t word;
    memcpy(&word, bytes + at, sizeof word);
    return word;
}

/* CRC-32 as in zlib and Ethernet, four bits at a time. */
static uint32_t checksum(const unsigned char *bytes, size_t size)
{
    static const uint32_t of_four_bits[16] = {
        0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
        0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
    };
    uint32_t found = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        found ^= bytes[i];
        found = (found >> 4) ^ of_four_bits[found & 15u];
        found = (found >> 4) ^ of_four_bits[found & 15u];
    }
    return ~found;
}

/* Whether x is finite: neither infinity less itself nor a nan is 0. */
static int is_finite(double x)
{
    return x - x == 0.0;
}

static int all_finite(const double *numbers, int64_t count)
{
    for (int64_t i = 0; i < count; i++)
        if (!is_finite(numbers[i]))
            return 0;
    return 1;
}

static int all_positive(const double *numbers, int64_t count)
{
    for (int64_t i = 0; i < count; i++)
        if (!(numbers[i] > 0.0))
            return 0;
    return 1;
}

/* Whether a row closes a table: it starts at inf. */
static int closes(double start)
{
    return start > 0.0 && !is_finite(start);
}

static int check_frame(const unsigned char *bytes, size_t size)
{
    if ((uintptr_t)bytes % sizeof(double))
        return FEEDPLAN_NOT_ALIGNED;
    if (size < HEADER_SIZE)
        return FEEDPLAN_SIZE;
    static const uint32_t magic[2] = {0x44454546u, 0x4e414c50u}; /* FEED PLAN, as a little-endian machine reads it */
    if (word_at(bytes, 0) != magic[0] || word_at(bytes, 4) != magic[1] || word_at(bytes, AT_ORDER) != 0x01020304u)
        return FEEDPLAN_NOT_A_PLAN;
    if (word_at(bytes, AT_VERSION) != FEEDPLAN_VERSION)
        return FEEDPLAN_OTHER_VERSION;
    uint64_t said;
    memcpy(&said, bytes + AT_SIZE, sizeof said);
    if (said != size || word_at(bytes, AT_CHECKSUM + 4))
        return FEEDPLAN_SIZE;
    return word_at(bytes, AT_CHECKSUM) == checksum(bytes + CHECKED_FROM, size - CHECKED_FROM) ? FEEDPLAN_OK : FEEDPLAN_CHECKSUM;
}

/* Take the sizes from the header, and lay the arrays out behind it. */
static int lay_out(feedplan_plan *plan, const unsigned char *bytes, size_t size)
{
    int64_t counts[8];
    for (size_t i = 0; i < 8; i++)
        counts[i] = (int64_t)word_at(bytes, AT_COUNTS + 4 * i);
    plan->dim = counts[0];
    plan->rows = counts[1];
    plan->powers = counts[2];
    plan->pieces = counts[3];
    plan->segments = counts[4];
    plan->lines = counts[5];
    plan->governed = counts[6];
    if (plan->dim < 1 || plan->dim > FEEDPLAN_MAX_AXES || plan->rows < plan->dim + 1 || plan->rows > plan->dim + 2 ||
        plan->powers < 2 || plan->powers > MAX_POWERS || plan->pieces < 1 || plan->segments < 1 || plan->governed > 1 || counts[7])
        return FEEDPLAN_SIZE;
    /* None of the products is beyond 2^46: the counts have 32 bits. */
    const uint64_t dim = (uint64_t)plan->dim;
    const uint64_t curve = (uint64_t)(plan->pieces + 1) * (uint64_t)(plan->rows * plan->powers);
    const uint64_t law = (uint64_t)(plan->segments + 1) * SEGMENT_WIDTH, lines = (uint64_t)(plan->lines + 1) * 2;
    const uint64_t numbers = 5 * dim + curve + law + lines;
    if (size != HEADER_SIZE + AXIS_SIZE * dim + sizeof(double) * numbers)
        return FEEDPLAN_SIZE;
    plan->axes = (const char *)bytes + HEADER_SIZE;
    plan->velocity = (const double *)(const void *)(bytes + HEADER_SIZE + AXIS_SIZE * dim);
    plan->acceleration = plan->velocity + dim;
    plan->jerk = plan->acceleration + dim;
    plan->start = plan->jerk + dim;
    plan->end = plan->start + dim;
    plan->curve = plan->end + dim;
    plan->law = plan->curve + curve;
    plan->line_starts = plan->law + law;
    return FEEDPLAN_OK;
}

static int check_header(feedplan_plan *plan, const unsigned char *bytes)
{
    Header header;
    memcpy(&header, bytes + AT_NUMBERS, sizeof header);
    const double finite[] = {header.duration,   header.u_start,  header.u_end,   header.period,
                             header.start_feed, header.end_feed, header.reserve, header.stop_time};
    const double limits[] = {header.feed, header.rapid, header.chord_error, header.tangential_acceleration,
                             header.tangential_jerk, header.duration, header.period, header.acceleration_share,
                             header.jerk_share};
    if (!all_finite(finite, 8) || !all_positive(limits, 9) || !all_positive(plan->velocity, 3 * plan->dim) ||
        !all_finite(plan->start, 2 * plan->dim))
        return FEEDPLAN_NUMBER;
    if (header.reserve < 0.0 || header.reserve > 0.5 || header.acceleration_share > 1.0 || header.jerk_share > 1.0 ||
        header.stop_time < 0.0)
        return FEEDPLAN_NUMBER;
    if (!(header.u_end > header.u_start))
        return FEEDPLAN_ORDER;
    for (int64_t j = 0; j < plan->dim; j++) {
        const char *axis = plan->axes + AXIS_SIZE * j;
        if (axis[AXIS_SIZE / 2 - 1] || axis[AXIS_SIZE - 1])
            return FEEDPLAN_NUMBER;
    }
    plan->duration = header.duration;
    plan->u_start = header.u_start;
    plan->u_end = header.u_end;
    plan->period = header.period;
    plan->rate_jerk_high = header.rate_jerk_high;
    plan->rate_jerk_low = header.rate_jerk_low;
    plan->low_until = header.low_until;
    plan->longest_period = header.longest_period;
    plan->start_feed = header.start_feed;
    if (!plan->governed)
        return FEEDPLAN_OK;
    const double bounds[] = {header.rate_jerk_high, header.rate_jerk_low, header.low_until, header.longest_period};
    if (!all_finite(bounds, 4) || !all_positive(bounds, 4))
        return FEEDPLAN_NUMBER;
    const double tip = header.rate_jerk_high / (header.rate_jerk_high + header.rate_jerk_low);
    return header.rate_jerk_low >= header.rate_jerk_high && header.low_until >= tip ? FEEDPLAN_OK : FEEDPLAN_ORDER;
}

static int check_curve(const feedplan_plan *plan)
{
    const int64_t size = plan->rows * plan->powers;
    double before = 0.0;
    for (int64_t i = 0; i < plan->pieces; i++) {
        const double *piece = plan->curve + i * size;
        if (!all_finite(piece, size))
            return FEEDPLAN_NUMBER;
        if (!(piece[1] > 0.0) || (i && !(piece[0] >= before)))
            return FEEDPLAN_ORDER;
        before = piece[0];
    }
    return closes(plan->curve[plan->pieces * size]) ? FEEDPLAN_OK : FEEDPLAN_ORDER;
}

static int check_law(const feedplan_plan *plan)
{
    double time = 0.0, piece = 0.0;
    for (int64_t i = 0; i < plan->segments; i++) {
        const double *segment = plan->law + i * SEGMENT_WIDTH;
        if (!all_finite(segment, SEGMENT_WIDTH))
            return FEEDPLAN_NUMBER;
        if (!(segment[0] >= time) || (i == 0 && segment[0] != 0.0))
            return FEEDPLAN_ORDER;
        if (!(segment[7] >= piece && segment[7] < (double)plan->pieces && (double)(int64_t)segment[7] == segment[7]))
            return FEEDPLAN_INDEX;
        time = segment[0];
        piece = segment[7];
    }
    return closes(plan->law[plan->segments * SEGMENT_WIDTH]) ? FEEDPLAN_OK : FEEDPLAN_ORDER;
}

static int check_lines(const feedplan_plan *plan)
{
    double time = 0.0;
    for (int64_t i = 0; i < plan->lines; i++) {
        const double *line = plan->line_starts + 2 * i;
        if (!all_finite(line, 2))
            return FEEDPLAN_NUMBER;
        if (!(line[0] >= time))
            return FEEDPLAN_ORDER;
        if (!(line[1] >= 0.0 && line[1] < MAX_SAMPLE && (double)(int64_t)line[1] == line[1]))
            return FEEDPLAN_INDEX;
        time = line[0];
    }
    return closes(plan->line_starts[2 * plan->lines]) ? FEEDPLAN_OK : FEEDPLAN_ORDER;
}

int feedplan_open(feedplan_plan *plan, const void *bytes, size_t size)
{
    int wrong = check_frame(bytes, size);
    if (!wrong)
        wrong = lay_out(plan, bytes, size);
    if (!wrong)
        wrong = check_header(plan, bytes);
    if (!wrong)
        wrong = check_curve(plan);
    if (!wrong)
        wrong = check_law(plan);
    return wrong ? wrong : check_lines(plan);
}

/* ---- where a sample is ------------------------------------------------------------------------------------------------- */

static Shape shape_of_plan(const feedplan_plan *plan)
{
    return (Shape){plan->dim, plan->rows, plan->powers};
}

static Period period_of_state(const feedplan_state *state)
{
    return (Period){state->high, state->low};
}

/* The last of the rows, width numbers apart, that begin at or before the time of a state; the first where none does. */
static int64_t find_row(const double *rows, int64_t width, int64_t count, const feedplan_state *state)
{
    const Period period = period_of_state(state);
    int64_t lo = 0, hi = count;
    while (hi - lo > 1) {
        const int64_t mid = lo + (hi - lo) / 2;
        if (since(period, state->sample, rows[mid * width]) + state->behind >= 0.0)
            lo = mid;
        else
            hi = mid;
    }
    return lo;
}

int feedplan_done(const feedplan_plan *plan, const feedplan_state *state)
{
    if (state->behind == 0.0)
        return state->sample >= state->last;
    return since(period_of_state(state), state->sample, plan->duration) + state->behind >= -WHOLE_PERIOD * state->high;
}

/* Write an end of the path, which stands in the file as the curve has it: its pieces may round. */
static void put_end(const feedplan_plan *plan, const double *end, double *out)
{
    for (int64_t j = 0; j < plan->dim; j++)
        out[j] = end[j];
}

/* Write the position at the time of a state, whose segment does not begin after it. */
static int put_sample(const feedplan_plan *plan, feedplan_state *state, double *out)
{
    if (feedplan_done(plan, state)) {
        put_end(plan, plan->end, out);
        state->u = plan->u_end;
        return 1;
    }
    if (state->sample == 0.0 && state->behind == 0.0) {
        put_end(plan, plan->start, out);
        return 0;
    }
    const Period period = period_of_state(state);
    const Shape shape = shape_of_plan(plan);
    state->segment = row_at(plan->law, SEGMENT_WIDTH, period, state->sample, state->behind, state->segment);
    const double *segment = plan->law + state->segment * SEGMENT_WIDTH;
    const double w = local_parameter(segment, since(period, state->sample, segment[0]) + state->behind);
    const double *piece = piece_at(plan->curve, shape, (int64_t)segment[7]);
    state->u = forward_parameter(piece, w, state->u, plan->u_end);
    position(piece, shape, w, out);
    return 0;
}

/* ---- the rate ---------------------------------------------------------------------------------------------------------- */

/* A speed |r'| that the period begins and one that it ends with; distances are those of r, in the direction of motion. */
typedef struct {
    double speed, bound, period; /* |r'| at the start; of |r''|; T */
} Motion;

/* Largest speed at the end of the period from which the rate can still be stopped with |r''| <= slope on a way of distance;
   -1 where that is less than the period takes it. */
static inline double closing_speed(Motion m, double slope, double distance)
{
    const double room = slope * (2.0 * distance - m.speed * m.period), half = 0.5 * slope * m.period;
    return room < 0.0 ? -1.0 : room / (half + sqrt(half * half + room));
}

/* Largest speed at the end of the period of a motion that began at rest, a distance before, with |r''| <= slope. */
static inline double opening_speed(Motion m, double slope, double distance)
{
    const double half = 0.5 * slope * m.period;
    return half + sqrt(half * half + slope * (2.0 * distance + m.speed * m.period));
}

static inline double least(double a, double b)
{
    return b < a ? b : a;
}

/* Ways in r that a motion may still go, with the bound on |r''| that holds to the end of each. */
typedef struct {
    double end, end_slope;        /* to the end of the triangle ahead */
    double begin, begin_slope;    /* from the end of the triangle behind */
    double target, target_slope;  /* to the target */
    double further, higher_slope; /* as far as the target by the bound above low_until, if some of the way is there */
} Ways;

/* Speed at the end of a period in which the rate comes nearer to its target as fast as may be; negative where it must stop
   within the period. */
static double next_speed(Motion m, Ways to)
{
    double next = m.speed + m.bound * m.period;
    next = least(next, closing_speed(m, to.end_slope, to.end));
    next = least(next, opening_speed(m, to.begin_slope, to.begin));
    next = least(next, closing_speed(m, to.target_slope, to.target));
    next = least(next, closing_speed(m, to.higher_slope, to.further));
    const double lowest = m.speed - m.bound * m.period;
    return next < lowest ? lowest : next;
}

/* The ways down from a rate to a target: above the rates at which L is sure to hold, what is left of
   r'^2 <= 2 L (r - target) grows by 2 H alone.  A period may begin that little above low_until that its end needs L. */
static Ways ways_down(const feedplan_state *state, double target)
{
    const double low = state->jerk_low, high = state->jerk_high, rate = state->rate;
    const double until = state->low_until - state->fastest * (state->high + state->low);
    const double further = target >= until ? rate - target : rate - until + low / high * (until - target);
    return (Ways){rate, low, 1.0 - rate, high, rate - target, low, further, high};
}

/* The ways up: the last of the way counts, which only for a low target lies where L holds. */
static Ways ways_up(const feedplan_state *state, double target)
{
    const double low = state->jerk_low, high = state->jerk_high, period = state->high + state->low, rate = state->rate;
    const double slope = target + state->fastest * period <= state->low_until ? low : high;
    return (Ways){1.0 - rate, high, rate, low, target - rate, slope, target - rate, slope};
}

/* Take the rate through a period, and the plan time with it: r'' = curve for so long, then as long at a constant rate. */
static void run_rate(feedplan_state *state, double curve, double time, double rate_after, double slope_after)
{
    const double period = state->high + state->low, slope = state->rate_slope, rest = period - time;
    const double moved = time * (state->rate - 1.0 + time * (0.5 * slope + time * curve / 6.0)) + rest * (rate_after - 1.0);
    state->rate = within(rate_after, 0.0, 1.0);
    state->rate_slope = slope_after;
    state->behind += moved;
    state->sample += 1.0;
    if (state->behind <= -period) {
        state->behind += period;
        state->sample -= 1.0;
    }
    if (state->behind > 0.0)
        state->behind = 0.0;
}

/* Take the rate one period towards a target. */
static void govern(feedplan_state *state, double target)
{
    const double period = state->high + state->low, rate = state->rate, slope = state->rate_slope;
    const int down = slope < 0.0 || (slope == 0.0 && target < rate);
    const double sign = down ? -1.0 : 1.0;
    /* L holds for all of the period if the highest rate in it is not above low_until. */
    const double highest = down ? rate : rate + state->fastest * period;
    const double bound = highest <= state->low_until ? state->jerk_low : state->jerk_high;
    const Motion m = {sign * slope, bound, period};
    const double to_target = sign * (target - rate);
    if (m.speed == 0.0 && to_target == 0.0) {
        run_rate(state, 0.0, 0.0, rate, 0.0);
        return;
    }
    /* It stops at the target within the period, if it can. */
    if (m.speed > 0.0 && to_target >= 0.0 && 2.0 * to_target <= m.speed * period &&
        m.speed * m.speed <= 2.0 * to_target * bound * (1.0 + ROUNDING)) {
        const double time = 2.0 * to_target / m.speed;
        run_rate(state, -slope / time, time, target, 0.0);
        return;
    }
    const double next = next_speed(m, down ? ways_down(state, target) : ways_up(state, target));
    if (next > 0.0) {
        const double curve = sign * (next - m.speed) / period;
        run_rate(state, curve, period, rate + sign * 0.5 * (m.speed + next) * period, sign * next);
        return;
    }
    /* It comes to rest within the period, where it is. */
    const double time = m.speed / bound;
    run_rate(state, -sign * bound, time, rate + sign * 0.5 * m.speed * time, 0.0);
}

/* ---- a controller's calls ---------------------------------------------------------------------------------------------- */

int feedplan_start(const feedplan_plan *plan, feedplan_state *state, double period)
{
    if (!(is_finite(period) && period > 0.0) || !(plan->duration < MAX_SAMPLE * period))
        return FEEDPLAN_PERIOD;
    const double periods = plan->duration / period, whole = (double)(int64_t)(periods + 0.5), off = periods - whole;
    const double last = off > WHOLE_PERIOD ? whole + 1.0 : whole;
    uint64_t bits;
    memcpy(&bits, &period, sizeof bits);
    bits &= ~((UINT64_C(1) << 33) - 1);
    double high;
    memcpy(&high, &bits, sizeof high);
    state->sample = state->behind = state->rate_slope = 0.0;
    state->segment = state->begun = 0;
    state->last = last < 1.0 ? 1.0 : last;
    state->high = high;
    state->low = period - high;
    state->u = plan->u_start;
    state->rate = 1.0;
    state->jerk_high = state->jerk_low = state->low_until = state->fastest = 0.0;
    if (plan->governed) {
        /* L needs periods that do not pass from the tip of the triangle beyond low_until. */
        const double h = plan->rate_jerk_high, l = period <= plan->longest_period ? plan->rate_jerk_low : h;
        state->jerk_high = h;
        state->jerk_low = l;
        state->low_until = l > h ? plan->low_until : 1.0;
        state->fastest = sqrt(2.0 * h * l / (h + l));
    }
    return FEEDPLAN_OK;
}

int feedplan_step(const feedplan_plan *plan, feedplan_state *state, double override, int hold, double *position_out)
{
    if (feedplan_done(plan, state)) {
        put_end(plan, plan->end, position_out);
        return 1;
    }
    double target = 1.0;
    if (plan->governed && (hold || !(override >= 1.0)))
        target = !hold && override > 0.0 ? override : 0.0;
    if (!state->begun) { /* a plan that starts from rest may start at any rate */
        state->begun = 1;
        state->rate = plan->start_feed == 0.0 ? target : 1.0;
    }
    if (target == 1.0 && state->rate == 1.0 && state->rate_slope == 0.0)
        state->sample += 1.0;
    else
        govern(state, target);
    return put_sample(plan, state, position_out);
}

void feedplan_position(const feedplan_plan *plan, const feedplan_state *state, double *position_out)
{
    feedplan_state copy = *state;
    put_sample(plan, &copy, position_out);
}

/* Take a state to the time that its sample and behind say. */
static int arrive(const feedplan_plan *plan, feedplan_state *state, double rate)
{
    if (!(rate >= 0.0 && rate <= 1.0) || (rate != 1.0 && !plan->governed))
        return FEEDPLAN_PLACE;
    state->rate = rate;
    state->rate_slope = 0.0;
    state->begun = state->sample != 0.0 || rate != 1.0;
    state->u = plan->u_start;
    state->segment = find_row(plan->law, SEGMENT_WIDTH, plan->segments, state);
    double scratch[FEEDPLAN_MAX_AXES];
    put_sample(plan, state, scratch);
    return FEEDPLAN_OK;
}

int feedplan_seek(const feedplan_plan *plan, feedplan_state *state, double time, double rate)
{
    if (!(time >= 0.0 && time <= plan->duration))
        return FEEDPLAN_PLACE;
    const double period = state->high + state->low;
    state->sample = (double)(int64_t)(time / period);
    state->behind = -since(period_of_state(state), state->sample, time);
    if (state->behind > 0.0) {
        state->sample += 1.0;
        state->behind -= period;
    }
    if (state->behind <= -period) {
        state->sample -= 1.0;
        state->behind += period;
    }
    return arrive(plan, state, rate);
}

int feedplan_seek_sample(const feedplan_plan *plan, feedplan_state *state, int64_t sample, double rate)
{
    if (!(sample >= 0 && (double)sample <= state->last))
        return FEEDPLAN_PLACE;
    state->sample = (double)sample;
    state->behind = 0.0;
    return arrive(plan, state, rate);
}

double feedplan_time(const feedplan_plan *plan, const feedplan_state *state)
{
    return feedplan_done(plan, state) ? plan->duration : since(period_of_state(state), state->sample, 0.0) + state->behind;
}

double feedplan_progress(const feedplan_plan *plan, const feedplan_state *state)
{
    return within(feedplan_time(plan, state) / plan->duration, 0.0, 1.0);
}

int64_t feedplan_line(const feedplan_plan *plan, const feedplan_state *state)
{
    if (plan->lines == 0)
        return 0;
    return (int64_t)plan->line_starts[2 * find_row(plan->line_starts, 2, plan->lines, state) + 1];
}

const char *feedplan_axis_name(const feedplan_plan *plan, int64_t axis)
{
    return axis >= 0 && axis < plan->dim ? plan->axes + AXIS_SIZE * axis : "";
}

const char *feedplan_axis_unit(const feedplan_plan *plan, int64_t axis)
{
    return axis >= 0 && axis < plan->dim ? plan->axes + AXIS_SIZE * axis + AXIS_SIZE / 2 : "";
}

const char *feedplan_error_text(int error)
{
    switch (error) {
    case FEEDPLAN_OK: return "nothing is wrong";
    case FEEDPLAN_NOT_ALIGNED: return "the bytes of the file must begin at a multiple of 8";
    case FEEDPLAN_NOT_A_PLAN: return "no plan file of this byte order";
    case FEEDPLAN_OTHER_VERSION: return "a plan file of another version";
    case FEEDPLAN_SIZE: return "the file is cut off, or its sizes contradict one another";
    case FEEDPLAN_CHECKSUM: return "the checksum is another: bytes were changed on the way";
    case FEEDPLAN_NUMBER: return "a number is not finite, or not in its range";
    case FEEDPLAN_ORDER: return "times, parameters or bounds are out of order";
    case FEEDPLAN_INDEX: return "the number of a curve piece or of a line is none";
    case FEEDPLAN_PERIOD: return "the period must be positive and finite, and make fewer than 2^33 samples";
    case FEEDPLAN_PLACE: return "the time, sample or rate must lie within the plan";
    default: return "no error of these";
    }
}

/* Step pulses: crossing times of the half-step levels, on the plan's own polynomials. */
#include "interp/pulses.h"

#include "interp/step_inline.h"
#include "planner/core.h"

#include <stddef.h>

enum {
    WIDTH = 8,       /* numbers of a segment */
    MAX_POWERS = 32, /* of a row of a piece */
    MAX_TURNS = 2 * MAX_POWERS,
    ITERATIONS = 100 /* of Newton's method or a bisection; both end long before */
};

/* Times are found to this, s: a thousandth of the nanosecond that they are written in, and more. */
static const double TIME_FOUND = 1e-13;

/* A polynomial, highest power first. */
typedef struct {
    int64_t powers;
    double c[MAX_TURNS];
} Polynomial;

/* Places, in increasing order. */
typedef struct {
    int64_t count;
    double at[MAX_TURNS];
} Places;

/* A value and its derivative. */
typedef struct {
    double value, rate;
} Rate;

/* One axis on one segment: S q(w(t)). */
typedef struct {
    const double *quintic; /* of w, ascending powers of the time since the segment began */
    const double *axis;    /* of the axis over w, highest power first */
    const double *under;   /* of its denominator; NULL where there is none */
    int64_t powers;
    double steps;
} Motion;

static inline Rate evaluated(const double *row, int64_t powers, double x)
{
    double value = row[0], rate = 0.0;
    for (int64_t n = 1; n < powers; n++) {
        rate = rate * x + value;
        value = value * x + row[n];
    }
    return (Rate){value, rate};
}

/* w and its rate; as the step of the interpolator has it, w stays within the piece. */
static inline Rate parameter_at(const Motion *motion, double t)
{
    const double *c = motion->quintic;
    const double w = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
    const double rate = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])));
    return (Rate){smaller(larger(w, 0.0), 1.0), rate};
}

/* S q and its derivative over w. */
static inline Rate steps_at(const Motion *motion, double w)
{
    Rate q = evaluated(motion->axis, motion->powers, w);
    if (motion->under) {
        const Rate under = evaluated(motion->under, motion->powers, w);
        q.value /= under.value;
        q.rate = (q.rate - q.value * under.rate) / under.value;
    }
    return (Rate){motion->steps * q.value, motion->steps * q.rate};
}

/* Root of a polynomial between a and b, where it has different signs. */
static double root_between(const Polynomial *p, double a, double b)
{
    const double sign = evaluated(p->c, p->powers, a).value < 0.0 ? 1.0 : -1.0;
    double x = 0.5 * (a + b);
    for (int n = 0; n < ITERATIONS && b - a > 1e-17; n++) {
        const Rate f = evaluated(p->c, p->powers, x);
        if (sign * f.value < 0.0)
            a = x;
        else
            b = x;
        double next = x - f.value / f.rate;
        if (!(next > a && next < b))
            next = 0.5 * (a + b);
        if (fabs(next - x) <= 1e-16)
            return next;
        x = next;
    }
    return x;
}

/* Roots within (0, 1) at which a polynomial changes its sign.  Those of its derivatives, from the last one down, are the places
   between which each one before has one root at most. */
static void sign_changes(const Polynomial *p, Places *found)
{
    found->count = 0;
    for (int64_t order = p->powers - 2; order >= 0; order--) {
        Polynomial d = {.powers = p->powers - order};
        for (int64_t n = 0; n < d.powers; n++) {
            d.c[n] = p->c[n];
            for (int64_t k = 0; k < order; k++)
                d.c[n] *= (double)(p->powers - 1 - n - k) / (double)(k + 1); /* over k!: small numbers stay small */
        }
        Places next = {.count = 0};
        double before = 0.0, value = evaluated(d.c, d.powers, 0.0).value;
        for (int64_t i = 0; i <= found->count; i++) {
            const double here = i < found->count ? found->at[i] : 1.0;
            const double there = evaluated(d.c, d.powers, here).value;
            if ((value < 0.0 && there > 0.0) || (value > 0.0 && there < 0.0))
                next.at[next.count++] = root_between(&d, before, here);
            before = here;
            value = there;
        }
        *found = next;
    }
}

/* Where on its piece the axis turns: N' D - N D' changes its sign, or N' where there is no denominator. */
static void turns_of(const Motion *motion, Places *found)
{
    const int64_t m = motion->powers;
    Polynomial p = {.powers = motion->under ? 2 * m - 2 : m - 1};
    for (int64_t n = 0; n < p.powers; n++)
        p.c[n] = 0.0;
    for (int64_t i = 0; i < m; i++) {
        if (!motion->under) {
            if (i < m - 1)
                p.c[i] = (double)(m - 1 - i) * motion->axis[i];
            continue;
        }
        for (int64_t j = 0; j < m; j++) /* power (m-1-i) + (m-1-j) - 1 of w; that of i = j = 0 cancels */
            if (i + j > 0)
                p.c[i + j - 1] += (double)(j - i) * motion->axis[i] * motion->under[j];
    }
    if (motion->under)
        p.powers = 2 * m - 3; /* the terms i + j = 2 m - 2 are constants, and vanish */
    sign_changes(&p, found);
}

/* Time within [a, b] at which w reaches a place that it passes there. */
static double time_of(const Motion *motion, double place, double a, double b)
{
    double x = 0.5 * (a + b);
    for (int n = 0; n < ITERATIONS && b - a > TIME_FOUND; n++) {
        const Rate w = parameter_at(motion, x);
        if (w.value < place)
            a = x;
        else
            b = x;
        double next = x - (w.value - place) / w.rate;
        if (!(next > a && next < b))
            next = 0.5 * (a + b);
        if (fabs(next - x) <= TIME_FOUND)
            return next;
        x = next;
    }
    return x;
}

/* Time within [a, b] at which sign (S q - level) passes from below 0 to above; it rises there. */
static double crossing(const Motion *motion, double level, double sign, double a, double b)
{
    double x = a;
    for (int n = 0; n < ITERATIONS && b - a > TIME_FOUND; n++) {
        const Rate w = parameter_at(motion, x), q = steps_at(motion, w.value);
        const double f = sign * (q.value - level);
        if (f < 0.0)
            a = x;
        else
            b = x;
        double next = x - f / (sign * q.rate * w.rate);
        if (!(next >= a && next <= b))
            next = 0.5 * (a + b);
        if (fabs(next - x) <= TIME_FOUND)
            return next;
        x = next;
    }
    return x;
}

/* Where the pulses go. */
typedef struct {
    int64_t capacity, count;
    double *restrict times;
    uint8_t *restrict up;
} Pulses;

/* Put down the pulses of a stretch [*from, to] on which the axis does not turn; 0 where there was no room for all. */
static int cross_stretch(const Motion *motion, double start, double to, double *from, double *counter, Pulses *pulses)
{
    const double last = steps_at(motion, parameter_at(motion, to).value).value;
    for (;;) {
        const int rise = last > *counter + 0.5;
        if (!rise && !(last < *counter - 0.5))
            break;
        if (pulses->count == pulses->capacity)
            return 0;
        const double sign = rise ? 1.0 : -1.0;
        *from = crossing(motion, *counter + 0.5 * sign, sign, *from, to);
        *counter += sign;
        pulses->times[pulses->count] = start + *from;
        pulses->up[pulses->count++] = (uint8_t)rise;
    }
    *from = to;
    return 1;
}

/* Put down the pulses of a segment from *from to a time; 0 where there was no room for all. */
static int cross_segment(const Motion *motion, const Places *turns, double start, double to, double *from, double *counter,
                         Pulses *pulses)
{
    const double first = parameter_at(motion, *from).value, last = parameter_at(motion, to).value;
    for (int64_t i = 0; i < turns->count; i++)
        if (turns->at[i] > first && turns->at[i] < last) {
            const double at = time_of(motion, turns->at[i], *from, to);
            if (!cross_stretch(motion, start, at, from, counter, pulses))
                return 0;
        }
    return cross_stretch(motion, start, to, from, counter, pulses);
}

int64_t pulses_run(int64_t count, int64_t dim, int64_t rows, int64_t powers, int64_t axis, int64_t capacity, double steps,
                   double end, double duration, const double *restrict segments, const double *restrict pieces,
                   double *restrict state, double *restrict times, uint8_t *restrict up)
{
    const Shape shape = {dim, rows, powers};
    Pulses pulses = {capacity, 0, times, up};
    int64_t segment = (int64_t)state[0], known = -1;
    double from = state[1], counter = state[2];
    Places turns = {.count = 0};
    for (; segment < count; segment++) {
        const double *c = segments + segment * WIDTH;
        const double length = smaller(c[WIDTH], duration) - c[0];
        const double to = smaller(length, end - c[0]);
        const double *piece = piece_at(pieces, shape, (int64_t)c[7]);
        const Motion motion = {c + 1, piece + (axis + 1) * powers, rows > dim + 1 ? piece + (dim + 1) * powers : NULL,
                               powers, steps};
        if (known != (int64_t)c[7])
            turns_of(&motion, &turns);
        known = (int64_t)c[7];
        if (to > from && !cross_segment(&motion, &turns, c[0], to, &from, &counter, &pulses))
            break;
        if (to < length)
            break;
        from = 0.0;
    }
    state[0] = (double)segment;
    state[1] = from;
    state[2] = counter;
    return pulses.count;
}

/* LinuxCNC's motion, period by period.
 *
 * Within a period a segment speeds up, cruises or slows down at its acceleration so that it can still reach its end at the
 * speed planned there; one that ends within the next period is left at that moment, and the next begins in the rest of it.
 * So no period takes in more than two segments.  In a parabolic blend both move.
 */
#include "planner/controllers/controllers.h"

#include "planner/controllers/linuxcnc_inline.h"

enum { TIME, LEG, FROM, SPEED, RATE, SECONDS, WAY, PIECE = WAY + 3 };

#define SAME_RATE 1e-9 /* of the acceleration: pieces of a ramp or a cruise become one */

typedef struct {
    const Machine *m;
    Segment *queue, *end;
    double time;
    int64_t count, most;
    double *pieces;
} Run;

/* What a segment did in a part of a period. */
typedef struct {
    double x, speed, seconds;
} Before;

static void place_of(const Segment *s, double x, double *out) {
    if (s->kind == LINE) {
        add3(s->origin, x, s->way, out);
    } else if (s->kind == CIRCLE) {
        circle_point(s, x / s->length * s->angle, out);
    } else if (x < s->lead) {
        add3(s->origin, 1.0, s->spoke, out);
        add3(out, x - s->lead, s->way, out);
    } else {
        const double turned = (x - s->lead) / s->radius;
        add3(s->origin, cos(turned), s->spoke, out);
        add3(out, sin(turned), s->across, out);
    }
}

/* Add a piece, or lengthen the last one where it goes on. */
static void add_piece(Run *r, double leg, double from, double speed, double rate, double seconds) {
    if (!(seconds > 0.0)) return;
    double *last = r->count > 0 ? r->pieces + PIECE * (r->count - 1) : 0;
    if (last && leg >= 0.0 && last[LEG] == leg && fabs(last[RATE] - rate) <= SAME_RATE * (1.0 + fabs(rate)) &&
        fabs(last[SPEED] + last[RATE] * last[SECONDS] - speed) <= SAME_RATE * (1.0 + speed)) {
        last[SECONDS] += seconds;
    } else {
        double *p = r->pieces + PIECE * r->count++;
        p[TIME] = r->time;
        p[LEG] = leg;
        p[FROM] = from;
        p[SPEED] = speed;
        p[RATE] = rate;
        p[SECONDS] = seconds;
        p[WAY] = p[WAY + 1] = p[WAY + 2] = 0.0;
    }
    r->time += seconds;
}

/* Note what a segment did alone. */
static void note_alone(Run *r, const Segment *s, Before b, double speed) {
    const double way = s->x - b.x;
    const double leg = 2.0 * (double)(s - r->queue);
    double rate = b.seconds > 0.0 ? (speed - b.speed) / b.seconds : 0.0, first = b.speed;
    if (fabs(way - 0.5 * (speed + b.speed) * b.seconds) > NEAR_POSITION * (1.0 + s->length)) {
        rate = 0.0; /* it was put on its end */
        first = b.seconds > 0.0 ? way / b.seconds : 0.0;
    }
    if (s->kind != ROUNDING || b.x >= s->lead) {
        add_piece(r, leg + 1.0, b.x - (s->kind == ROUNDING ? s->lead : 0.0), first, rate, b.seconds);
    } else if (s->x <= s->lead) {
        add_piece(r, leg, b.x, first, rate, b.seconds);
    } else {
        const double to = s->lead - b.x, there = sqrt(fmax(first * first + 2.0 * rate * to, 0.0));
        const double taken = fmin(2.0 * to / (first + there), b.seconds);
        add_piece(r, leg, b.x, first, rate, taken);
        add_piece(r, leg + 1.0, 0.0, there, rate, b.seconds - taken);
    }
}

/* Note what two segments did together: the chord of the period. */
static void note_both(Run *r, const Segment *s, Before b, const Segment *next, Before nb) {
    double from[3], to[3], way[3];
    place_of(s, b.x, from);
    place_of(s, s->x, to);
    add3(to, -1.0, from, way);
    place_of(next, nb.x, from);
    place_of(next, next->x, to);
    for (int i = 0; i < 3; i++) way[i] += to[i] - from[i];
    const double length = size3(way), period = r->m->period;
    double *p = r->pieces + PIECE * r->count++;
    p[TIME] = r->time;
    p[LEG] = -1.0 - (double)(s - r->queue);
    p[FROM] = p[RATE] = 0.0;
    p[SPEED] = length / period;
    p[SECONDS] = period;
    for (int i = 0; i < 3; i++) p[WAY + i] = way[i];
    r->time += period;
}

static double final_speed(const Run *r, const Segment *s, const Segment *next) {
    if (s->ending != TANGENT || !next) return 0.0;
    return fmin(s->out, fmin(present_speed(r->m, s), present_speed(r->m, next)));
}

/* Leave the segment after this time, at this speed. */
static void split(Segment *s, double seconds, double speed) {
    s->splits = 1.0;
    s->period = seconds;
    s->exit = speed;
}

/* Whether the segment ends within the next period, and when. */
static void look_for_end(const Run *r, Segment *s, const Segment *next) {
    s->period = r->m->period;
    const double left = s->length - s->x;
    const int halts = s->ending == STOPS || s->ending == EXACT;
    if (left <= NEAR_POSITION) {
        s->x = s->length;
        split(s, 0.0, s->speed);
        if (halts) s->done = 1.0;
        return;
    }
    if (halts) return;
    double out = final_speed(r, s, next), seconds = 0.5 * NEAR_TIME;
    const double mean = 0.5 * (s->speed + out), most = along_acceleration(s);
    if (mean > NEAR_SPEED) {
        seconds = fmax(seconds, left / mean);
    } else if (left > mean * r->m->period) {
        return;
    }
    const double needed = (out - s->speed) / seconds, rate = within(needed, -most, most);
    if (rate != needed) {
        const double square = (s->speed / rate) * (s->speed / rate) + 2.0 * left / rate;
        if (square < 0.0) return;
        const double root = square < NEAR_TIME * NEAR_TIME ? 0.0 : sqrt(square);
        seconds = -s->speed / rate + (rate > 0.0 ? root : -root);
        out = s->speed + seconds * rate;
    }
    if (seconds < NEAR_TIME) {
        s->x = s->length;
        split(s, 0.0, out);
    } else if (seconds < r->m->period) {
        split(s, seconds, out);
    }
}

/* Acceleration of this period, and whether it slows down for the end.  wanted is the speed that allows the end. */
static double choose_acceleration(const Run *r, const Segment *s, const Segment *next, double *wanted) {
    const double left = s->length - s->x, most = along_acceleration(s), out = final_speed(r, s, next);
    if (s->ramps != 0.0 && s->ending == TANGENT && out >= NEAR_SPEED) {
        const double mean = 0.5 * (s->speed + out);
        const double seconds = mean > NEAR_SPEED ? fmax(left / mean, 1e-16) : 1e-16;
        *wanted = out;
        return within((out - s->speed) / seconds, -most, most);
    }
    /* v1 of v1 T / 2 + v1^2 / (2 a) = left - v0 T / 2 + out^2 / (2 a), the rest of the way after this period */
    const double half = 0.5 * most * s->period;
    const double square = out * out + most * (2.0 * left - s->speed * s->period) + half * half;
    const double reach = square > half * half ? sqrt(square) - half : -half;
    *wanted = reach;
    const double top = present_speed(r->m, s);
    const double speed = within(reach, -top, top);
    return within((speed - s->speed) / fmax(s->period, NEAR_TIME), -most, most);
}

/* Move a segment on by its part of the period; returns what it was before. */
static Before step(const Run *r, Segment *s, const Segment *next, double *reached) {
    const Before b = {s->x, s->speed, s->period};
    double wanted;
    const double rate = choose_acceleration(r, s, next, &wanted), speed = s->speed + rate * s->period;
    if (speed < 0.0) {
        if (s->length - s->x < s->speed * s->period) s->x = s->length;
        s->speed = 0.0;
    } else {
        s->x = within(s->x + 0.5 * (speed + s->speed) * s->period, 0.0, s->length);
        s->speed = speed;
    }
    s->slowing = fabs(wanted - s->speed) < NEAR_SPEED && rate < 0.0;
    *reached = s->speed;
    look_for_end(r, s, next);
    return b;
}

static void activate(const Run *r, Segment *s) {
    s->active = 1.0;
    s->blends_out = s->slowing = 0.0;
    const double left = s->length - s->x, at_end = fmin(s->out, present_speed(r->m, s));
    s->ramps = 2.0 * left / (s->speed + at_end) < 1.0 / r->m->ramp_frequency && s->rapid == 0.0 &&
               s->ending == TANGENT && left != 0.0;
}

/* The last part of a segment, and the first of the next. */
static void pass_on(Run *r, Segment *s, Segment *next) {
    Before b = {s->x, s->speed, s->period};
    const double speed = s->exit;
    double reached;
    s->x = s->length;
    s->done = 1.0;
    if (!next) {
        b.seconds = r->m->period;
        note_alone(r, s, b, speed);
        return;
    }
    if (s->ending == TANGENT) {
        note_alone(r, s, b, speed);
        next->period = r->m->period - s->period;
        next->speed = speed;
    }
    const Before nb = step(r, next, next + 1 < r->end ? next + 1 : 0, &reached);
    if (s->ending == TANGENT || b.seconds == 0.0) {
        note_alone(r, next, nb, reached);
    } else {
        note_both(r, s, b, next, nb);
    }
}

/* A whole period on a segment, or on it and the next where they overlap. */
static void go_on(Run *r, Segment *s, Segment *next) {
    double reached, ignored;
    s->period = r->m->period;
    const Before b = step(r, s, next, &reached);
    if (s->ending == PARABOLIC && next) {
        linuxcnc_blend_speeds(s, next, present_speed(r->m, s), present_speed(r->m, next), &s->blend_speed, &ignored);
        if (s->slowing != 0.0 && s->speed < s->blend_speed) s->blends_out = 1.0;
        if (s->blends_out != 0.0) {
            next->capped = 1.0;
            note_both(r, s, b, next, step(r, next, 0, &ignored));
            return;
        }
    }
    note_alone(r, s, b, reached);
}

int64_t linuxcnc_run(const double *machine, int64_t count, double *segments, double *state, int64_t most,
                     double *pieces) {
    Run r = {(const Machine *)machine, (Segment *)segments, (Segment *)segments + count, state[1], 0, most, pieces};
    Segment *s = r.queue + (int64_t)state[0];
    while (s < r.end && r.count + 4 <= most) {
        Segment *next = s + 1 < r.end ? s + 1 : 0;
        if (s->active == 0.0) activate(&r, s);
        s->capped = 0.0;
        if (next) next->capped = 0.0;
        if (s->splits != 0.0) {
            pass_on(&r, s, next);
        } else {
            go_on(&r, s, next);
        }
        if (s->done != 0.0) s++;
    }
    state[0] = (double)(s - r.queue);
    state[1] = r.time;
    state[2] = s >= r.end;
    return r.count;
}

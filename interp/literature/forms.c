/* Replays by other forms than the Taylor step with V(t): V(u), Runge-Kutta, chords. */
#include "interp/literature/literature.h"

#include "interp/literature/chord_inline.h"

enum { COURSE_WIDTH = 7, NEWTON_PASSES = 60 };
enum { TAYLOR_BY_PARAMETER, RUNGE_KUTTA, CHORD };

/* With V(u): periods before the plan's end, and share of the way left, within which a step is taken to the end. */
static const double ARRIVAL = 1.5, CRAWL = 0.1;

/* What a replay runs on. */
typedef struct {
    int64_t form, order;
    const double *feed, *course, *pieces;
    double duration, u_end;
    Period parts;
    double period;
    Shape shape;
} Replay;

/* Where it is. */
typedef struct {
    double k;
    int64_t feed_row, course_row, piece;
    double u;
} Place;

/* Time at which the plan is at u: Newton on its quintic, bisection where Newton leaves the bracket.  row is the course's. */
static double time_at(const double *course, double u, double duration, int64_t *row)
{
    const double *c = course + *row * COURSE_WIDTH;
    while (c[COURSE_WIDTH] < duration && c[COURSE_WIDTH + 1] <= u)
        c += COURSE_WIDTH;
    *row = (c - course) / COURSE_WIDTH;
    double lo = 0.0, hi = smaller(c[COURSE_WIDTH], duration) - c[0];
    double t = 0.5 * hi;
    for (int n = 0; n < NEWTON_PASSES; n++) {
        const double value = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6])))) - u;
        const double slope = c[2] + t * (2.0 * c[3] + t * (3.0 * c[4] + t * (4.0 * c[5] + t * 5.0 * c[6])));
        if (value > 0.0)
            hi = t;
        else
            lo = t;
        double trial = t - value / slope;
        if (!(lo <= trial && trial <= hi))
            trial = 0.5 * (lo + hi);
        const double moved = fabs(trial - t);
        t = trial;
        if (moved <= 1e-15 * duration)
            break;
    }
    return c[0] + t;
}

/* Step of a Taylor form, from the feed that the plan had where it was at u. */
static double step_by_parameter(const Replay *replay, Place *at, Triple speeds)
{
    const double time = time_at(replay->course, at->u, replay->duration, &at->course_row);
    const int near = replay->duration - time <= ARRIVAL * replay->period;
    while (replay->feed[(at->feed_row + 1) * FEED_WIDTH] <= time)
        at->feed_row++;
    const double *c = replay->feed + at->feed_row * FEED_WIDTH;
    const double t = time - c[0];
    double step = 0.0;
    if (speeds.first > 0.0)
        step = taylor_series(replay->order, replay->period, speeds, feed_at(c, t), acceleration_at(c, t), jerk_at(c, t));
    if (near && step < CRAWL * (replay->u_end - at->u))
        step = replay->u_end - at->u;
    return step;
}

/* The plan's feed at sample k; row is that of the sample before, and becomes that of k. */
static double feed_of_sample(const Replay *replay, double k, int64_t *row)
{
    *row = row_at(replay->feed, FEED_WIDTH, replay->parts, k, 0.0, *row);
    const double *c = replay->feed + *row * FEED_WIDTH;
    return feed_at(c, since(replay->parts, k, c[0]));
}

/* v, v1: feed at u and one period later. */
static double runge_kutta_step(const Replay *replay, const Place *at, double speed, double v, double v1)
{
    const double step = replay->period * v / speed;
    const double other = smaller(at->u + step, replay->u_end);
    const double *piece = piece_at(replay->pieces, replay->shape, piece_of(replay->pieces, replay->shape, other, at->piece));
    const double following = tip_speed(piece, replay->shape, other, 1).first;
    return following > 0.0 ? 0.5 * (step + replay->period * v1 / following) : step;
}

/* length: way of the period, mm. */
static double chord_step(const Replay *replay, const Place *at, double speed, double length)
{
    const double *piece = piece_at(replay->pieces, replay->shape, at->piece);
    double step = length / speed;
    for (int64_t n = 0; n < replay->order; n++) {
        const double other = smaller(at->u + step, replay->u_end);
        const int64_t owner = piece_of(replay->pieces, replay->shape, other, at->piece);
        const double *far = piece_at(replay->pieces, replay->shape, owner);
        const double chord = chord_length(piece, at->u, far, other, replay->shape);
        if (chord > 0.0)
            step = (other - at->u) * length / chord;
    }
    return step;
}

/* Step of a form with V(t). */
static double step_by_time(const Replay *replay, Place *at, double speed)
{
    const double v = feed_of_sample(replay, at->k, &at->feed_row);
    int64_t row = at->feed_row;
    if (replay->form == RUNGE_KUTTA) {
        const double v1 = feed_of_sample(replay, at->k + 1.0, &row);
        return speed > 0.0 ? runge_kutta_step(replay, at, speed, v, v1) : 0.0;
    }
    const double middle = feed_of_sample(replay, at->k + 0.5, &row);
    const double v1 = feed_of_sample(replay, at->k + 1.0, &row);
    const double length = replay->period / 6.0 * (v + 4.0 * middle + v1);
    return speed > 0.0 ? chord_step(replay, at, speed, length) : 0.0;
}

int64_t form_run(int64_t form, int64_t order, const double *feed, const double *course, const double *pieces,
                 double duration, double *state, int64_t count, double *u, double *positions)
{
    const Shape shape = shape_of(state);
    const Period parts = period_of(state);
    const double u_end = state[U_END];
    const Replay replay = {form, order, feed, course, pieces, duration, u_end, parts, parts.high + parts.low, shape};
    Place at = {state[SAMPLE], (int64_t)state[SEGMENT], 0, (int64_t)state[PIECE], state[PARAMETER]};
    int64_t taken = 0;
    for (; taken < count && at.u < u_end; taken++) {
        const int64_t speed_order = form == TAYLOR_BY_PARAMETER ? order : 1;
        const Triple speeds = tip_speed(piece_at(pieces, shape, at.piece), shape, at.u, speed_order);
        double step = u_end - at.u;
        if (form == TAYLOR_BY_PARAMETER)
            step = step_by_parameter(&replay, &at, speeds);
        else if (at.k + 1.0 < state[LAST])
            step = step_by_time(&replay, &at, speeds.first);
        at.u = smaller(at.u + larger(step, 0.0), u_end);
        at.k += 1.0;
        at.piece = piece_of(pieces, shape, at.u, at.piece);
        const double *piece = piece_at(pieces, shape, at.piece);
        if (at.u >= u_end)
            end_position(state, shape.dim, positions + taken * shape.dim);
        else
            position(piece, shape, local(piece, at.u), positions + taken * shape.dim);
        u[taken] = at.u;
    }
    state[SAMPLE] = at.k;
    state[SEGMENT] = (double)at.feed_row;
    state[PIECE] = (double)at.piece;
    state[PARAMETER] = at.u;
    return taken;
}

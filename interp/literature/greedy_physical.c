/* Algorithms 1 to 4 as the text of the thesis describes them: the planned feedrate drives the step. */
#include "interp/literature/literature.h"

#include "interp/literature/greedy_chord_inline.h"

enum { MAX_PASSES = 100000 }; /* 0.999 to this power is 0 */

/* Feedrate of the next period by the cases of the table: A faster, B slower, C as it is.  V, A: of the period before. */
static inline double next_feed(double target, Range range, const double *settings, double V, double A)
{
    const double period = settings[PERIOD], change = settings[JERK] * settings[PERIOD];
    if (target > V) {
        const double rise = smaller(larger(A > 0.0 ? A + change : change, 0.0), range.highest);
        return smaller(V + rise * period, target);
    }
    if (target < V && settings[SOFT] > 0.0) {
        const double fall = smaller(larger(A < 0.0 ? A - change : -change, range.lowest), 0.0);
        return larger(V + fall * period, target);
    }
    return target;
}

/* Shrink the step by 0.999 until the chord error is within the tolerance; then grow it by 1.001 up to the cap. */
static inline double fine_steps(Chord *chord, double du, double cap, double tolerance)
{
    for (int n = 0; n < MAX_PASSES; n++) {
        if (chord_error(chord, du, tolerance) <= tolerance)
            break;
        du *= 0.999;
    }
    while (du < cap) {
        const double trial = smaller(du * 1.001, cap);
        const double error = chord_error(chord, trial, tolerance);
        if (!(error <= tolerance))
            break;
        du = trial;
        if (error >= PUSH_UP * tolerance)
            break;
    }
    return du;
}

/* Feedrate of the period that begins at a point; shape is its S-curve, most what limits 1, 2 and 4 allow. */
static inline double planned_feed(const double *settings, FeedLimits limits, double most, double shape, Range range,
                                  double V, double A)
{
    if (settings[ALGORITHM] == 1.0)
        return larger(settings[FEED] * shape, settings[FLOOR]);
    double limit = most;
    if (settings[ALGORITHM] >= 3.0)
        limit = smaller(most, chord_limit(limits.curvature, settings[TOLERANCE], settings[PERIOD]));
    return next_feed(larger(limit * shape, smaller(limit, settings[FLOOR])), range, settings, V, A);
}

/* The step whose chord error is within the tolerance; in Algorithm 4 up to the feed that the other limits allow. */
static inline double held_step(Chord *chord, const double *settings, double du, double shape, double most, double feed)
{
    double cap = du;
    if (settings[ALGORITHM] >= 4.0 && shape > PUSH_UP)
        cap = du * larger(1.0, most / feed);
    if (settings[ROOT] > 0.0)
        return step_to_tolerance(chord, du, cap, settings[TOLERANCE]);
    return fine_steps(chord, du, cap, settings[TOLERANCE]);
}

HOT int64_t greedy_physical_run(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                                int64_t rational, int64_t dim, const double *velocity, const double *acceleration,
                                const double *settings, double *state, int64_t room, double *u_out, double *feed_out)
{
    const Path path = {breaks, coefficients, pieces - 1, dim, powers, rational};
    const double period = settings[PERIOD], algorithm = settings[ALGORITHM], tolerance = settings[TOLERANCE];
    double first[MOST_AXES], second[MOST_AXES];
    Chord chord;
    int64_t code = RUNNING, count = 0, piece = (int64_t)state[PIECE];
    double u = state[U], V = state[PLANNED], A = state[RATE], tiny = state[TINY_STEPS];
    while (count < room) {
        piece = derivatives(&path, u, piece, first, second);
        const FeedLimits limits = feed_limits(first, second, dim, velocity, acceleration, settings[SAFETY]);
        const double speed = limits.speed;
        state[SPEED] = speed;
        if (!(speed > settings[SINGULAR_SPEED] && speed < INFINITY)) {
            code = SINGULAR;
            break;
        }
        const double shape = s_curve(u, settings);
        const double most = smaller(smaller(settings[FEED], limits.axis), limits.normal);
        const Range range = acceleration_range(first, second, dim, speed, limits.along, V, acceleration);
        double feed = planned_feed(settings, limits, most, shape, range, V, A);
        A = (feed - V) / period;
        V = feed;
        const double way = period * feed;
        double du = way / speed - 0.5 * way * way * limits.along / square(square(speed));
        if (algorithm >= 3.0 && tolerance < INFINITY && du > 0.0 && du < INFINITY) {
            const double planned = du;
            begin_chord(&chord, &path, u, piece);
            du = held_step(&chord, settings, du, shape, most, feed);
            feed *= du / planned;
        }
        state[DU] = du;
        code = stalled(u, du, &tiny);
        if (code != RUNNING)
            break;
        u = smaller(u + du, 1.0);
        u_out[count] = u;
        feed_out[count++] = feed;
        if (u >= 1.0) {
            code = DONE;
            break;
        }
    }
    state[U] = u;
    state[PLANNED] = V;
    state[RATE] = A;
    state[PIECE] = (double)piece;
    state[TINY_STEPS] = tiny;
    state[COUNT] = (double)count;
    return code;
}

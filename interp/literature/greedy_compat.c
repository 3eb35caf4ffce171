/* Algorithms 1 to 4 as the published program has them: the command drives the step, the error is another curve's. */
#include "interp/literature/literature.h"

#include "interp/literature/greedy_chord_inline.h"

enum { BLOCK = 64 };                    /* trials passed over at once */
static const double LOW_THETA = 1e-9;   /* 0.9, 0.8, ... reaches 0 in the tenth pass but for rounding */
static const double MOST_THETA = 2.0;

/* Multiply the step by theta = 1 - d, 1 - 2 d, ... until the chord error is within the tolerance.

   d = 0.1 in Algorithm 2, 1e-6 in Algorithms 3 and 4.  The error grows with the step: of a block of trials whose last one is
   still too large none is looked at.  Returns the code. */
static inline int64_t back_off(Chord *chord, const double *settings, double *du, double *theta)
{
    const double d = settings[ALGORITHM] > 2.0 ? 1e-6 : 0.1, tolerance = settings[TOLERANCE];
    *theta = 1.0 - d;
    if (chord_error(chord, *du, tolerance) <= tolerance)
        return RUNNING;
    while (d * BLOCK < *theta && *du > 0.0) {
        double trial = *du, next_theta = *theta;
        for (int n = 0; n < BLOCK; n++) {
            trial *= next_theta;
            next_theta -= d;
        }
        if (chord_error(chord, trial, tolerance) <= tolerance)
            break;
        *du = trial;
        *theta = next_theta;
    }
    while (*theta > LOW_THETA && *du > 0.0) {
        *du *= *theta;
        *theta -= d;
        if (chord_error(chord, *du, tolerance) <= tolerance)
            return RUNNING;
    }
    return BACK_OFF;
}

/* Multiply the step by theta = 1, 1 + 1e-7, ... until the chord error is 0.999 of the tolerance at least.

   A block of trials whose last one is still too small is passed over, as in the back-off. */
static inline void push_up(Chord *chord, double tolerance, double *du, double *theta)
{
    const double least = PUSH_UP * tolerance, d = 1e-7;
    *theta = 1.0;
    while (*du <= MAX_STEP && *theta < MOST_THETA) {
        double trial = *du, next_theta = *theta;
        for (int n = 0; n < BLOCK; n++) {
            trial *= next_theta;
            next_theta += d;
        }
        if (!(chord_error(chord, trial, least) < least))
            break;
        *du = trial;
        *theta = next_theta;
    }
    while (*du <= MAX_STEP && *theta < MOST_THETA && chord_error(chord, *du, least) < least) {
        *du *= *theta;
        *theta += d;
    }
}

/* Feedrate that drives the step. */
static inline double driving_feed(const double *settings, double u, const double *first, const double *second, int64_t dim,
                                  const double *velocity, const double *acceleration)
{
    if (!(settings[PLANNED_FEED] > 0.0))
        return settings[FEED];
    const FeedLimits limits = feed_limits(first, second, dim, velocity, acceleration, settings[SAFETY]);
    double limit = smaller(smaller(settings[FEED], limits.axis), limits.normal);
    if (settings[ALGORITHM] >= 3.0)
        limit = smaller(limit, chord_limit(limits.curvature, settings[TOLERANCE], settings[PERIOD]));
    return larger(limit * s_curve(u, settings), smaller(limit, settings[FLOOR]));
}

/* The second-order Taylor step over a way of one period, mm. */
static inline double taylor_step_of(const double *settings, double way, double speed, const double *first,
                                    const double *second, int64_t dim)
{
    if (settings[EXACT_TAYLOR] > 0.0)
        return fabs(way / speed - 0.5 * way * way * dot(first, second, dim) / square(square(speed)));
    return fabs(way / speed - 0.5 * way * way * sqrt(dot(second, second, dim)) / (speed * square(speed)));
}

/* Hold the chord error: shorten the step, and lengthen it in Algorithm 4.  Returns the code. */
static inline int64_t hold_chord_error(Chord *chord, const double *settings, double *du, double *theta)
{
    const double algorithm = settings[ALGORITHM], tolerance = settings[TOLERANCE];
    if (settings[ROOT] > 0.0) {
        *du = step_to_tolerance(chord, *du, algorithm >= 4.0 ? 2.0 * MAX_STEP : *du, tolerance);
        return RUNNING;
    }
    const int64_t code = back_off(chord, settings, du, theta);
    if (algorithm >= 4.0 && code == RUNNING)
        push_up(chord, tolerance, du, theta);
    return code;
}

HOT int64_t greedy_compat_run(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                              int64_t rational, int64_t dim, const double *error_breaks,
                              const double *error_coefficients, int64_t error_pieces, int64_t error_powers,
                              int64_t error_rational, int64_t error_dim, const double *velocity,
                              const double *acceleration, const double *settings, double *state, int64_t room,
                              double *u_out, double *feed_out)
{
    const Path path = {breaks, coefficients, pieces - 1, dim, powers, rational};
    const Path error_path = {error_breaks, error_coefficients, error_pieces - 1, error_dim, error_powers, error_rational};
    double first[MOST_AXES], second[MOST_AXES];
    Chord chord;
    int64_t code = RUNNING, count = 0;
    double u = state[U], tiny = state[TINY_STEPS];
    int64_t piece = (int64_t)state[PIECE], error_piece = (int64_t)state[ERROR_PIECE];
    while (count < room) {
        piece = derivatives(&path, u, piece, first, second);
        const double speed = sqrt(dot(first, first, dim));
        state[SPEED] = speed;
        state[THETA] = 1.0;
        if (!(speed > settings[SINGULAR_SPEED] && speed < INFINITY)) {
            code = SINGULAR;
            break;
        }
        const double feed = driving_feed(settings, u, first, second, dim, velocity, acceleration);
        if (settings[WRONG_BEND] > 0.0)
            add_wrong_bend(u, settings[WRONG_BEND], second);
        double du = taylor_step_of(settings, settings[PERIOD] * feed, speed, first, second, dim);
        if (settings[ALGORITHM] >= 2.0 && du < INFINITY) {
            begin_chord(&chord, &error_path, u, error_piece);
            error_piece = chord.piece;
            code = hold_chord_error(&chord, settings, &du, &state[THETA]);
        }
        state[DU] = du;
        if (code == RUNNING)
            code = stalled(u, du, &tiny);
        if (code != RUNNING)
            break;
        u += du;
        u_out[count] = u;
        feed_out[count++] = feed;
        if (u >= 1.0) {
            code = DONE;
            break;
        }
    }
    state[U] = u;
    state[PIECE] = (double)piece;
    state[ERROR_PIECE] = (double)error_piece;
    state[TINY_STEPS] = tiny;
    state[COUNT] = (double)count;
    return code;
}

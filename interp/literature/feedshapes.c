/* Feed shapes of 2002: a trapezoid, exponentials, a bell; and the Taylor steps that follow one. */
#include "interp/literature/literature.h"

#include "interp/taylor_inline.h"

/* Indices into a shape, and which it may be. */
enum { WHICH, FEED, RAMP, FALL, END, RATE };
enum { TRAPEZOID, EXPONENTIAL, BELL };

static const double PI = 3.14159265358979323846;

/* Feed, mm/s, and acceleration, mm/s^2. */
typedef struct {
    double v, a;
} Motion;

static Motion exponential(const double *shape, double t)
{
    const double feed = shape[FEED], fall = shape[FALL], rate = shape[RATE];
    if (t < fall) {
        const double left = exp(-rate * t);
        return (Motion){feed * (1.0 - left), feed * rate * left};
    }
    const double left = feed * (1.0 - exp(-rate * fall)) * exp(-rate * (t - fall));
    return (Motion){left, -rate * left};
}

/* Feed and acceleration of a shape at time t; a jump takes its value after it. */
static Motion shape_at(const double *shape, double t)
{
    const double feed = shape[FEED], ramp = shape[RAMP];
    if (t < 0.0 || t >= shape[END])
        return (Motion){0.0, 0.0};
    if (shape[WHICH] == EXPONENTIAL)
        return exponential(shape, t);
    const int rising = t < ramp;
    if (!rising && t < shape[FALL])
        return (Motion){feed, 0.0};
    const double x = rising ? t / ramp : (shape[END] - t) / ramp;
    const double sign = rising ? 1.0 : -1.0;
    if (shape[WHICH] == BELL)
        return (Motion){0.5 * feed * (1.0 - cos(PI * x)), sign * 0.5 * feed * PI / ramp * sin(PI * x)};
    return (Motion){feed * x, sign * feed / ramp};
}

void feedshape_feed(const double *shape, int64_t count, const double *t, double *feed, double *acceleration)
{
    for (int64_t n = 0; n < count; n++) {
        const Motion motion = shape_at(shape, t[n]);
        feed[n] = motion.v;
        acceleration[n] = motion.a;
    }
}

void feedshape_run(int64_t order, const double *shape, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                   double period, double u_end, int64_t count, double *u, double *feed, double *acceleration,
                   double *positions)
{
    const Shape size = {dim, rows, powers};
    int64_t i = 0;
    double at = u[0];
    for (int64_t k = 0; k < count; k++) {
        i = piece_of(pieces, size, at, i);
        const double *piece = piece_at(pieces, size, i);
        u[k] = at;
        position(piece, size, local(piece, at), positions + k * dim);
        const Motion motion = shape_at(shape, (double)k * period);
        feed[k] = motion.v;
        acceleration[k] = motion.a;
        const Triple speeds = tip_speed(piece, size, at, order);
        if (speeds.first > 0.0)
            at = smaller(at + larger(taylor_series(order, period, speeds, motion.v, motion.a, 0.0), 0.0), u_end);
    }
}

/* The steps of the literature, which keep u and add to it what the plan's feed says: their error accumulates. */
#include "interp/interp.h"

#include "interp/taylor_inline.h"

/* What changes from sample to sample. */
typedef struct {
    double k;
    int64_t row, piece;
    double u;
} Sample;

/* Go to the sample after one, and write its position. */
static inline Sample next_sample(int64_t order, const double *feed, const double *pieces, const double *state, Shape shape,
                                 Sample at, double *out)
{
    const double u_end = state[U_END];
    at.k = smaller(at.k + 1.0, state[LAST]);
    if (at.k >= state[LAST]) {
        end_position(state, shape.dim, out);
        at.u = u_end;
        return at;
    }
    const Period period = period_of(state);
    const double before = at.k - 1.0;
    at.row = row_at(feed, FEED_WIDTH, period, before, 0.0, at.row);
    const double *c = feed + at.row * FEED_WIDTH;
    const double t = since(period, before, c[0]);
    const Triple speeds = tip_speed(piece_at(pieces, shape, at.piece), shape, at.u, order);
    double step = 0.0;
    if (speeds.first > 0.0)
        step = taylor_series(order, period.high + period.low, speeds, feed_at(c, t), acceleration_at(c, t), jerk_at(c, t));
    at.u = smaller(at.u + larger(step, 0.0), u_end);
    at.piece = piece_of(pieces, shape, at.u, at.piece);
    const double *piece = piece_at(pieces, shape, at.piece);
    position(piece, shape, local(piece, at.u), out);
    return at;
}

static inline Sample last_sample(const double *state)
{
    return (Sample){state[SAMPLE], (int64_t)state[SEGMENT], (int64_t)state[PIECE], state[PARAMETER]};
}

static inline void keep_sample(double *state, Sample at)
{
    state[SAMPLE] = at.k;
    state[SEGMENT] = (double)at.row;
    state[PIECE] = (double)at.piece;
    state[PARAMETER] = at.u;
}

/* Take count steps.  Called with a constant order, so that the compiler leaves out the terms that this order has not. */
static inline void run(const int64_t order, const double *feed, const double *pieces, double *state, int64_t count, double *u,
                       double *positions)
{
    const Shape shape = shape_of(state);
    Sample at = last_sample(state);
    for (int64_t n = 0; n < count; n++) {
        at = next_sample(order, feed, pieces, state, shape, at, positions + n * shape.dim);
        u[n] = at.u;
    }
    keep_sample(state, at);
}

void taylor_run(int64_t order, const double *feed, const double *pieces, double *state, int64_t count, double *u,
                double *positions)
{
    if (order == 1)
        run(1, feed, pieces, state, count, u, positions);
    else if (order == 2)
        run(2, feed, pieces, state, count, u, positions);
    else
        run(3, feed, pieces, state, count, u, positions);
    keep_position(state, shape_of(state).dim, positions, count);
}

int64_t taylor_step(int64_t order, const double *feed, const double *pieces, double *state)
{
    const Shape shape = shape_of(state);
    const Sample at = next_sample(order, feed, pieces, state, shape, last_sample(state), state + STATE_END + shape.dim);
    keep_sample(state, at);
    return at.k >= state[LAST];
}

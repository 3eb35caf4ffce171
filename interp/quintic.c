/* The step that follows a plan: it has no error to accumulate. */
#include "interp/interp.h"

#include "interp/step_inline.h"

enum { SEGMENT_WIDTH = 8 };

/* What changes from sample to sample. */
typedef struct {
    double k;
    int64_t segment;
    double u;
} Sample;

/* Go to the sample after one, and write its position. */
static inline Sample next_sample(const double *segments, const double *pieces, const double *state, Shape shape,
                                 Period period, Sample at, double *out)
{
    const double u_end = state[U_END];
    at.k = smaller(at.k + 1.0, state[LAST]);
    if (at.k >= state[LAST]) {
        end_position(state, shape.dim, out);
        at.u = u_end;
        return at;
    }
    at.segment = row_at(segments, SEGMENT_WIDTH, period, at.k, at.segment);
    const double *c = segments + at.segment * SEGMENT_WIDTH;
    const double t = since(period, at.k, c[0]);
    double w = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))));
    w = smaller(larger(w, 0.0), 1.0);
    const double *piece = piece_at(pieces, shape, (int64_t)c[7]);
    position(piece, shape, w, out);
    /* A rounding must not report a parameter that falls back, or one beyond the end. */
    at.u = smaller(larger(piece[0] + piece[1] * w, at.u), u_end);
    return at;
}

static inline Sample last_sample(const double *state)
{
    return (Sample){state[SAMPLE], (int64_t)state[SEGMENT], state[PARAMETER]};
}

static inline void keep_sample(double *state, Sample at)
{
    state[SAMPLE] = at.k;
    state[SEGMENT] = (double)at.segment;
    state[PARAMETER] = at.u;
}

int64_t quintic_step(const double *segments, const double *pieces, double *state)
{
    const Shape shape = shape_of(state);
    const Sample at = next_sample(segments, pieces, state, shape, period_of(state), last_sample(state),
                                  state + STATE_END + shape.dim);
    keep_sample(state, at);
    return at.k >= state[LAST];
}

void quintic_run(const double *segments, const double *pieces, double *state, int64_t count, double *u, double *positions)
{
    const Shape shape = shape_of(state);
    const Period period = period_of(state);
    Sample at = last_sample(state);
    for (int64_t n = 0; n < count; n++) {
        at = next_sample(segments, pieces, state, shape, period, at, positions + n * shape.dim);
        u[n] = at.u;
    }
    keep_sample(state, at);
    keep_position(state, shape.dim, positions, count);
}

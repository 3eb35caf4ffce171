/* The step that follows a plan: it has no error to accumulate. */
#include "interp/interp.h"

#include "interp/step_inline.h"

#include <stddef.h>
#include <string.h>

/* Samples of which a run takes the points at once. */
enum { TOGETHER = 8 };

/* What changes from sample to sample. */
typedef struct {
    double k;
    int64_t segment;
    double u;
} Sample;

/* Where on the curve a sample is: its piece, and the local parameter there.  The last one has none: it is the end. */
typedef struct {
    const double *piece;
    double w;
} Place;

/* Go to the sample after one, and say where that is. */
static inline Place next_place(const double *segments, const double *pieces, const double *state, Shape shape, Period period,
                               Sample *at)
{
    const double u_end = state[U_END];
    at->k = within(at->k + 1.0, 0.0, state[LAST]);
    if (at->k >= state[LAST]) {
        at->u = u_end;
        return (Place){NULL, 0.0};
    }
    at->segment = row_at(segments, SEGMENT_WIDTH, period, at->k, 0.0, at->segment);
    const double *segment = segments + at->segment * SEGMENT_WIDTH;
    const double w = local_parameter(segment, since(period, at->k, segment[0]));
    const double *piece = piece_at(pieces, shape, (int64_t)segment[7]);
    at->u = forward_parameter(piece, w, at->u, u_end);
    return (Place){piece, w};
}

static inline void put_point(const double *state, Shape shape, Place place, double *out)
{
    if (place.piece)
        position(place.piece, shape, place.w, out);
    else
        end_position(state, shape.dim, out);
}

static inline int on_one_piece(const Place *places)
{
    int same = places[0].piece != NULL;
    for (int i = 1; i < TOGETHER; i++)
        same &= places[i].piece == places[0].piece;
    return same;
}

/* Numbers of as many samples side by side, two in a register: every processor has that. */
typedef double Two __attribute__((vector_size(16)));

typedef struct {
    Two a, b, c, d;
} Numbers;

static inline void horner_together(const double *row, int64_t powers, const Numbers *w, Numbers *out)
{
    const Two first = {row[0], row[0]};
    Two a = first, b = first, c = first, d = first;
    for (int64_t n = 1; n < powers; n++) {
        const Two next = {row[n], row[n]};
        a = a * w->a + next;
        b = b * w->b + next;
        c = c * w->c + next;
        d = d * w->d + next;
    }
    *out = (Numbers){a, b, c, d};
}

/* Write points of one piece: out (TOGETHER, dim).  Each has the bits of position(): the samples stand side by side, and none
   waits for another. */
static inline void positions_together(Shape shape, const Place *places, double *out)
{
    const int64_t dim = shape.dim, powers = shape.powers;
    const double *piece = places[0].piece;
    double each[TOGETHER];
    Numbers w, value, scale = {{1.0, 1.0}, {1.0, 1.0}, {1.0, 1.0}, {1.0, 1.0}};
    for (int i = 0; i < TOGETHER; i++)
        each[i] = places[i].w;
    memcpy(&w, each, sizeof w);
    if (shape.rows > dim + 1) {
        horner_together(piece + (dim + 1) * powers, powers, &w, &value);
        scale = (Numbers){scale.a / value.a, scale.b / value.b, scale.c / value.c, scale.d / value.d};
    }
    for (int64_t j = 0; j < dim; j++) {
        horner_together(piece + (j + 1) * powers, powers, &w, &value);
        value = (Numbers){scale.a * value.a, scale.b * value.b, scale.c * value.c, scale.d * value.d};
        memcpy(each, &value, sizeof each);
        for (int i = 0; i < TOGETHER; i++)
            out[i * dim + j] = each[i];
    }
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
    Sample at = last_sample(state);
    const Place place = next_place(segments, pieces, state, shape, period_of(state), &at);
    put_point(state, shape, place, state + STATE_END + shape.dim);
    keep_sample(state, at);
    return at.k >= state[LAST];
}

void quintic_run(const double *segments, const double *pieces, double *state, int64_t count, double *u, double *positions)
{
    const Shape shape = shape_of(state);
    const Period period = period_of(state);
    Sample at = last_sample(state);
    Place places[TOGETHER];
    for (int64_t first = 0; first < count; first += TOGETHER) {
        const int64_t some = count - first < TOGETHER ? count - first : TOGETHER;
        double *out = positions + first * shape.dim;
        for (int64_t i = 0; i < some; i++) {
            places[i] = next_place(segments, pieces, state, shape, period, &at);
            u[first + i] = at.u;
        }
        if (some == TOGETHER && on_one_piece(places))
            positions_together(shape, places, out);
        else
            for (int64_t i = 0; i < some; i++)
                put_point(state, shape, places[i], out + i * shape.dim);
    }
    keep_sample(state, at);
    keep_position(state, shape.dim, positions, count);
}

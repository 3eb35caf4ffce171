/* What every step reads: its state, the time since a row of a table began, and the point of a curve piece. */
#ifndef FEEDPLAN_STEP_INLINE_H
#define FEEDPLAN_STEP_INLINE_H

#include <stdint.h>

/* Indices into the state. */
enum {
    SAMPLE,      /* number k of the last sample */
    SEGMENT,     /* row of the segments, or of the feed, that holds its time */
    PIECE,       /* curve piece that holds its parameter (Taylor only: a segment knows its piece) */
    PARAMETER,   /* its curve parameter u */
    PERIOD_HIGH, /* leading 20 bits of the period T, s: times k they are exact up to k = 2^33 */
    PERIOD_LOW,  /* the rest of T */
    LAST,        /* number of the last sample, at the end of the path */
    U_END,       /* parameter there */
    DIM,         /* number of machine axes */
    ROWS,        /* rows of a curve piece */
    POWERS,      /* coefficients of a row */
    STATE_END    /* DIM numbers: the position at the end of the path; behind them, DIM numbers: the last sample */
};

/* A segment of the time law: its start time, a quintic, and the number of its curve piece. */
enum { SEGMENT_WIDTH = 8 };

/* Sizes of the curve pieces. */
typedef struct {
    int64_t dim, rows, powers;
} Shape;

/* The period in two parts, s. */
typedef struct {
    double high, low;
} Period;

static inline Shape shape_of(const double *state)
{
    return (Shape){(int64_t)state[DIM], (int64_t)state[ROWS], (int64_t)state[POWERS]};
}

static inline Period period_of(const double *state)
{
    return (Period){state[PERIOD_HIGH], state[PERIOD_LOW]};
}

/* Time k T - start, s, without the rounding of k T: k times the high part is exact and close to start. */
static inline double since(Period period, double k, double start)
{
    return (k * period.high - start) + k * period.low;
}

/* x, or the nearer of the two ends; x where it is not a number. */
static inline double within(double x, double lo, double hi)
{
    x = lo > x ? lo : x;
    return hi < x ? hi : x;
}

/* Row that holds the time k T + behind; rows stand width numbers apart, and the one before held row i. */
static inline int64_t row_at(const double *rows, int64_t width, Period period, double k, double behind, int64_t i)
{
    while (since(period, k, rows[(i + 1) * width]) + behind >= 0.0)
        i++;
    return i;
}

/* Local parameter of the curve piece, t seconds after its segment began. */
static inline double local_parameter(const double *segment, double t)
{
    const double *c = segment;
    return within(c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6])))), 0.0, 1.0);
}

static inline const double *piece_at(const double *pieces, Shape shape, int64_t piece)
{
    return pieces + piece * shape.rows * shape.powers;
}

/* Piece that holds a parameter not before that of the given piece. */
static inline int64_t piece_of(const double *pieces, Shape shape, double u, int64_t piece)
{
    while (u >= piece_at(pieces, shape, piece + 1)[0])
        piece++;
    return piece;
}

/* Curve parameter at a local one.  A rounding must not report one that falls back behind that of the sample before, or one
   beyond the end. */
static inline double forward_parameter(const double *piece, double w, double before, double u_end)
{
    return within(piece[0] + piece[1] * w, before, u_end);
}

static inline double horner(const double *row, int64_t powers, double w)
{
    double value = row[0];
    for (int64_t n = 1; n < powers; n++)
        value = value * w + row[n];
    return value;
}

/* Write the point of a piece at its local parameter w: out (dim).  Two axes at a time: neither waits for the other. */
static inline void position(const double *piece, Shape shape, double w, double *out)
{
    const int64_t dim = shape.dim, powers = shape.powers;
    double scale = 1.0;
    if (shape.rows > dim + 1)
        scale = 1.0 / horner(piece + (dim + 1) * powers, powers, w);
    const double *row = piece + powers;
    int64_t j = 0;
    for (; j + 1 < dim; j += 2, row += 2 * powers) {
        double a = row[0], b = row[powers];
        for (int64_t n = 1; n < powers; n++) {
            a = a * w + row[n];
            b = b * w + row[powers + n];
        }
        out[j] = scale * a;
        out[j + 1] = scale * b;
    }
    if (j < dim)
        out[j] = scale * horner(row, powers, w);
}

/* Write the end of the path: out (dim). */
static inline void end_position(const double *state, int64_t dim, double *out)
{
    for (int64_t j = 0; j < dim; j++)
        out[j] = state[STATE_END + j];
}

/* Put the last of count positions into the state. */
static inline void keep_position(double *state, int64_t dim, const double *positions, int64_t count)
{
    for (int64_t j = 0; count > 0 && j < dim; j++)
        state[STATE_END + dim + j] = positions[(count - 1) * dim + j];
}

#endif

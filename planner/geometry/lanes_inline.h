/* Four points at once: the formulas of curve_inline.h and differential_inline.h in vectors, the same operations in the same
 * order, so that every lane has the bits of the single point.
 *
 * The vectors are those that GCC and Clang have in C; where the processor has none so wide they are made of narrower ones. */
#ifndef PLANNER_GEOMETRY_LANES_INLINE_H
#define PLANNER_GEOMETRY_LANES_INLINE_H

#include "planner/geometry/curve_inline.h"

enum { LANES = 4, MOST_AXES = 9 };

typedef double Lanes __attribute__((vector_size(8 * LANES)));
/* All bits of a lane set where something is true of it. */
typedef int64_t Mask __attribute__((vector_size(8 * LANES)));

/* Into every version of a HOT function, or its vectors are not what that processor has. */
#define INLINE static inline __attribute__((always_inline))

/* No functions: vectors are passed in other ways by processors that have them and by those that do not. */
#define CHOOSE(mask, a, b) ((Lanes)(((Mask)(a) & (mask)) | ((Mask)(b) & ~(mask))))
#define LARGER(a, b) CHOOSE((b) > (a), b, a)
#define SMALLER(a, b) CHOOSE((b) < (a), b, a)
#define ABSOLUTE(a) ((Lanes)((Mask)(a) & INT64_MAX))
/* Element k of the row of each lane; and the rows themselves, the i-th of those of a size in each lane. */
#define LANES_OF(row, k) {(row)[0][k], (row)[1][k], (row)[2][k], (row)[3][k]}
#define LANES_AT(rows, i, size)                                                                                        \
    {(rows) + (i)[0] * (size), (rows) + (i)[1] * (size), (rows) + (i)[2] * (size), (rows) + (i)[3] * (size)}

INLINE void take_root(Lanes *a)
{
    const Lanes of = *a;
    *a = (Lanes){sqrt(of[0]), sqrt(of[1]), sqrt(of[2]), sqrt(of[3])};
}

/* Derivatives 0..3 over u of every coordinate. */
typedef Lanes LaneMotions[4][MOST_AXES];

typedef struct {
    Lanes c0, c1, c2, c3;
} LaneTaylor;

typedef struct {
    Lanes first, second, third;
} LaneTriple;

/* Horner's scheme with Taylor coefficients, of the polynomial from each row on; shared: all rows are one. */
INLINE void lanes_expand(const double *const row[LANES], int shared, int64_t terms, const Lanes *at, LaneTaylor *out)
{
    const Lanes zero = {0.0}, w = *at;
    LaneTaylor b = {LANES_OF(row, terms - 1), zero, zero, zero};
    for (int64_t k = terms - 2; k >= 0; k--) {
        const Lanes c = shared ? row[0][k] - zero : (Lanes)LANES_OF(row, k);
        b.c3 = b.c3 * w + b.c2;
        b.c2 = b.c2 * w + b.c1;
        b.c1 = b.c1 * w + b.c0;
        b.c0 = b.c0 * w + c;
    }
    *out = b;
}

/* As point_on_pieces, on the pieces that are found; shared: all are one. */
INLINE void lanes_on_found(const Pieces *pieces, const Lanes *u, const int64_t *piece, int shared, LaneMotions q)
{
    const int64_t dim = pieces->dim, terms = pieces->terms, size = (dim + 1) * terms;
    const double *const breaks[LANES] = LANES_AT(pieces->breaks, piece, 1);
    const double *const coefficients[LANES] = LANES_AT(pieces->coefficients, piece, size);
    const double *const origins[LANES] = LANES_AT(pieces->origin, piece, dim);
    const uint8_t *const resting[LANES] = LANES_AT(pieces->resting, piece, dim);
    const Lanes begin = LANES_OF(breaks, 0), end = LANES_OF(breaks, 1), width = end - begin;
    const Lanes scale = 1.0 / width, w = (*u - begin) / width;
    LaneTaylor v = {{0.0}, {0.0}, {0.0}, {0.0}};
    if (pieces->rational) {
        const double *const row[LANES] = LANES_AT(pieces->coefficients + dim * terms, piece, size);
        lanes_expand(row, shared, terms, &w, &v);
        v.c0 = 1.0 / v.c0;
    }
    for (int64_t j = 0; j < dim; j++) {
        const double *const row[LANES] = {coefficients[0] + j * terms, coefficients[1] + j * terms,
                                          coefficients[2] + j * terms, coefficients[3] + j * terms};
        LaneTaylor c;
        lanes_expand(row, shared, terms, &w, &c);
        if (pieces->rational) {
            c.c0 *= v.c0;
            c.c1 = (c.c1 - v.c1 * c.c0) * v.c0;
            c.c2 = (c.c2 - v.c1 * c.c1 - v.c2 * c.c0) * v.c0;
            c.c3 = (c.c3 - v.c1 * c.c2 - v.c2 * c.c1 - v.c3 * c.c0) * v.c0;
        }
        const Mask rests = LANES_OF(resting, j), moves = rests - 1;
        q[0][j] = (Lanes)LANES_OF(origins, j) + c.c0;
        q[1][j] = (Lanes)((Mask)c.c1 & moves) * scale;
        q[2][j] = 2.0 * (Lanes)((Mask)c.c2 & moves) * scale * scale;
        q[3][j] = 6.0 * (Lanes)((Mask)c.c3 & moves) * scale * scale * scale;
    }
}

/* Write the derivatives of a curve at u, from the left where left says so; piece: those to be tried first, and those found. */
INLINE void lanes_on_pieces(const Pieces *pieces, const Lanes *at, const Mask *from_left, int64_t *restrict piece,
                            LaneMotions q)
{
    const Lanes u = *at;
    const Mask left = *from_left;
    const double begin = pieces->breaks[piece[0]], end = pieces->breaks[piece[0] + 1];
    const Mask within = ((u > begin) & (u < end)) | ((u == begin) & ~left) | ((u == end) & left);
    if ((within[0] & within[1] & within[2] & within[3]) != 0) {
        for (int l = 1; l < LANES; l++)
            piece[l] = piece[0];
        lanes_on_found(pieces, at, piece, 1, q);
        return;
    }
    for (int l = 0; l < LANES; l++)
        piece[l] = find_piece(pieces->count, pieces->breaks, u[l], left[l] != 0, piece[l]);
    lanes_on_found(pieces, at, piece, 0, q);
}

INLINE void lanes_chain_rule(const LaneMotions q, int64_t j, const LaneTriple *u, LaneTriple *out)
{
    const Lanes u1 = u->first, u2 = u->second, u3 = u->third;
    out->first = q[1][j] * u1;
    out->second = q[2][j] * (u1 * u1) + q[1][j] * u2;
    out->third = q[3][j] * (u1 * u1 * u1) + q[2][j] * (3.0 * u1 * u2) + q[1][j] * u3;
}

/* |C'|, and its derivatives where it is not 0; also its square. */
INLINE void lanes_speeds(const LaneMotions q, int64_t dim, LaneTriple *out, Lanes *squared)
{
    Lanes dot11 = {0.0}, dot12 = {0.0}, dot13 = {0.0}, dot22 = {0.0};
    for (int64_t j = 0; j < dim; j++) {
        dot11 += q[1][j] * q[1][j];
        dot12 += q[1][j] * q[2][j];
        dot13 += q[1][j] * q[3][j];
        dot22 += q[2][j] * q[2][j];
    }
    *squared = out->first = dot11;
    take_root(&out->first);
    out->second = dot12 / out->first;
    out->third = (dot22 + dot13 - out->second * out->second) / out->first;
}

INLINE void lanes_rates_along(const LaneTriple *s, const LaneTriple *u, LaneTriple *out)
{
    const Lanes u1 = u->first, u2 = u->second, u3 = u->third;
    const Mask moves = s->first > 0.0;
    out->first = s->first * u1;
    out->second = (Lanes)((Mask)(s->first * u2 + s->second * (u1 * u1)) & moves);
    out->third = (Lanes)((Mask)(s->first * u3 + s->second * (3.0 * u1 * u2) + s->third * (u1 * u1 * u1)) & moves);
}

#endif

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
#define ANY(mask) (((mask)[0] | (mask)[1] | (mask)[2] | (mask)[3]) != 0)

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

/* Horner's scheme with Taylor coefficients, of the polynomial from each row on. */
INLINE void lanes_expand(const double *const row[LANES], int64_t terms, const Lanes *w, LaneTaylor *out)
{
    const Lanes zero = {0.0}, at = *w;
    LaneTaylor b = {{row[0][terms - 1], row[1][terms - 1], row[2][terms - 1], row[3][terms - 1]}, zero, zero, zero};
    for (int64_t k = terms - 2; k >= 0; k--) {
        const Lanes c = {row[0][k], row[1][k], row[2][k], row[3][k]};
        b.c3 = b.c3 * at + b.c2;
        b.c2 = b.c2 * at + b.c1;
        b.c1 = b.c1 * at + b.c0;
        b.c0 = b.c0 * at + c;
    }
    *out = b;
}

/* Write the derivatives of a curve at u, from the left where left says so; piece: those to be tried first, and those found. */
INLINE void lanes_on_pieces(const Pieces *pieces, const Lanes *u, const Mask *left, int64_t *restrict piece,
                            LaneMotions q)
{
    const int64_t dim = pieces->dim, terms = pieces->terms;
    const double *row[LANES];
    Lanes begin, width;
    for (int l = 0; l < LANES; l++) {
        piece[l] = find_piece(pieces->count, pieces->breaks, (*u)[l], (*left)[l] != 0, piece[l]);
        begin[l] = pieces->breaks[piece[l]];
        width[l] = pieces->breaks[piece[l] + 1] - begin[l];
        row[l] = pieces->coefficients + piece[l] * (dim + 1) * terms;
    }
    const Lanes scale = 1.0 / width, w = (*u - begin) / width;
    LaneTaylor v = {{0.0}, {0.0}, {0.0}, {0.0}};
    if (pieces->rational) {
        const double *last[LANES];
        for (int l = 0; l < LANES; l++)
            last[l] = row[l] + dim * terms;
        lanes_expand(last, terms, &w, &v);
        v.c0 = 1.0 / v.c0;
    }
    for (int64_t j = 0; j < dim; j++) {
        LaneTaylor c;
        lanes_expand(row, terms, &w, &c);
        if (pieces->rational) {
            c.c0 *= v.c0;
            c.c1 = (c.c1 - v.c1 * c.c0) * v.c0;
            c.c2 = (c.c2 - v.c1 * c.c1 - v.c2 * c.c0) * v.c0;
            c.c3 = (c.c3 - v.c1 * c.c2 - v.c2 * c.c1 - v.c3 * c.c0) * v.c0;
        }
        Lanes origin;
        Mask moves;
        for (int l = 0; l < LANES; l++) {
            origin[l] = pieces->origin[piece[l] * dim + j];
            moves[l] = (int64_t)pieces->resting[piece[l] * dim + j] - 1;
            row[l] += terms;
        }
        q[0][j] = origin + c.c0;
        q[1][j] = (Lanes)((Mask)c.c1 & moves) * scale;
        q[2][j] = 2.0 * (Lanes)((Mask)c.c2 & moves) * scale * scale;
        q[3][j] = 6.0 * (Lanes)((Mask)c.c3 & moves) * scale * scale * scale;
    }
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

/* A curve as polynomial pieces, for compiled code that evaluates it at one point after another.
 *
 * Pieces (m of them) are plain arrays: breaks (m + 1), coefficients (m, d + 1, terms) and origin (m, d).  On piece i,
 * with the local parameter w = (u - breaks[i]) / (breaks[i + 1] - breaks[i]) in [0, 1], coordinate j is origin[i, j]
 * and the ratio of two polynomials in w, coefficients[i, j, :] over coefficients[i, d, :] (ascending powers).  Where
 * the curve is polynomial the denominator is not looked at.  resting (m, d) says which coordinates have one value all
 * over a piece.
 *
 * A denominator that underflows to 0 gives inf or nan, which the curve's own validation finds.
 */
#ifndef PLANNER_GEOMETRY_CURVE_INLINE_H
#define PLANNER_GEOMETRY_CURVE_INLINE_H

#include "planner/core.h"

typedef struct {
    int64_t count, dim, terms; /* pieces, coordinates, coefficients of a polynomial */
    const double *breaks, *coefficients, *origin;
    const uint8_t *resting;
    int rational;
} Pieces;

/* Value and first three derivatives of a polynomial with respect to w, over 0!, 1!, 2! and 3!. */
typedef struct {
    double c0, c1, c2, c3;
} Taylor;

/* Index i with breaks[i] <= u < breaks[i + 1] (left: breaks[i] < u <= breaks[i + 1]), trying guess first; the first or
 * the last of the count pieces beyond the ends. */
static inline int64_t find_piece(int64_t count, const double *breaks, double u, int left, int64_t guess)
{
    if (0 <= guess && guess < count) {
        const double begin = breaks[guess], end = breaks[guess + 1];
        if (left ? begin < u && u <= end : begin <= u && u < end)
            return guess;
    }
    int64_t lo = 0, hi = count;
    while (hi - lo > 1) {
        const int64_t mid = (lo + hi) / 2;
        if (breaks[mid] < u || (!left && breaks[mid] == u))
            lo = mid;
        else
            hi = mid;
    }
    return lo;
}

/* Horner's scheme with Taylor coefficients. */
static inline Taylor expand(const double *coefficients, int64_t terms, double w)
{
    Taylor b = {coefficients[terms - 1], 0.0, 0.0, 0.0};
    for (int64_t k = terms - 2; k >= 0; k--) {
        b.c3 = b.c3 * w + b.c2;
        b.c2 = b.c2 * w + b.c1;
        b.c1 = b.c1 * w + b.c0;
        b.c0 = b.c0 * w + coefficients[k];
    }
    return b;
}

/* Write the curve at one parameter, to the bits of point_on_pieces; returns the piece, to be tried first next. */
static inline int64_t place_on_pieces(const Pieces *pieces, double u, int left, int64_t guess, double *restrict out)
{
    const int64_t dim = pieces->dim, terms = pieces->terms;
    const int64_t piece = find_piece(pieces->count, pieces->breaks, u, left, guess);
    const double begin = pieces->breaks[piece], width = pieces->breaks[piece + 1] - begin, w = (u - begin) / width;
    const double *row = pieces->coefficients + piece * (dim + 1) * terms;
    double per = 1.0;
    for (int64_t j = pieces->rational ? dim : dim - 1; j >= 0; j--) { /* the denominator first */
        double value = row[j * terms + terms - 1];
        for (int64_t k = terms - 2; k >= 0; k--)
            value = value * w + row[j * terms + k];
        if (j == dim)
            per = 1.0 / value;
        else
            out[j] = pieces->origin[piece * dim + j] + (pieces->rational ? value * per : value);
    }
    return piece;
}

/* Write the derivatives 0..order (at most 3) of the curve at one parameter, the k-th from out[k * stride] on; returns
 * the piece, to be tried first next.
 *
 * After Horner on each coordinate the quotient rule: with numerator N, denominator D, C = N/D from the origin and the
 * coefficients N_k = N^(k)/k!,  D C_k = N_k - sum_{i=1..k} D_i C_(k-i). */
static inline int64_t point_on_pieces(const Pieces *pieces, double u, int left, int64_t guess, int64_t order,
                                      int64_t stride, double *restrict out)
{
    const int64_t dim = pieces->dim, terms = pieces->terms;
    const int64_t piece = find_piece(pieces->count, pieces->breaks, u, left, guess);
    const double begin = pieces->breaks[piece], width = pieces->breaks[piece + 1] - begin;
    const double scale = 1.0 / width, w = (u - begin) / width;
    const double *row = pieces->coefficients + piece * (dim + 1) * terms;
    Taylor v = {1.0, 0.0, 0.0, 0.0};
    if (pieces->rational) {
        v = expand(row + dim * terms, terms, w);
        v.c0 = 1.0 / v.c0;
    }
    for (int64_t j = 0; j < dim; j++, row += terms) {
        Taylor c = expand(row, terms, w);
        if (pieces->rational) {
            c.c0 *= v.c0;
            c.c1 = (c.c1 - v.c1 * c.c0) * v.c0;
            c.c2 = (c.c2 - v.c1 * c.c1 - v.c2 * c.c0) * v.c0;
            c.c3 = (c.c3 - v.c1 * c.c2 - v.c2 * c.c1 - v.c3 * c.c0) * v.c0;
        }
        if (pieces->resting[piece * dim + j])
            /* The quotient rule leaves rounding where a coordinate rests, and a direction made of rounding is none. */
            c.c1 = c.c2 = c.c3 = 0.0;
        out[j] = pieces->origin[piece * dim + j] + c.c0;
        if (order > 0)
            out[stride + j] = c.c1 * scale;
        if (order > 1)
            out[2 * stride + j] = 2.0 * c.c2 * scale * scale;
        if (order > 2)
            out[3 * stride + j] = 6.0 * c.c3 * scale * scale * scale;
    }
    return piece;
}

#endif

/* Algorithms 2 to 4 (2022): the chord error of a step, and the longest step within a tolerance. */
#ifndef FEEDPLAN_GREEDY_CHORD_INLINE_H
#define FEEDPLAN_GREEDY_CHORD_INLINE_H

#include "interp/literature/greedy_inline.h"

enum {
    SUBDIVISIONS = 20, /* of a chord: 19 inner points, as published; the lane of its end fills a vector */
    INNER = SUBDIVISIONS - 1,
    SMALL_STEPS = 5,
    SOLVER_PASSES = 80
};

static const double MAX_STEP = 0.1, MIN_STEP = 1e-12;
static const double PUSH_UP = 0.999;     /* share of the tolerance that Algorithm 4 pushes to */
static const double ROOT_WINDOW = 1e-6;  /* of the tolerance */

/* A chord that begins at start = C(u) on a piece; end takes the chord, from its start, inner its inner points. */
typedef struct {
    const Path *path;
    double u;
    int64_t piece;
    double start[MOST_AXES], end[MOST_AXES], inner[MOST_AXES][SUBDIVISIONS];
} Chord;

/* A chord from u on; piece is where its path has been before. */
static inline void begin_chord(Chord *chord, const Path *path, double u, int64_t piece)
{
    chord->path = path;
    chord->u = u;
    chord->piece = point(path, u, piece, chord->start);
}

/* Write the inner points of a chord within one piece, side by side: the compiler turns that into vectors. */
static inline void inner_points_of_piece(Chord *chord, double du)
{
    const Path *path = chord->path;
    const double begin = path->breaks[chord->piece], width = path->breaks[chord->piece + 1] - begin;
    const double first = (chord->u - begin) / width, step = du / width / SUBDIVISIONS;
    double w[SUBDIVISIONS], scale[SUBDIVISIONS];
    for (int n = 0; n < SUBDIVISIONS; n++)
        w[n] = first + step * (n + 1);
    for (int64_t j = path->rational ? path->dim : path->dim - 1; j >= 0; j--) {
        const double *c = row_of(path, chord->piece, j);
        double *row = j == path->dim ? scale : chord->inner[j];
        double found[SUBDIVISIONS];
        for (int n = 0; n < SUBDIVISIONS; n++)
            found[n] = c[path->powers - 1];
        for (int64_t k = path->powers - 2; k >= 0; k--)
            for (int n = 0; n < SUBDIVISIONS; n++)
                found[n] = found[n] * w[n] + c[k];
        for (int n = 0; n < SUBDIVISIONS; n++)
            row[n] = path->rational && j < path->dim ? found[n] / scale[n] : found[n];
    }
}

/* Write the inner points of a chord; last is the piece of its end. */
static inline void inner_points(Chord *chord, double du, int64_t last)
{
    if (chord->piece == last) {
        inner_points_of_piece(chord, du);
        return;
    }
    int64_t piece = chord->piece;
    for (int n = 0; n < SUBDIVISIONS; n++) {
        double one[MOST_AXES];
        piece = point(chord->path, chord->u + du * ((double)(n + 1) / SUBDIVISIONS), piece, one);
        for (int64_t j = 0; j < chord->path->dim; j++)
            chord->inner[j][n] = one[j];
    }
}

/* |p x chord|^2 of the middle. */
static inline double middle_cross(const Chord *chord, double du)
{
    const int64_t dim = chord->path->dim;
    const double *start = chord->start, *end = chord->end;
    double middle[MOST_AXES];
    point(chord->path, chord->u + 0.5 * du, chord->piece, middle);
    double cross2 = 0.0;
    for (int64_t i = 0; i < dim; i++)
        for (int64_t j = i + 1; j < dim; j++)
            cross2 += square((middle[i] - start[i]) * end[j] - (middle[j] - start[j]) * end[i]);
    return cross2;
}

/* Largest |p x chord|^2 of the inner points; nan, where there is one. */
static inline double largest_cross(const Chord *chord)
{
    const int64_t dim = chord->path->dim;
    double cross2[SUBDIVISIONS] = {0.0};
    for (int64_t i = 0; i < dim; i++)
        for (int64_t j = i + 1; j < dim; j++) {
            const double *p = chord->inner[i], *q = chord->inner[j];
            for (int n = 0; n < SUBDIVISIONS; n++)
                cross2[n] += square((p[n] - chord->start[i]) * chord->end[j] - (q[n] - chord->start[j]) * chord->end[i]);
        }
    double worst = 0.0;
    for (int n = 0; n < INNER; n++)
        if (!(cross2[n] <= worst)) {
            worst = cross2[n];
            if (isnan(worst))
                break;
        }
    return worst;
}

/* Largest distance of the inner points from the chord over [u, u + du], or that of the middle if above stop: the middle is
   the worst, as a rule, so that most trials of a back-off end there.  |p x c| / |c| is exact for vertical chords too. */
static inline double chord_error(Chord *chord, double du, double stop)
{
    const int64_t dim = chord->path->dim;
    const int64_t last = point(chord->path, chord->u + du, chord->piece, chord->end);
    double chord2 = 0.0;
    for (int64_t j = 0; j < dim; j++) {
        chord->end[j] -= chord->start[j];
        chord2 += chord->end[j] * chord->end[j];
    }
    if (chord2 == 0.0)
        return 0.0;
    if (stop < INFINITY) {
        const double cross2 = middle_cross(chord, du);
        if (!(cross2 <= stop * stop * chord2)) /* nan, far beyond the end of a piece, counts as too large */
            return sqrt(cross2 / chord2);
    }
    inner_points(chord, du, last);
    return sqrt(largest_cross(chord) / chord2);
}

/* Largest step up to cap whose chord error is within the tolerance, to 1e-6 of it.

   The error grows as the square of the step, nearly; the next guess follows that law, and halves the bracket where that
   leaves it or takes long. */
static inline double step_to_tolerance(Chord *chord, double guess, double cap, double tolerance)
{
    double lo = 0.0, hi = INFINITY, x = smaller(guess, cap);
    for (int n = 0; n < SOLVER_PASSES; n++) {
        const double error = chord_error(chord, x, tolerance);
        if (error <= tolerance) {
            lo = x;
            if (x >= cap || error >= tolerance * (1.0 - ROOT_WINDOW))
                break;
        } else {
            hi = x;
        }
        if (hi < INFINITY && hi - lo <= 1e-10 * hi)
            break;
        x *= smaller(2.0, sqrt(tolerance * (1.0 - 0.5 * ROOT_WINDOW) / error));
        if (!(lo < x && x < hi) || (n > 8 && n % 2 == 0 && hi < INFINITY))
            x = 0.5 * (lo + hi);
        x = smaller(x, cap);
    }
    return lo;
}

/* Code for a step that leads nowhere, else RUNNING; counts the tiny steps in a row. */
static inline int64_t stalled(double u, double du, double *tiny)
{
    if (!(du > 0.0 && du < INFINITY))
        return NOT_FINITE;
    *tiny = du < MIN_STEP ? *tiny + 1.0 : 0.0;
    if (u + du == u || *tiny >= SMALL_STEPS)
        return NO_ADVANCE;
    return du > MAX_STEP ? TOO_LONG : RUNNING;
}

#endif

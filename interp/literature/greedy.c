/* What there is to know about the points of a greedy run. */
#include "interp/literature/literature.h"

#include "interp/literature/greedy_chord_inline.h"

HOT void greedy_chord_errors(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers,
                             int64_t rational, int64_t dim, int64_t count, const double *u, double *out)
{
    const Path path = {breaks, coefficients, pieces - 1, dim, powers, rational};
    Chord chord;
    int64_t piece = 0;
    for (int64_t k = 0; k + 1 < count; k++) {
        begin_chord(&chord, &path, u[k], piece);
        piece = chord.piece;
        out[k] = chord_error(&chord, u[k + 1] - u[k], INFINITY);
    }
}

/* The bound of the acceleration that the published program clips to, from the C'' that it has. */
static inline double published_bound(const double *second, int64_t dim, const double *acceleration)
{
    const double bend = sqrt(dot(second, second, dim));
    double bound = INFINITY;
    for (int64_t j = 0; j < dim; j++)
        bound = smaller(bound, acceleration[j] * bend / fabs(second[j]));
    return bound;
}

HOT void greedy_along(const double *breaks, const double *coefficients, int64_t pieces, int64_t powers, int64_t rational,
                      int64_t dim, int64_t count, const double *u, const double *feed, const double *velocity,
                      const double *acceleration, const double *settings, double *out)
{
    const Path path = {breaks, coefficients, pieces - 1, dim, powers, rational};
    double first[MOST_AXES], second[MOST_AXES];
    Chord chord;
    int64_t piece = 0;
    double before = 0.0;
    for (int64_t n = 0; n < count; n++) {
        piece = derivatives(&path, u[n], piece, first, second);
        const FeedLimits limits = feed_limits(first, second, dim, velocity, acceleration, settings[SAFETY]);
        const Range range = acceleration_range(first, second, dim, limits.speed, limits.along, feed ? feed[n] : before,
                                               acceleration);
        double *row = out + n * COLUMNS;
        row[AXIS_LIMIT] = limits.axis;
        row[NORMAL_LIMIT] = limits.normal;
        row[CURVATURE] = limits.curvature;
        row[SHAPE] = s_curve(u[n], settings);
        row[LOWEST] = range.lowest;
        row[HIGHEST] = range.highest;
        if (settings[WRONG_BEND] > 0.0)
            add_wrong_bend(u[n], settings[WRONG_BEND], second);
        row[PUBLISHED_BOUND] = published_bound(second, dim, acceleration);
        row[LENGTH] = row[ERROR] = 0.0;
        if (n + 1 < count) {
            begin_chord(&chord, &path, u[n], piece);
            row[ERROR] = chord_error(&chord, u[n + 1] - u[n], INFINITY);
            row[LENGTH] = sqrt(dot(chord.end, chord.end, dim));
            before = row[LENGTH] / settings[PERIOD];
        }
    }
}

#include "planner/core.h"
#include "planner/verify/peaks_inline.h"
#include "planner/verify/verify.h"

/* Squares of the distances of count points, points[j] (count) their coordinates j, from the segment from begin to end. */
static inline void squared_distances(int64_t dim, int64_t count, const double *begin, const double *end,
                                     const double *points, int64_t apart, double *restrict squared, double *restrict share)
{
    double length = 0.0;
    for (int64_t j = 0; j < dim; j++)
        length += square(end[j] - begin[j]);
    const double scale = length > 0.0 ? 1.0 / length : 0.0;
    for (int64_t k = 0; k < count; k++)
        share[k] = squared[k] = 0.0;
    for (int64_t j = 0; j < dim; j++)
        for (int64_t k = 0; k < count; k++)
            share[k] += (points[j * apart + k] - begin[j]) * (end[j] - begin[j]);
    for (int64_t k = 0; k < count; k++)
        share[k] = smaller(larger(share[k] * scale, 0.0), 1.0);
    for (int64_t j = 0; j < dim; j++)
        for (int64_t k = 0; k < count; k++)
            squared[k] += square(points[j * apart + k] - begin[j] - share[k] * (end[j] - begin[j]));
}

HOT void chord_heights(int64_t n, int64_t dim, int64_t stride, int64_t parts, const double *points, double *height,
                       int64_t *top, double *work)
{
    const int64_t count = parts + 1, total = (n - 1) * stride + count;
    double *coordinates = work, *squared = work + dim * total, *share = squared + count;
    for (int64_t j = 0; j < dim; j++)
        for (int64_t k = 0; k < total; k++)
            coordinates[j * total + k] = points[k * dim + j];
    for (int64_t i = 0; i < n; i++) {
        const double *begin = points + i * stride * dim;
        squared_distances(dim, count, begin, begin + parts * dim, coordinates + i * stride, total, squared, share);
        const int64_t here = highest(count, squared);
        for (int64_t k = here > 0 ? here - 1 : 0; k < count && k <= here + 1; k++) /* what the parabola takes */
            squared[k] = sqrt(squared[k]);
        top[i] = here;
        height[i] = peak(count, squared, here);
    }
}

HOT void chord_tops(int64_t n, int64_t chords, int64_t parts, int64_t dim, const double *points, double *height,
                    int64_t *top, double *work)
{
    double *coordinates = work, *squared = work + dim * parts, *share = squared + parts;
    for (int64_t i = 0; i < n; i++) {
        height[i] = -1.0;
        top[i] = 0;
        for (int64_t chord = 0; chord < chords; chord++) {
            const double *begin = points + (i * chords + chord) * (parts + 2) * dim, *between = begin + 2 * dim;
            for (int64_t j = 0; j < dim; j++)
                for (int64_t k = 0; k < parts; k++)
                    coordinates[j * parts + k] = between[k * dim + j];
            squared_distances(dim, parts, begin, begin + dim, coordinates, parts, squared, share);
            const int64_t here = highest(parts, squared);
            if (squared[here] > height[i]) {
                height[i] = squared[here];
                top[i] = chord * parts + here;
            }
        }
        height[i] = sqrt(height[i]);
    }
}

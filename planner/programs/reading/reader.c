#include "planner/programs/reading/reading.h"

#include "planner/core.h"

void reader_merge_short_moves(int64_t n, int64_t axes, const double *ends, const uint8_t *always, double threshold,
                              double *position, uint8_t *keep)
{
    for (int64_t i = 0; i < n; i++) {
        const double *end = ends + axes * i;
        double square = 0.0;
        for (int64_t j = 0; j < axes; j++)
            square += (end[j] - position[j]) * (end[j] - position[j]);
        keep[i] = always[i] || square >= threshold * threshold;
        if (keep[i])
            for (int64_t j = 0; j < axes; j++)
                position[j] = end[j];
    }
}

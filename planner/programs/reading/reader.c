#include "planner/programs/reading/reading.h"

#include "planner/core.h"

void reader_merge_short_moves(int64_t n, const double *ends, const uint8_t *always, double threshold, double *position,
                              uint8_t *keep)
{
    for (int64_t i = 0; i < n; i++) {
        const double *end = ends + 3 * i;
        const double dx = end[0] - position[0], dy = end[1] - position[1], dz = end[2] - position[2];
        keep[i] = always[i] || dx * dx + dy * dy + dz * dz >= threshold * threshold;
        if (keep[i])
            for (int j = 0; j < 3; j++)
                position[j] = end[j];
    }
}

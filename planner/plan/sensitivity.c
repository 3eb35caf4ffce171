/* Sums over the multipliers of an optimum: what each limit is worth, and whether the optimum is global. */
#include "planner/plan/plan.h"

#include "planner/core.h"

#include <string.h>

/* Points to a block of pairs, as in interior_inline.h. */
enum { BLOCK = 128 };

/* Multipliers of one side in a block of pairs (blocks, sides, 2, BLOCK). */
static inline const float *multipliers(const float *pairs, int64_t sides, int64_t block, int64_t side)
{
    return pairs + ((block * sides + side) * 2 + 1) * BLOCK;
}

static inline int64_t points_in(int64_t points, int64_t block)
{
    const int64_t left = points - block * BLOCK;
    return left < BLOCK ? left : BLOCK;
}

/* x^(-1/2) at the points of a block, by the cubics of the intervals. */
static void put_pace(int64_t intervals, const double *h, int64_t inner, const double *z, int64_t first, int64_t count,
                     double *pace)
{
    const int64_t stride = inner + 1;
    const double *x = z, *a = z + intervals + 1, *c = a + intervals + 1;
    for (int64_t i = 0; i < count; i++) {
        const int64_t k = (first + i) / stride, part = (first + i) % stride;
        double value = x[k];
        if (part > 0) {
            const double t = (double)part / (double)stride, far = t * t * t / 3.0;
            value = x[k] + 2.0 * t * h[k] * a[k] + h[k] * h[k] * ((t * t - far) * c[k] + far * c[k + 1]);
        }
        pace[i] = 1.0 / sqrt(value);
    }
}

HOT void sensitivity_sums(int64_t intervals, const double *h, int64_t inner, const double *z, int64_t accelerations,
                          int64_t rows, const float *pairs, const uint8_t *which, const float *power, double *by_speed,
                          double *by_row)
{
    const int64_t points = (inner + 1) * intervals + 1, sides = 2 * rows + 1;
    double pace[BLOCK];
    for (int64_t block = 0; block * BLOCK < points; block++) {
        const int64_t first = block * BLOCK, count = points_in(points, block);
        const float *speed = multipliers(pairs, sides, block, 0);
        for (int64_t i = 0; i < count; i++)
            by_speed[which[first + i]] += (double)speed[i] * (double)power[first + i];
        put_pace(intervals, h, inner, z, first, count, pace);
        for (int64_t r = 0; r < rows; r++) {
            const float *up = multipliers(pairs, sides, block, 1 + 2 * r);
            const float *down = multipliers(pairs, sides, block, 2 + 2 * r);
            /* four sums, so that the order is the same on every machine */
            double sum[4] = {0.0, 0.0, 0.0, 0.0};
            for (int64_t i = 0; i < count; i++)
                sum[i % 4] += ((double)up[i] + (double)down[i]) * (r < accelerations ? 1.0 : pace[i]);
            by_row[r] += (sum[0] + sum[1]) + (sum[2] + sum[3]);
        }
    }
}

int64_t sensitivity_proven(int64_t intervals, const double *h, int64_t inner, const double *weight,
                           int64_t accelerations, int64_t rows, const double *bounds, double room, const float *pairs)
{
    const int64_t points = (inner + 1) * intervals + 1, sides = 2 * rows + 1;
    double load = 0.0, most = 0.0, at[BLOCK];
    for (int64_t block = 0; block * BLOCK < points; block++) {
        const int64_t first = block * BLOCK, count = points_in(points, block);
        memset(at, 0, sizeof at);
        for (int64_t r = accelerations; r < rows; r++) {
            const float *up = multipliers(pairs, sides, block, 1 + 2 * r);
            const float *down = multipliers(pairs, sides, block, 2 + 2 * r);
            for (int64_t i = 0; i < count; i++)
                at[i] += bounds[2 * r] * up[i] + bounds[2 * r + 1] * down[i];
        }
        for (int64_t i = 0; i < count; i++) {
            const int64_t point = first + i;
            if (point > 0 && h[(point - 1) / (inner + 1)] > 0.0) {
                if (!(load <= most * (1.0 + room)))
                    return 0;
                load = most = 0.0;
            }
            load += at[i];
            most += weight[point];
        }
    }
    return load <= most * (1.0 + room);
}

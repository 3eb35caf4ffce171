/* The highest of a row of numbers. */
#ifndef PLANNER_VERIFY_PEAKS_INLINE_H
#define PLANNER_VERIFY_PEAKS_INLINE_H

#include "planner/core.h"

#define PEAK_LANES 4

/* Index of the highest, of equal ones the first. */
static inline int64_t highest(int64_t n, const double *heights)
{
    double top[PEAK_LANES];
    int64_t at[PEAK_LANES], k;
    if (n < 2 * PEAK_LANES) {
        int64_t best = 0;
        for (k = 1; k < n; k++)
            if (heights[k] > heights[best])
                best = k;
        return best;
    }
    /* Each lane keeps its own first highest; a chain of comparisons over all would wait for each of them. */
    for (int l = 0; l < PEAK_LANES; l++) {
        top[l] = heights[l];
        at[l] = l;
    }
    for (k = PEAK_LANES; k + PEAK_LANES <= n; k += PEAK_LANES)
        for (int l = 0; l < PEAK_LANES; l++) {
            const int more = heights[k + l] > top[l];
            top[l] = more ? heights[k + l] : top[l];
            at[l] = more ? k + l : at[l];
        }
    int64_t best = at[0];
    double most = top[0];
    for (int l = 1; l < PEAK_LANES; l++)
        if (top[l] > most || (top[l] == most && at[l] < best)) {
            most = top[l];
            best = at[l];
        }
    for (; k < n; k++)
        if (heights[k] > most) {
            most = heights[k];
            best = k;
        }
    return best;
}

/* Height of the highest point, or where it lies inside, of the parabola through it and its neighbours. */
static inline double peak(int64_t n, const double *heights, int64_t top)
{
    if (top > 0 && top < n - 1) {
        const double before = heights[top - 1], after = heights[top + 1];
        const double bend = before - 2.0 * heights[top] + after;
        if (-INFINITY < bend && bend < 0.0)
            return heights[top] - square(before - after) / (8.0 * bend);
    }
    return heights[top];
}

#endif

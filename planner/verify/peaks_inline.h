/* The highest of a row of numbers. */
#ifndef PLANNER_VERIFY_PEAKS_INLINE_H
#define PLANNER_VERIFY_PEAKS_INLINE_H

#include "planner/core.h"

enum { PEAK_LANES = 8 };

/* The highest of the first count lanes, a power of two. */
static inline __attribute__((always_inline)) double highest_lane(int count, double *lanes)
{
    for (int half = count / 2; half > 0; half /= 2)
        for (int l = 0; l < half; l++)
            lanes[l] = larger(lanes[l], lanes[l + half]);
    return lanes[0];
}

/* Index of the highest, of equal ones the first. */
static inline __attribute__((always_inline)) int64_t highest(int64_t n, const double *heights)
{
    /* First how high, then where: each lane has its own maximum, for one of all would wait for every comparison. */
    double most = heights[0];
    int64_t k = 1;
    if (n >= PEAK_LANES) {
        double top[PEAK_LANES];
        for (int l = 0; l < PEAK_LANES; l++)
            top[l] = heights[l];
        for (k = PEAK_LANES; k + PEAK_LANES <= n; k += PEAK_LANES)
            for (int l = 0; l < PEAK_LANES; l++)
                top[l] = larger(top[l], heights[k + l]);
        most = highest_lane(PEAK_LANES, top);
    }
    for (; k < n; k++)
        most = larger(most, heights[k]);
    for (k = 0; k + PEAK_LANES <= n; k += PEAK_LANES) {
        int found = 0;
        for (int l = 0; l < PEAK_LANES; l++)
            found |= heights[k + l] == most;
        if (found)
            break;
    }
    while (k < n && heights[k] != most)
        k++;
    return k < n ? k : 0; /* most is no number only where the first is none */
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

/* The highest of a row: how high, known by their index, and where. */
typedef struct {
    int64_t room, *kept;
    double *height;
    int64_t *index;
    double *x;
} Tops;

static inline int precedes(double height, int64_t index, double other, int64_t other_index)
{
    return height > other || (height == other && index < other_index);
}

/* Take one among the highest where it is; of equal ones that of the least index. */
static inline void tops_take(const Tops *tops, double height, int64_t index, double x)
{
    int64_t at = *tops->kept;
    if (at == tops->room && !precedes(height, index, tops->height[at - 1], tops->index[at - 1]))
        return;
    /* An insertion: those that are lower move on, and the last of a full row falls out. */
    at = at == tops->room ? at - 1 : (*tops->kept)++;
    for (; at > 0 && precedes(height, index, tops->height[at - 1], tops->index[at - 1]); at--) {
        tops->height[at] = tops->height[at - 1];
        tops->index[at] = tops->index[at - 1];
        tops->x[at] = tops->x[at - 1];
    }
    tops->height[at] = height;
    tops->index[at] = index;
    tops->x[at] = x;
}

#endif

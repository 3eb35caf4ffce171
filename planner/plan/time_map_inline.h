/* A time map, as time_map.py explains it, for compiled code that evaluates it at one point after another. */
#ifndef PLANNER_PLAN_TIME_MAP_INLINE_H
#define PLANNER_PLAN_TIME_MAP_INLINE_H

#include "planner/core.h"

typedef struct {
    int64_t macros;
    const double *sigma, *u; /* (macros + 1) ends of the macros */
    const int64_t *piece;    /* (macros) of the curve if that has a parameter of its own, else -1 */
    const double *powers;    /* (6, macros) of v in the distance from the start of each */
    int rests;               /* whether it ends at a stop */
} TimeMap;

/* v and its first three derivatives over sigma. */
typedef struct {
    double v, first, second, third;
} Native;

/* Distance of a place from the start of its macro, never beyond the end. */
static inline double distance_on(const TimeMap *map, int64_t macro, double sigma)
{
    const double start = map->sigma[macro], end = map->sigma[macro + 1];
    return sigma >= end ? end - start : larger(sigma - start, 0.0);
}

static inline int at_end(const TimeMap *map, int64_t macro, double distance)
{
    return distance >= map->sigma[macro + 1] - map->sigma[macro];
}

static inline Native native_at(const TimeMap *map, int64_t macro, double d)
{
    const int64_t row = map->macros;
    const double *at = map->powers + macro;
    const double c0 = at[0], c1 = at[row], c2 = at[2 * row], c3 = at[3 * row], c4 = at[4 * row], c5 = at[5 * row];
    Native out = {
        .v = c0 + d * (c1 + d * (c2 + d * (c3 + d * (c4 + d * c5)))),
        .first = c1 + d * (2.0 * c2 + d * (3.0 * c3 + d * (4.0 * c4 + d * 5.0 * c5))),
        .second = 2.0 * c2 + d * (6.0 * c3 + d * (12.0 * c4 + d * 20.0 * c5)),
        .third = 6.0 * c3 + d * (24.0 * c4 + d * 60.0 * c5),
    };
    /* At the stop itself the sums leave rounding. */
    if (map->rests && macro == map->macros - 1 && at_end(map, macro, d))
        out.first = out.second = 0.0;
    return out;
}

/* Parameter u of a point: exact at the ends of its macro; within it v where that is u, else not a number. */
static inline double parameter_at(const TimeMap *map, int64_t macro, double distance, double v)
{
    const double start = map->u[macro], end = map->u[macro + 1];
    if (at_end(map, macro, distance))
        return end;
    if (distance <= 0.0)
        return start;
    return map->piece[macro] < 0 ? smaller(larger(v, start), end) : NAN;
}

#endif

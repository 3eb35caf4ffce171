/* The rows of the limits at points of the time map; rows.py explains them. */
#include "planner/plan/plan.h"

#include "planner/geometry/differential_inline.h"
#include "planner/plan/time_map_inline.h"

#include <stddef.h>

#define INLINE static inline __attribute__((always_inline))

/* Points at a time: what is known of them stays in the first-level cache. */
enum { BLOCK = 64, MOST_AXES = 9 };
enum { BY_FEED, BY_CHORD, BY_VELOCITY }; /* what sets the largest speed; the axes follow one another */

void time_map_along(int64_t n, const double *sigma, const int64_t *macro, int64_t macros, const double *edges,
                    const double *u, const int64_t *piece, const double *powers, int64_t rests, double *path,
                    uint8_t *left)
{
    const TimeMap map = {macros, edges, u, piece, powers, rests != 0};
    for (int64_t i = 0; i < n; i++) {
        const double distance = distance_on(&map, macro[i], sigma[i]);
        const Native at = native_at(&map, macro[i], distance);
        path[i] = parameter_at(&map, macro[i], distance, at.v);
        path[n + i] = at.first;
        path[2 * n + i] = at.second;
        path[3 * n + i] = at.third;
        path[4 * n + i] = at.v;
        left[i] = at_end(&map, macro[i], distance) || path[i] >= u[macro[i] + 1];
    }
}

/* Of a block of points the derivatives over sigma of every motion, the arc length of the tip last, and the tip's curvature. */
typedef struct {
    double motion[MOST_AXES + 1][3][BLOCK];
    double curvature[BLOCK];
} Motions;

INLINE void put_motion(int64_t count, const double *q, int64_t order, int64_t apart, const double *rates, int64_t rate,
                       double motion[3][BLOCK])
{
    for (int64_t i = 0; i < count; i++) {
        const double *at = q + i * apart;
        const Triple found =
            chain_rule(at[order], at[2 * order], at[3 * order], rates[i], rates[rate + i], rates[2 * rate + i]);
        motion[0][i] = found.first;
        motion[1][i] = found.second;
        motion[2][i] = found.third;
    }
}

/* The arc length of the tip and its curvature; the speed of a tip that rests has no derivatives, and it bends nowhere. */
INLINE void put_tip(int64_t count, const double *tip, int64_t order, int64_t dim, const double *rates, int64_t rate,
                    double motion[3][BLOCK], double *curvature)
{
    for (int64_t i = 0; i < count; i++) {
        const double *d1 = tip + order + i * dim, *d2 = d1 + order, *d3 = d2 + order;
        double squared = 0.0, along = 0.0, bend = 0.0, twist = 0.0, normal = 0.0;
        for (int64_t j = 0; j < dim; j++) {
            squared += d1[j] * d1[j];
            along += d1[j] * d2[j];
            bend += d2[j] * d2[j];
            twist += d1[j] * d3[j];
        }
        const int moves = squared > 0.0;
        const Triple speeds = speed_derivatives(moves ? squared : 1.0, along, bend + twist);
        const double lean = speeds.second / speeds.first;
        for (int64_t j = 0; j < dim; j++) {
            const double across = d2[j] - lean * d1[j];
            normal += across * across;
        }
        const Triple found =
            chain_rule(speeds.first, speeds.second, speeds.third, rates[i], rates[rate + i], rates[2 * rate + i]);
        motion[0][i] = moves ? found.first : 0.0;
        motion[1][i] = moves ? found.second : 0.0;
        motion[2][i] = moves ? found.third : 0.0;
        curvature[i] = moves ? sqrt(normal) / squared : 0.0;
    }
}

/* Lower the largest speeds of a block to those of one limit, and say where it is that one. */
INLINE void lower(int64_t count, const double *most, int which, double *speed, uint8_t *of)
{
    for (int64_t i = 0; i < count; i++)
        if (most[i] < speed[i]) {
            speed[i] = most[i];
            of[i] = (uint8_t)which;
        }
}

/* The largest x of a block, which limit sets it, and by how many percent it grows with one percent of that. */
INLINE void put_caps(int64_t count, const Motions *at, int64_t dim, const double *feed, const double *velocity,
                     double chord_error, double period, double *cap, uint8_t *which, float *power)
{
    double most[BLOCK], speed[BLOCK];
    const double *rate = at->motion[dim][0];
    for (int64_t i = 0; i < count; i++) {
        speed[i] = INFINITY;
        which[i] = BY_FEED;
        most[i] = feed[i] / rate[i];
    }
    lower(count, most, BY_FEED, speed, which);
    if (isfinite(chord_error)) {
        for (int64_t i = 0; i < count; i++) {
            const double radius = 1.0 / at->curvature[i];
            most[i] = at->curvature[i] > 0.0 ? 2.0 / period * half_chord(radius, chord_error) / rate[i] : INFINITY;
        }
        lower(count, most, BY_CHORD, speed, which);
    }
    for (int64_t j = 0; j < dim; j++) {
        for (int64_t i = 0; i < count; i++)
            most[i] = velocity[j] / fabs(at->motion[j][0][i]);
        lower(count, most, BY_VELOCITY + (int)j, speed, which);
    }
    for (int64_t i = 0; i < count; i++) {
        cap[i] = speed[i] * speed[i];
        power[i] = isfinite(speed[i]) ? 2.0f : 0.0f;
        if (which[i] == BY_CHORD) {
            const double radius = 1.0 / at->curvature[i], error = smaller(chord_error, radius);
            power[i] = (float)(2.0 * (radius - error) / (2.0 * radius - error));
        }
    }
}

/* One row of coefficients in a block, of the derivatives of its motion. */
INLINE void put_row(int64_t count, const double *derivative, double weight, double scale, double unit, double *row)
{
    for (int64_t i = 0; i < count; i++)
        row[i] = weight * derivative[i] / scale * unit;
}

HOT void rows_fill(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip, const double *rates,
                   const double *feed, const double *velocity, double chord_error, double period, int64_t accelerations,
                   int64_t rows, const int64_t *motion, const double *weights, const double *scales,
                   const double *units, int64_t first, int64_t points, double *cap, uint8_t *which, float *power,
                   double *acceleration, double *jerk)
{
    Motions at;
    for (int64_t from = 0; from < n; from += BLOCK) {
        const int64_t count = n - from < BLOCK ? n - from : BLOCK, place = first + from;
        for (int64_t j = 0; j < dim; j++)
            put_motion(count, q + from * dim + j, n * dim, dim, rates + from, n, at.motion[j]);
        put_tip(count, tip + from * tip_dim, n * tip_dim, tip_dim, rates + from, n, at.motion[dim], at.curvature);
        put_caps(count, &at, dim, feed + from, velocity, chord_error, period, cap + place, which + place, power + place);
        for (int64_t r = 0; r < accelerations; r++) {
            const double(*of)[BLOCK] = (const double(*)[BLOCK])at.motion[motion[r]];
            double *row = acceleration + 2 * r * points + place;
            put_row(count, of[1], weights[r], scales[r], units[0], row);
            put_row(count, of[0], weights[r], scales[r], units[1], row + points);
        }
        for (int64_t r = accelerations; r < rows; r++) {
            const double(*of)[BLOCK] = (const double(*)[BLOCK])at.motion[motion[r]];
            double *row = jerk + 3 * (r - accelerations) * points + place;
            put_row(count, of[2], weights[r], scales[r], units[0], row);
            put_row(count, of[1], 3.0 * weights[r], scales[r], units[1], row + points);
            put_row(count, of[0], weights[r], scales[r], units[2], row + 2 * points);
        }
    }
}

/* From x = sigma_dot^2 at the knots to the nodes of a time law; speed_law.py explains it. */
#include "planner/plan/plan.h"

#include "planner/plan/time_map_inline.h"

#include <float.h>

/* Gauss's rule on [0, 1]: from node to node the integrand varies little. */
enum { GAUSS_POINTS = 6 };
static const double PLACE[GAUSS_POINTS] = {0.03376524289842403, 0.16939530676686776, 0.38069040695840156,
                                           0.6193095930415985,  0.8306046932331322,  0.9662347571015759};
static const double WEIGHT[GAUSS_POINTS] = {0.08566224618958514, 0.18038078652406936, 0.23395696728634552,
                                            0.23395696728634552, 0.18038078652406936, 0.08566224618958514};
static const double DEEPEST_DIP = 1e-4;
static const double DIGITS = 16.0; /* a difference of parameters is known to so many units in their last place */

enum { EXACT = 1, WITHIN = 2 }; /* kinds of nodes */

/* x on an interval, a cubic of the distance from its start.  It may dip below 0 between the points at which limits are kept on
   a coarse grid; it is slow there, not undefined, and the excess that the quintic shows makes the grid finer. */
typedef struct {
    double x, a, c, slope, lowest;
} Squared;

static inline double squared_at(const Squared *of, double w)
{
    return larger(of->x + w * (2.0 * of->a + w * (of->c + w * of->slope / 3.0)), of->lowest);
}

/* Time from the distance w on over a width. */
static inline double time_over(const Squared *of, double w, double width)
{
    double time = 0.0;
    for (int i = 0; i < GAUSS_POINTS; i++)
        time += WEIGHT[i] * width / sqrt(squared_at(of, w + PLACE[i] * width));
    return time;
}

/* The way that the quintic tells from a stop. */
static inline double way_from_stop(const double *c, double w)
{
    return w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))));
}

/* Nodes as they are written: each array has one entry a node. */
typedef struct {
    int64_t count, stride;
    double *states, *path, *moved, *width, *time;
    uint8_t *kind;
    int64_t *macro;
} Nodes;

static void put_node(const TimeMap *map, Nodes *nodes, int64_t macro, double sigma, double x, double a, double c)
{
    const int64_t i = nodes->count++, row = nodes->stride;
    const double distance = distance_on(map, macro, sigma);
    const Native at = native_at(map, macro, distance);
    nodes->states[i] = x;
    nodes->states[row + i] = a;
    nodes->states[2 * row + i] = c;
    nodes->path[i] = parameter_at(map, macro, distance, at.v);
    nodes->path[row + i] = at.first;
    nodes->path[2 * row + i] = at.second;
    nodes->path[3 * row + i] = at.third;
    nodes->path[4 * row + i] = at.v;
    nodes->macro[i] = macro;
    nodes->moved[i] = nodes->width[i] = nodes->time[i] = 0.0;
    nodes->kind[i] = 0;
}

/* By how much rounding moved u next to a stop, where the quintic tells the distance from it in full. */
static double moved_at(const TimeMap *map, const Nodes *nodes, const double *from_start, const double *to_end,
                       double digits, double sigma)
{
    const int64_t i = nodes->count - 1, macro = nodes->macro[i], last = map->macros - 1;
    const double distance = distance_on(map, macro, sigma), u = nodes->path[i];
    double moved = 0.0;
    if (distance <= 0.0 || at_end(map, macro, distance))
        return 0.0;
    if (from_start && macro == 0)
        moved = (u - map->u[0]) - way_from_stop(from_start, distance);
    if (to_end && macro == last) {
        const double h = map->sigma[last + 1] - map->sigma[last];
        moved = (u - map->u[last + 1]) + way_from_stop(to_end, h - distance);
    }
    return fabs(moved) <= digits ? moved : 0.0;
}

void speed_law_nodes(int64_t n, const double *sigma, const double *x, const double *a, const double *c,
                     const int64_t *macro, const int64_t *counts, int64_t macros, const double *edges, const double *u,
                     const int64_t *piece, const double *powers, int64_t rests, const uint8_t *at_breaks,
                     const double *from_start, const double *to_end, double digits, int64_t count, double *states,
                     double *path, double *moved, double *width, double *time, uint8_t *kind, int64_t *of_macro)
{
    const TimeMap map = {macros, edges, u, piece, powers, rests != 0};
    Nodes nodes = {0, count, states, path, moved, width, time, kind, of_macro};
    int64_t full = 0, exact = 1; /* the node after one at a break is exact, too */
    for (int64_t k = 0; k < n; k++) {
        const int last = k == n - 1 || macro[k + 1] != macro[k];
        if (last) {
            put_node(&map, &nodes, macro[k], sigma[k], x[k], a[k], c[k]);
            const int64_t i = nodes.count - 1;
            exact = at_breaks[macro[k]];
            kind[i] = exact ? EXACT : WITHIN;
            continue;
        }
        const double h = sigma[k + 1] - sigma[k];
        if (!(h > 0.0))
            continue;
        const Squared of = {x[k], a[k], c[k], (c[k + 1] - c[k]) / h, DEEPEST_DIP * smaller(x[k], x[k + 1])};
        const int64_t parts = counts[full++];
        const double step = h / (double)parts;
        for (int64_t j = 0; j < parts; j++) {
            const double w = h * ((double)j / (double)parts), place = sigma[k] + w;
            put_node(&map, &nodes, macro[k], place, squared_at(&of, w), a[k] + w * (c[k] + 0.5 * w * of.slope),
                     c[k] + w * of.slope);
            const int64_t i = nodes.count - 1;
            width[i] = step;
            time[i] = time_over(&of, w, step);
            moved[i] = moved_at(&map, &nodes, from_start, to_end, digits, place);
            if (exact || moved[i] != 0.0)
                kind[i] = EXACT;
            exact = 0;
        }
    }
}

/* Time in which u goes on by a distance of some digits; to second order, since these may be much next to a stop. */
static double time_until(double distance, double rate, double acceleration)
{
    const double root = rate * rate + 2.0 * acceleration * distance;
    return root > 0.0 ? 2.0 * distance / (rate + sqrt(root)) : distance / rate;
}

void speed_law_rates(int64_t n, const double *states, const double *path, const double *moved, double *rate,
                     double *acceleration, double *time)
{
    const double *x = states, *a = states + n, *c = states + 2 * n;
    const double *u1 = path + n, *u2 = path + 2 * n, *u3 = path + 3 * n;
    double before = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const double pace = sqrt(x[i]);
        double later = 0.0;
        rate[i] = u1[i] * pace;
        acceleration[i] = u2[i] * x[i] + u1[i] * a[i];
        if (moved[i] != 0.0 && rate[i] > 0.0) {
            /* Where rounding moved u, the node is the moment at which the law has the rounded u. */
            const double jerk = (u3[i] * x[i] + 3.0 * u2[i] * a[i] + u1[i] * c[i]) * pace;
            later = time_until(moved[i], rate[i], acceleration[i]);
            rate[i] += later * (acceleration[i] + 0.5 * later * jerk);
            acceleration[i] += later * jerk;
        }
        if (i > 0)
            time[i - 1] += later - before;
        before = later;
    }
}

void speed_law_advance(int64_t n, const double *width, const double *path, const double *moved, double *advance)
{
    const double *u = path, *u1 = path + n, *u2 = path + 2 * n, *u3 = path + 3 * n;
    double size = 0.0;
    for (int64_t i = 0; i < n; i++)
        size = larger(size, fabs(u[i]));
    const double rounding = DIGITS * (DBL_EPSILON * size);
    for (int64_t i = 0; i + 1 < n; i++) {
        const double h = width[i], plain = u[i + 1] - u[i];
        const double integral = h * (0.5 * (u1[i + 1] + u1[i]) +
                                     h * (0.1 * (u2[i] - u2[i + 1]) + h / 120.0 * (u3[i + 1] + u3[i])));
        advance[i] = (fabs(integral - plain) <= rounding ? integral : plain) + (moved[i + 1] - moved[i]);
    }
}

/* Shares of the steps in what is left over: by their length and the square of the times they take. */
static void put_shares(int64_t steps, const double *advance, const double *time, double *share)
{
    double longest = 0.0, sum = 0.0;
    for (int64_t i = 0; i < steps; i++)
        longest = larger(longest, time[i]);
    for (int64_t i = 0; i < steps; i++) {
        const double part = time[i] / longest;
        share[i] = fabs(advance[i]) * (part * part);
        sum += share[i];
    }
    for (int64_t i = 0; i < steps; i++)
        if (!(share[i] > 0.0))
            share[i] = time[i] > 0.0 ? sum / (double)steps : 0.0; /* an empty interval takes no step */
}

void speed_law_in_step(int64_t n, const uint8_t *kind, const double *time, double *advance, double *u, double *work)
{
    double *share = work, *sum = work + n, *lost = work + 2 * n, *spread = work + 3 * n;
    put_shares(n - 1, advance, time, share);
    double left = 0.0;
    sum[0] = u[0];
    lost[0] = 0.0;
    for (int64_t i = 0; i < n; i++) {
        if (i > 0) {
            /* What the addition rounds off, exactly (Knuth's TwoSum); with it the sums are good to half a digit. */
            const double step = advance[i - 1], total = sum[i - 1] + step, added = total - sum[i - 1];
            sum[i] = total;
            lost[i] = lost[i - 1] + ((sum[i - 1] - (total - added)) + (step - added));
        }
        if (kind[i] & EXACT) {
            const double value = (u[i] - sum[i]) - lost[i], band = 0.5 * DBL_EPSILON * fabs(u[i]);
            left = smaller(larger(left, value - band), value + band);
            spread[i] = left;
        }
    }
    for (int64_t first = 0, last = 1; last < n; last++) {
        if (!(kind[last] & EXACT))
            continue;
        double over = 0.0, all = 0.0;
        for (int64_t i = first; i < last; i++)
            all += share[i];
        const double from = spread[first], slope = all > 0.0 ? (spread[last] - from) / all : 0.0;
        for (int64_t i = first + 1; i < last; i++) {
            over += share[i - 1];
            spread[i] = from + slope * over;
            u[i] = sum[i] + (lost[i] + spread[i]);
        }
        first = last;
    }
    for (int64_t i = 0; i + 1 < n; i++)
        advance[i] += spread[i + 1] - spread[i];
}

void speed_law_table(int64_t n, const uint8_t *kind, const double *time, const double *advance, const double *u,
                     const double *rate, const double *acceleration, int64_t kept, double *table, double *steps)
{
    double sum = 0.0;
    for (int64_t i = 0, k = 0; i < n; i++) {
        if (kind[i] & WITHIN)
            continue;
        table[k] = sum;
        table[kept + k] = u[i];
        table[2 * kept + k] = rate[i];
        table[3 * kept + k] = acceleration[i];
        if (k < kept - 1) {
            steps[k] = time[i];
            steps[kept - 1 + k] = advance[i];
            sum += time[i];
        }
        k++;
    }
}

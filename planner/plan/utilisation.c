#include "planner/plan/plan.h"

#include "planner/geometry/lanes_inline.h"

#include <stdlib.h>
#include <string.h>

enum { MOST_PARTS = 80 }; /* that an interval is cut into */

/* Error of a parabola through points, against their third difference: max |x (x^2 - 1)| / 6. */
static const double PARABOLA = 0.07;
static const double PRECISE = 3e-7; /* as a share of a limit */

/* Everything that does not change from interval to interval. */
typedef struct {
    const Pieces *axes, *tip; /* the same where all axes move the tip */
    int64_t intervals, rows;
    const double *u, *rate, *acceleration, *duration, *advance, *powers, *digit, *stretch_end, *feed;
    const double *bounds;
    const int64_t *kinds;
    double chord_error, period;
} Task;

/* The intervals that are measured together, one in each lane: which, their laws, and pieces that each was last on. */
typedef struct {
    int64_t interval[LANES], piece[LANES], tip_piece[LANES];
    Lanes c[6], duration, first, last, stretch_end, digit, feed, parts, most_backward;
    int64_t most_parts;
} Block;

/* Place, path and rates at one point of each interval. */
typedef struct {
    Lanes place, squared_speed;
    LaneTriple u, speeds, rates[MOST_AXES + 1];
    LaneMotions q, own_tip;
} Point;

/* The share of one limit that is used at the points of each interval, and what rounding makes of it. */
typedef struct {
    Lanes granted, values[MOST_PARTS + 1];
} Share;

/* What the measurement of one block after another needs room for. */
typedef struct {
    Block block;
    Share share;
    Point points[MOST_PARTS + 1];
} Room;

/* The quintics between the nodes; u is counted from the first one, as quintic_coefficients in law.py has it. */
INLINE void put_quintic(const Task *task, const int64_t *i, Block *block)
{
    const double *const rate[LANES] = LANES_AT(task->rate, i, 1);
    const double *const acceleration[LANES] = LANES_AT(task->acceleration, i, 1);
    const double *const powers[LANES] = LANES_AT(task->powers, i, 1);
    const double *const advances[LANES] = LANES_AT(task->advance, i, 1);
    const int64_t n = task->intervals;
    const Lanes h = block->duration, advance = LANES_OF(advances, 0), v0 = LANES_OF(rate, 0), v1 = LANES_OF(rate, 1);
    const Lanes a0 = LANES_OF(acceleration, 0), a1 = LANES_OF(acceleration, 1);
    /* The large common terms cancel here once, not in each coefficient. */
    const Lanes rest = advance - h * (v0 + 0.5 * a0 * h), dv = (v1 - v0 - a0 * h) * h, da = (a1 - a0) * (h * h);
    block->c[0] = block->first;
    block->c[1] = v0;
    block->c[2] = 0.5 * a0;
    block->c[3] = (10.0 * rest - 4.0 * dv + 0.5 * da) / (Lanes)LANES_OF(powers, 0);
    block->c[4] = (-15.0 * rest + 7.0 * dv - da) / (Lanes)LANES_OF(powers, n);
    block->c[5] = (6.0 * rest - 3.0 * dv + 0.5 * da) / (Lanes)LANES_OF(powers, 2 * n);
}

/* Take the intervals from index[0] on, the last of them again in lanes that are left over. */
INLINE void fill_block(const Task *task, const int64_t *index, const int64_t *parts, int64_t left, Block *block)
{
    int64_t *const i = block->interval;
    block->most_parts = 0;
    for (int64_t l = 0; l < LANES; l++) {
        const int64_t at = l < left ? l : left - 1;
        i[l] = index[at];
        block->parts[l] = (double)parts[at];
        block->most_parts = parts[at] > block->most_parts ? parts[at] : block->most_parts;
    }
    const double *const u[LANES] = LANES_AT(task->u, i, 1);
    const double *const durations[LANES] = LANES_AT(task->duration, i, 1);
    const double *const ends[LANES] = LANES_AT(task->stretch_end, i, 1);
    const double *const digits[LANES] = LANES_AT(task->digit, i, 1);
    const double *const feeds[LANES] = LANES_AT(task->feed, i, 1);
    block->first = (Lanes)LANES_OF(u, 0);
    block->last = (Lanes)LANES_OF(u, 1);
    block->duration = (Lanes)LANES_OF(durations, 0);
    block->stretch_end = (Lanes)LANES_OF(ends, 0);
    block->digit = (Lanes)LANES_OF(digits, 0);
    block->feed = (Lanes)LANES_OF(feeds, 0);
    block->most_backward = (Lanes){0.0};
    put_quintic(task, i, block);
}

/* The law at part n of every interval, at the end of those that have fewer. */
INLINE void put_law(Block *block, int64_t n, Point *at)
{
    const Lanes *c = block->c, first = block->first, last = block->last;
    const Lanes k = SMALLER((double)n - (Lanes){0.0}, block->parts), w = block->duration * k / block->parts;
    const Lanes u = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))));
    const Lanes above = LARGER(u, first), within = SMALLER(above, last);
    at->place = n == 0 ? first : CHOOSE(k == block->parts, last, within);
    at->u.first = c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5])));
    at->u.second = 2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5]));
    at->u.third = 6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5]);
    block->most_backward = LARGER(block->most_backward, -at->u.first);
}

/* The path there. */
INLINE void put_path(const Task *task, Block *block, Point *at)
{
    /* A point that rounds to the end of its stretch must not be read from beyond it. */
    const Mask left = at->place >= block->stretch_end;
    lanes_on_pieces(task->axes, &at->place, &left, block->piece, at->q);
    if (task->tip != task->axes)
        lanes_on_pieces(task->tip, &at->place, &left, block->tip_piece, at->own_tip);
}

INLINE const Lanes (*tip_at(const Task *task, const Point *at))[MOST_AXES]
{
    return task->tip == task->axes ? at->q : at->own_tip;
}

/* Velocity, acceleration and jerk there, of the axes and last of the arc length. */
INLINE void put_rates(const Task *task, Point *at)
{
    lanes_speeds(tip_at(task, at), task->tip->dim, &at->speeds, &at->squared_speed);
    for (int64_t j = 0; j < task->axes->dim; j++)
        lanes_chain_rule(at->q, j, &at->u, &at->rates[j]);
    lanes_rates_along(&at->speeds, &at->u, &at->rates[task->axes->dim]);
}

INLINE void put_feed_share(const Block *block, const Point *points, Share *share)
{
    for (int64_t n = 0; n <= block->most_parts; n++)
        share->values[n] = points[n].speeds.first * ABSOLUTE(points[n].u.first) / block->feed;
}

/* Share of the chord error by the osculating circle, 0 where nothing bends; its radius as ``curvature`` in differential.py has
 * the inverse, with the slope that is at hand. */
INLINE void put_chord_share(const Task *task, const Block *block, const Point *points, Share *share)
{
    for (int64_t n = 0; n <= block->most_parts; n++) {
        const Point *at = &points[n];
        const Lanes(*tip)[MOST_AXES] = tip_at(task, at);
        const Lanes slope = at->speeds.second / at->speeds.first;
        Lanes normal = {0.0};
        for (int64_t j = 0; j < task->tip->dim; j++) {
            const Lanes across = tip[2][j] - slope * tip[1][j];
            normal += across * across;
        }
        const Mask bends = (normal > 0.0) & (at->speeds.first > 0.0);
        take_root(&normal);
        const Lanes radius = at->squared_speed / normal, error = task->chord_error - (Lanes){0.0};
        const Lanes sagitta = SMALLER(error, radius);
        Lanes half = sagitta * (2.0 * radius - sagitta);
        take_root(&half);
        const Lanes used = at->speeds.first * ABSOLUTE(at->u.first) * task->period / (2.0 * half);
        share->values[n] = (Lanes)((Mask)used & bends);
    }
}

INLINE void put_row_share(const Task *task, int64_t r, const Block *block, const Point *points, Share *share)
{
    const double *row = task->bounds + 5 * r;
    const int64_t motion = task->kinds[2 * r];
    const Lanes zero = {0.0}, upper = row[4] - zero, lower = row[3] - zero;
    for (int64_t n = 0; n <= block->most_parts; n++) {
        const LaneTriple *rates = &points[n].rates[motion];
        Lanes value = zero;
        if (row[0] != 0.0)
            value += row[0] * rates->first;
        if (row[1] != 0.0)
            value += row[1] * rates->second;
        if (row[2] != 0.0)
            value += row[2] * rates->third;
        share->values[n] = value / CHOOSE(value > 0.0, upper, lower);
    }
}

/* Share of a limit that rounding makes of a quintic: half a digit of u at both ends is worth up to 2, 6 and 60 of it over h, h^2
 * and h^3.  Nine tenths of that are granted here, all of it by the check: nothing on a path of metres, all of the jerk at the
 * end of one of 100 km, where no table in double precision says more. */
INLINE void grant_row(const Task *task, int64_t r, const Block *block, const Point *start, Share *share)
{
    const double *row = task->bounds + 5 * r;
    const int64_t motion = task->kinds[2 * r];
    const Lanes h = block->duration, digit = block->digit;
    const Lanes size = motion < task->axes->dim ? ABSOLUTE(start->q[1][motion]) : start->speeds.first;
    Lanes granted = {0.0};
    granted += 1.8 * digit / h * size * fabs(row[0]);
    granted += 5.4 * digit / (h * h) * size * fabs(row[1]);
    granted += 54.0 * digit / (h * h * h) * size * fabs(row[2]);
    share->granted = granted / smaller(row[4], -row[3]);
}

/* The highest value of a share between the ends of each interval less what is granted; and where it may be too low.  A peak
 * between points is that of the parabola through three; it is off by up to PARABOLA of the third difference. */
INLINE void find_peak(const Block *block, const Share *share, Lanes *highest, Mask *doubtful)
{
    const Lanes zero = {0.0};
    Lanes before2 = zero, before = share->values[0], here = share->values[1], top = LARGER(before, here);
    for (int64_t n = 2; n <= block->most_parts; n++) {
        const Lanes number = (double)n - zero, after = share->values[n];
        const Mask within = number <= block->parts, last = number == block->parts;
        const Lanes bend = before - 2.0 * here + after, lean = before - after;
        /* The vertex is nearest to the middle one, or at an end of the interval to its first or last point. */
        const Mask outer = (last & (lean < 0.0)) | (n == 2 ? lean > 0.0 : (Mask){0});
        const Lanes reach = CHOOSE(outer, -2.0 * bend, -bend), vertex = here - lean * lean / (8.0 * bend);
        const Lanes higher = LARGER(top, after), highest_here = LARGER(higher, vertex);
        const Mask peaks = (bend < 0.0) & (ABSOLUTE(lean) <= reach);
        top = CHOOSE(within, CHOOSE(peaks, highest_here, higher), top);
        if (n >= 3) {
            const Lanes third = after - 3.0 * here + 3.0 * before - before2, error = PARABOLA * ABSOLUTE(third);
            /* Either parabola rises by at most an eighth of its second difference above its points. */
            const Lanes other = bend - third, deeper = SMALLER(bend, other), deepest = SMALLER(deeper, zero);
            const Lanes first = LARGER(before2, before), second = LARGER(first, here), point = LARGER(second, after);
            const Lanes most = point - 0.125 * deepest + error;
            *doubtful |= within & (error > PRECISE) & (most > 1.0 + share->granted);
        }
        before2 = before;
        before = here;
        here = after;
    }
    *highest = top - share->granted;
}

/* Measure the intervals of a block; returns which must be looked at more closely. */
INLINE void measure_block(const Task *task, Room *room, double *restrict out, Mask *doubtful)
{
    Block *block = &room->block;
    Share *share = &room->share;
    Point *points = room->points;
    Lanes found[3] = {{0.0}, {0.0}, {0.0}}, top;
    for (int64_t n = 0; n <= block->most_parts; n++)
        put_law(block, n, &points[n]);
    for (int64_t n = 0; n <= block->most_parts; n++)
        put_path(task, block, &points[n]);
    for (int64_t n = 0; n <= block->most_parts; n++)
        put_rates(task, &points[n]);
    *doubtful = (Mask){0};
    put_feed_share(block, points, share);
    share->granted = 1.8 * block->digit / block->duration * points[0].speeds.first / block->feed;
    find_peak(block, share, &top, doubtful);
    found[0] = LARGER(found[0], top);
    if (isfinite(task->chord_error)) {
        put_chord_share(task, block, points, share);
        share->granted = (Lanes){0.0};
        find_peak(block, share, &top, doubtful);
        found[0] = LARGER(found[0], top);
    }
    for (int64_t r = 0; r < task->rows; r++) {
        Lanes *kind = &found[task->kinds[2 * r + 1]];
        put_row_share(task, r, block, points, share);
        grant_row(task, r, block, &points[0], share);
        find_peak(block, share, &top, doubtful);
        *kind = LARGER(*kind, top);
    }
    for (int l = 0; l < LANES; l++) {
        for (int k = 0; k < 3; k++)
            out[k * task->intervals + block->interval[l]] = found[k][l];
        double *backward = &out[3 * task->intervals + block->interval[l]];
        *backward = larger(*backward, block->most_backward[l]);
    }
}

/* Measure the n pending intervals, those in doubt again and again, cut into more parts. */
HOT static void measure(const Task *task, int64_t n, int64_t *restrict pending, int64_t *restrict parts, Room *room,
                        double *restrict out)
{
    Block *block = &room->block;
    memset(block, 0, sizeof *block);
    for (int64_t left = n, kept = 0; left > 0; left = kept) {
        kept = 0;
        for (int64_t at = 0; at < left; at += LANES) {
            Mask doubtful;
            fill_block(task, pending + at, parts + at, left - at, block);
            measure_block(task, room, out, &doubtful);
            for (int64_t l = 0; l < LANES && at + l < left; l++)
                if (doubtful[l] && block->parts[l] < MOST_PARTS) {
                    pending[kept] = block->interval[l];
                    parts[kept++] = (int64_t)smaller(2.0 * block->parts[l], MOST_PARTS);
                }
        }
    }
}

int64_t utilisation_shares(int64_t pieces, int64_t dim, int64_t terms, const double *breaks,
                           const double *coefficients, int64_t rational, const uint8_t *resting, const double *origin,
                           int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms, const double *tip_breaks,
                           const double *tip_coefficients, int64_t tip_rational, const uint8_t *tip_resting,
                           const double *tip_origin, int64_t n, const int64_t *index, int64_t intervals,
                           const double *u, const double *rate, const double *acceleration, const double *duration,
                           const double *advance, const double *powers, const double *digit, const double *stretch_end,
                           const double *feed, const int64_t *points, int64_t rows, const double *bounds,
                           const int64_t *kinds, double chord_error, double period, double *out)
{
    const Pieces axes = {pieces, dim, terms, breaks, coefficients, origin, resting, rational != 0};
    const Pieces tip = {tip_pieces,       tip_dim,    tip_terms,   tip_breaks,
                        tip_coefficients, tip_origin, tip_resting, tip_rational != 0};
    const Task task = {&axes,       tip_coefficients == coefficients ? &axes : &tip,
                       intervals,   rows,
                       u,           rate,
                       acceleration, duration,
                       advance,     powers,
                       digit,       stretch_end,
                       feed,        bounds,
                       kinds,       chord_error,
                       period};
    int64_t *pending = malloc((size_t)(2 * n) * sizeof *pending);
    Room *room = aligned_alloc(sizeof(Lanes), sizeof *room);
    const int64_t possible = pending && room && dim <= MOST_AXES;
    if (possible) {
        int64_t *parts = pending + n;
        for (int64_t k = 0; k < n; k++) {
            pending[k] = index[k];
            parts[k] = points[index[k]];
            out[3 * intervals + index[k]] = 0.0;
        }
        measure(&task, n, pending, parts, room, out);
    }
    free(pending);
    free(room);
    return possible;
}

int64_t utilisation_peak(int64_t parts, const double *values, double granted, double *top)
{
    Block block;
    Share share;
    Lanes highest;
    Mask doubtful = {0};
    memset(&block, 0, sizeof block);
    block.most_parts = parts;
    block.parts = (double)parts - (Lanes){0.0};
    share.granted = granted - (Lanes){0.0};
    for (int64_t n = 0; n <= parts; n++)
        share.values[n] = values[n] - (Lanes){0.0};
    find_peak(&block, &share, &highest, &doubtful);
    *top = highest[0];
    return doubtful[0] != 0;
}

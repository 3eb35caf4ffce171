#include "planner/plan/plan.h"

#include "planner/geometry/lanes_inline.h"

#include <stdlib.h>
#include <string.h>

enum { MOST_PARTS = 80 }; /* that an interval is cut into */

/* Error of a parabola through points, against their third difference: max |x (x^2 - 1)| / 6. */
static const double PARABOLA = 0.07;
static const double PRECISE = 3e-7; /* as a share of a limit */

/* What a row of spans is, see plan.h. */
enum { DURATION, FIRST, LAST, STRETCH_END, DIGIT, FEED, POINTS };

/* The highest value of one share so far, the last three values, of points next to one another, and whether a peak between them
 * may be higher. */
typedef struct {
    Lanes granted, top, before2, before, here;
    Mask doubtful;
} Peak;

/* Everything that does not change from interval to interval. */
typedef struct {
    const Pieces *axes, *tip; /* the same where all axes move the tip */
    int64_t n, rows;
    const double *quintic, *spans, *bounds;
    const int64_t *kinds;
    double chord_error, period;
} Task;

/* The intervals that are measured together, one in each lane: which, their laws, and pieces that each was last on. */
typedef struct {
    int64_t interval[LANES], piece[LANES], tip_piece[LANES];
    Lanes c[6], duration, first, last, stretch_end, digit, feed, parts, most_backward;
    int64_t most_parts;
} Block;

/* Shares, and the rates they follow from, at one point of each interval. */
typedef struct {
    LaneMotions q, own_tip;
    LaneTriple u, speeds, rates[MOST_AXES + 1];
    Lanes place, squared_speed;
} Point;

/* Take the intervals from index[0] on, the last of them again in lanes that are left over. */
INLINE void fill_block(const Task *task, const int64_t *index, const int64_t *parts, int64_t left, Block *block)
{
    const int64_t n = task->n;
    block->most_parts = 0;
    for (int64_t l = 0; l < LANES; l++) {
        const int64_t at = l < left ? l : left - 1, i = index[at];
        const double *span = task->spans + i;
        block->interval[l] = i;
        for (int k = 0; k < 6; k++)
            block->c[k][l] = task->quintic[k * n + i];
        block->duration[l] = span[DURATION * n];
        block->first[l] = span[FIRST * n];
        block->last[l] = span[LAST * n];
        block->stretch_end[l] = span[STRETCH_END * n];
        block->digit[l] = span[DIGIT * n];
        block->feed[l] = span[FEED * n];
        block->parts[l] = (double)parts[at];
        block->most_parts = parts[at] > block->most_parts ? parts[at] : block->most_parts;
    }
}

/* Law, path and rates at part n of every interval, at the end of those that have fewer. */
INLINE void evaluate(const Task *task, Block *block, int64_t n, Point *at)
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
    /* A point that rounds to the end of its stretch must not be read from beyond it. */
    const Mask left = at->place >= block->stretch_end;
    const int cartesian = task->tip == task->axes;
    lanes_on_pieces(task->axes, &at->place, &left, block->piece, at->q);
    if (!cartesian)
        lanes_on_pieces(task->tip, &at->place, &left, block->tip_piece, at->own_tip);
    lanes_speeds(cartesian ? at->q : at->own_tip, task->tip->dim, &at->speeds, &at->squared_speed);
    for (int64_t j = 0; j < task->axes->dim; j++)
        lanes_chain_rule(at->q, j, &at->u, &at->rates[j]);
    lanes_rates_along(&at->speeds, &at->u, &at->rates[task->axes->dim]);
}

/* Shares of the limits that rounding makes of a quintic: half a digit of u at both ends is worth up to 2, 6 and 60 of it over
 * h, h^2 and h^3.  Nine tenths of that are granted here, all of it by the check: nothing on a path of metres, all of the jerk
 * at the end of one of 100 km, where no table in double precision says more. */
INLINE void grant(const Task *task, const Block *block, const Point *at, Peak *peaks)
{
    const Lanes h = block->duration, digit = block->digit, zero = {0.0};
    const Lanes digits[3] = {1.8 * digit / h, 5.4 * digit / (h * h), 54.0 * digit / (h * h * h)};
    peaks[0].granted = digits[0] * at->speeds.first / block->feed;
    peaks[1].granted = zero;
    for (int64_t r = 0; r < task->rows; r++) {
        const double *row = task->bounds + 5 * r;
        const int64_t motion = task->kinds[2 * r];
        const Lanes size = motion < task->axes->dim ? ABSOLUTE(at->q[1][motion]) : at->speeds.first;
        Lanes granted = zero;
        for (int k = 0; k < 3; k++)
            granted += digits[k] * size * fabs(row[k]);
        peaks[2 + r].granted = granted / smaller(row[4], -row[3]);
    }
}

/* Share of the chord error by the osculating circle, 0 where nothing bends; its radius as ``curvature`` in differential.py has
 * the inverse, with the slope that is at hand. */
INLINE void chord_share(const Task *task, const Point *at, Lanes *share)
{
    const Lanes(*tip)[MOST_AXES] = task->tip == task->axes ? at->q : at->own_tip;
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
    *share = (Lanes)((Mask)used & bends);
}

INLINE void row_share(const double *row, const LaneTriple *rates, Lanes *share)
{
    const Lanes zero = {0.0}, upper = row[4] - zero, lower = row[3] - zero;
    Lanes value = zero;
    if (row[0] != 0.0)
        value += row[0] * rates->first;
    if (row[1] != 0.0)
        value += row[1] * rates->second;
    if (row[2] != 0.0)
        value += row[2] * rates->third;
    *share = value / CHOOSE(value > 0.0, upper, lower);
}

/* Take the n-th value of each interval that has so many parts.  A peak between points is that of the parabola through three;
 * it is off by up to PARABOLA of the third difference. */
INLINE void follow_peak(Peak *peak, const Block *block, int64_t n, const Lanes *value)
{
    const Lanes number = (double)n - (Lanes){0.0};
    const Mask within = number <= block->parts;
    const Lanes after = *value, here = peak->here, before = peak->before, before2 = peak->before2;
    peak->before2 = before;
    peak->before = here;
    peak->here = after;
    Lanes top = n == 0 ? after : LARGER(peak->top, after);
    if (n >= 2) {
        const Lanes bend = before - 2.0 * here + after, lean = before - after, zero = {0.0};
        /* The vertex is nearest to the middle one, or at an end of the interval to its first or last point. */
        const Mask outer = n == 2 ? (lean > 0.0) | ((number == block->parts) & (lean < 0.0))
                                  : (number == block->parts) & (lean < 0.0);
        const Lanes reach = CHOOSE(outer, -2.0 * bend, -bend);
        const Lanes vertex = here - lean * lean / (8.0 * bend), higher = LARGER(top, vertex);
        top = CHOOSE((bend < 0.0) & (ABSOLUTE(lean) <= reach), higher, top);
        if (n >= 3) {
            const Lanes third = after - 3.0 * here + 3.0 * before - before2, error = PARABOLA * ABSOLUTE(third);
            /* Either parabola rises by at most an eighth of its second difference above its points. */
            const Lanes other = bend - third, deeper = SMALLER(bend, other), deepest = SMALLER(deeper, zero);
            const Lanes first = LARGER(before2, before), second = LARGER(first, here), point = LARGER(second, after);
            const Lanes highest = point - 0.125 * deepest + error;
            peak->doubtful |= within & (error > PRECISE) & (highest > 1.0 + peak->granted);
        }
    }
    peak->top = CHOOSE(within, top, peak->top);
}

/* Measure the intervals of a block; returns which must be looked at more closely. */
INLINE void measure_block(const Task *task, Block *block, Peak *peaks, double *restrict out, Mask *doubtful)
{
    Point at;
    for (int l = 0; l < LANES; l++)
        block->most_backward[l] = out[3 * task->n + block->interval[l]];
    for (int64_t n = 0; n <= block->most_parts; n++) {
        evaluate(task, block, n, &at);
        if (n == 0)
            grant(task, block, &at, peaks);
        Lanes share = at.speeds.first * ABSOLUTE(at.u.first) / block->feed;
        follow_peak(&peaks[0], block, n, &share);
        if (isfinite(task->chord_error)) {
            chord_share(task, &at, &share);
            follow_peak(&peaks[1], block, n, &share);
        }
        for (int64_t r = 0; r < task->rows; r++) {
            row_share(task->bounds + 5 * r, &at.rates[task->kinds[2 * r]], &share);
            follow_peak(&peaks[2 + r], block, n, &share);
        }
    }
    Lanes found[3] = {{0.0}, {0.0}, {0.0}};
    *doubtful = (Mask){0};
    for (int64_t k = 0; k < 2 + task->rows; k++) {
        Lanes *kind = &found[k < 2 ? 0 : task->kinds[2 * (k - 2) + 1]];
        const Lanes top = peaks[k].top - peaks[k].granted;
        *kind = LARGER(*kind, top);
        *doubtful |= peaks[k].doubtful;
    }
    for (int l = 0; l < LANES; l++) {
        for (int k = 0; k < 3; k++)
            out[k * task->n + block->interval[l]] = found[k][l];
        out[3 * task->n + block->interval[l]] = block->most_backward[l];
    }
}

/* Measure all intervals, those in doubt again and again; pending, parts (n): scratch. */
HOT static void measure(const Task *task, int64_t *restrict pending, int64_t *restrict parts, Peak *peaks,
                        double *restrict out)
{
    for (int64_t i = 0; i < task->n; i++) {
        pending[i] = i;
        parts[i] = (int64_t)task->spans[POINTS * task->n + i];
        out[3 * task->n + i] = 0.0;
    }
    Block block;
    memset(&block, 0, sizeof block);
    for (int64_t left = task->n, kept = 0; left > 0; left = kept) {
        kept = 0;
        for (int64_t at = 0; at < left; at += LANES) {
            Mask doubtful;
            fill_block(task, pending + at, parts + at, left - at, &block);
            memset(peaks, 0, (size_t)(2 + task->rows) * sizeof *peaks);
            measure_block(task, &block, peaks, out, &doubtful);
            for (int64_t l = 0; l < LANES && at + l < left; l++)
                if (doubtful[l] && block.parts[l] < MOST_PARTS) {
                    pending[kept] = block.interval[l];
                    parts[kept++] = (int64_t)smaller(2.0 * block.parts[l], MOST_PARTS);
                }
        }
    }
}

int64_t utilisation_shares(int64_t pieces, int64_t dim, int64_t terms, const double *breaks,
                           const double *coefficients, int64_t rational, const uint8_t *resting, const double *origin,
                           int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms, const double *tip_breaks,
                           const double *tip_coefficients, int64_t tip_rational, const uint8_t *tip_resting,
                           const double *tip_origin, int64_t n, const double *quintic, const double *spans,
                           int64_t rows, const double *bounds, const int64_t *kinds, double chord_error,
                           double period, double *out)
{
    const Pieces axes = {pieces, dim, terms, breaks, coefficients, origin, resting, rational != 0};
    const Pieces tip = {tip_pieces,       tip_dim,    tip_terms,   tip_breaks,
                        tip_coefficients, tip_origin, tip_resting, tip_rational != 0};
    const Task task = {&axes, tip_coefficients == coefficients ? &axes : &tip, n, rows, quintic, spans, bounds, kinds,
                       chord_error, period};
    int64_t *pending = malloc((size_t)(2 * n) * sizeof *pending);
    Peak *peaks = aligned_alloc(sizeof(Lanes), (size_t)(2 + rows) * sizeof *peaks);
    const int64_t room = pending && peaks && dim <= MOST_AXES;
    if (room)
        measure(&task, pending, pending + n, peaks, out);
    free(pending);
    free(peaks);
    return room;
}

int64_t utilisation_peak(int64_t parts, const double *values, double granted, double *top)
{
    Block block;
    Peak peak;
    memset(&block, 0, sizeof block);
    memset(&peak, 0, sizeof peak);
    for (int l = 0; l < LANES; l++) {
        block.parts[l] = (double)parts;
        peak.granted[l] = granted;
    }
    for (int64_t n = 0; n <= parts; n++) {
        const Lanes value = values[n] - (Lanes){0.0};
        follow_peak(&peak, &block, n, &value);
    }
    *top = peak.top[0] - granted;
    return peak.doubtful[0] != 0;
}

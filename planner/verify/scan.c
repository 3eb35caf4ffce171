#include "planner/verify/law_inline.h"
#include "planner/verify/meanjerk_inline.h"
#include "planner/verify/motion_inline.h"
#include "planner/verify/peaks_inline.h"
#include "planner/verify/verify.h"

enum { USUAL = 24 }; /* points a span */

/* Size of a quantity less its slack.  Backwards counts only what is backwards; what is not a number is beyond every limit. */
INLINED void use_of(const Quantities *block, int64_t row, int64_t count, double *restrict used)
{
    const double *value = block->value[row], *granted = block->granted[row];
    for (int64_t point = 0; point < count; point++) {
        const double less = (row == REVERSAL ? value[point] : fabs(value[point])) - granted[point];
        used[point] = less < INFINITY ? less : INFINITY;
    }
}

HOT void scan_used(int64_t n, int64_t k, int64_t dim, int64_t tip, const double *rates, const double *slack, const int64_t *row,
                   double *used, const double *d, const double *p)
{
    const States states = {n * k, dim, tip, d, p, rates, slack, k};
    Quantities block;
    for (int64_t i = 0; i < n; i++)
        for (int64_t first = 0; first < k; first += BLOCK) {
            const int64_t count = k - first < BLOCK ? k - first : BLOCK;
            measure_block(&states, i * k + first, count, &block);
            use_of(&block, row[i], count, used + i * k + first);
        }
}

/* What the tip does at the first or the last point of a block, into place, velocity and direction, a row of tip numbers each. */
static void end_of_tip(const States *states, int64_t point, double *row)
{
    const int64_t tip = states->tip;
    const double *p = (states->p ? states->p : states->d) + point * tip, *slope = p + states->points * tip;
    double squared = 0.0;
    for (int64_t j = 0; j < tip; j++)
        squared += square(slope[j]);
    const double scale = squared > 0.0 ? 1.0 / sqrt(squared) : 0.0;
    for (int64_t j = 0; j < tip; j++) {
        row[j] = p[j];
        row[tip + j] = slope[j] * states->rates[point];
        row[2 * tip + j] = slope[j] * scale;
    }
}

/* Raise the squares of a span's course to those of a block of its points. */
INLINED void course_raise(const Quantities *block, int64_t count, double *course)
{
    const double *of[COURSE_SIZES] = {block->across, block->along, block->swing, block->jolt[0], block->jolt[1]};
    for (int row = 0; row < COURSE_SIZES; row++)
        course[row] = highest_number(count, of[row], course[row]);
}

/* The mean jerk of every axis from the first to the last point of a span, into every spans-th number. */
static void mean_jerks(const States *states, int64_t first, int64_t last, const Quintic *law, const double *u, double gap,
                       int64_t spans, double *mean, double *slack)
{
    const int64_t dim = states->dim, points = states->points;
    for (int64_t j = 0; j < dim; j++) {
        const Node begin = {states->d + first * dim + j, points * dim, u[0], states->rates[first],
                            states->rates[points + first]};
        const Node end = {states->d + last * dim + j, points * dim, u[spans], states->rates[last],
                          states->rates[points + last]};
        mean[j * spans] = mean_jerk(&begin, &end, gap, law->start, law->h, slack + j * spans);
    }
}

/* What a scan finds, as verify.h says. */
typedef struct {
    int64_t spans, candidates;
    double *ends;
    int64_t *kept;
    double *best;
    int64_t *best_span;
    double *best_x, *largest, *jerk, *feed, *feed_place, *course, *work;
} Found;

/* Measure span at, the i-th of a window, at k points. */
INLINED void scan_points(const States *states, int64_t i, int64_t at, int64_t k, const double *x, const Found *found)
{
    const int64_t rows = FIRST_AXIS + 3 * states->dim, spans = found->spans;
    double *own = found->course + at * (COURSE_SIZES + 6 * states->tip);
    Quantities block;
    for (int row = 0; row < COURSE_SIZES; row++)
        own[row] = 0.0;
    end_of_tip(states, i * k, own + COURSE_SIZES);
    end_of_tip(states, i * k + k - 1, own + COURSE_SIZES + 3 * states->tip);
    for (int64_t first = 0; first < k; first += BLOCK) {
        const int64_t count = k - first < BLOCK ? k - first : BLOCK;
        measure_block(states, i * k + first, count, &block);
        course_raise(&block, count, own);
        for (int64_t row = 0; row < rows; row++)
            use_of(&block, row, count, found->work + row * k + first);
        if (first == 0)
            for (int64_t row = 0; row < rows; row++)
                found->ends[row * spans + at] = block.value[row][0];
        if (first + count == k)
            for (int64_t row = 0; row < rows; row++)
                found->ends[(rows + row) * spans + at] = block.value[row][count - 1];
        const int64_t top = highest(count, block.value[FEED]);
        if (first == 0 || block.value[FEED][top] > found->feed[at]) {
            found->feed[at] = block.value[FEED][top];
            found->feed_place[at] = x[first + top];
        }
    }
    for (int row = 0; row < COURSE_SIZES; row++)
        own[row] = sqrt(own[row]);
}

/* Keep the highest of what a span uses. */
INLINED void scan_tops(int64_t dim, int64_t at, int64_t k, const double *x, const Found *found)
{
    const int64_t rows = FIRST_AXIS + 3 * dim, candidates = found->candidates;
    for (int64_t row = 0; row < rows; row++) {
        double *used = found->work + row * k;
        const int64_t top = highest(k, used);
        const Tops tops = {candidates, found->kept + row, found->best + row * candidates,
                           found->best_span + row * candidates, found->best_x + row * candidates};
        tops_take(&tops, peak(k, used, top), at, x[top]);
        found->largest[row] = larger(found->largest[row], used[top]);
        if (row < rows - dim)
            continue;
        for (int64_t point = 0; point < k; point++)
            used[point] = larger(used[point], 0.0);
        found->jerk[(row - rows + dim) * found->spans + at] = peak(k, used, used[top] > 0.0 ? top : 0);
    }
}

HOT void scan_measure(const double *table, int64_t spans, const int64_t *interval, const double *lower, const double *upper,
                      const double *u_ends, const double *gap, int64_t room, int64_t k, const int64_t *window,
                      const double *x, const double *rates, const double *slack, int64_t dim, int64_t tip, double *ends,
                      int64_t candidates, int64_t *kept, double *best, int64_t *best_span, double *best_x, double *largest,
                      double *jerk, double *feed, double *feed_place, double *course, double *mean, double *mean_slack,
                      double *work, const double *d, const double *p)
{
    const States states = {room * k, dim, tip, d, p, rates, slack, k};
    const Found found = {spans, candidates, ends, kept, best, best_span, best_x, largest, jerk, feed, feed_place, course, work};
    for (int64_t i = 0, at = window[0]; i < window[1]; i++, at++) {
        if (k == USUAL) { /* the same with loops of which the compiler knows how long they are */
            scan_points(&states, i, at, USUAL, x + i * k, &found);
            scan_tops(dim, at, USUAL, x + i * k, &found);
        } else {
            scan_points(&states, i, at, k, x + i * k, &found);
            scan_tops(dim, at, k, x + i * k, &found);
        }
        if (lower[at] == 0.0 && upper[at] == 1.0)
            mean_jerks(&states, i * k, i * k + k - 1, quintic_of(table, interval[at]), u_ends + at, gap[at], spans, mean + at,
                       mean_slack + at);
    }
}

#include "planner/core.h"
#include "planner/verify/law_inline.h"
#include "planner/verify/peaks_inline.h"
#include "planner/verify/verify.h"

#define INLINED static inline __attribute__((always_inline))

static const double CLIMB_SHRINK = 3.0; /* of the half widths each round: the spacing is a quarter of them */

static inline double within(double x, double low, double high) { return smaller(larger(x, low), high); }

/* Squares of the distances of count points, points[j] (count) their coordinates j, from the segment from begin to end. */
static inline void squared_distances(int64_t dim, int64_t count, const double *begin, const double *end,
                                     const double *points, int64_t apart, double *restrict squared, double *restrict share)
{
    double length = 0.0;
    for (int64_t j = 0; j < dim; j++)
        length += square(end[j] - begin[j]);
    const double scale = length > 0.0 ? 1.0 / length : 0.0;
    for (int64_t k = 0; k < count; k++)
        share[k] = squared[k] = 0.0;
    for (int64_t j = 0; j < dim; j++)
        for (int64_t k = 0; k < count; k++)
            share[k] += (points[j * apart + k] - begin[j]) * (end[j] - begin[j]);
    for (int64_t k = 0; k < count; k++)
        share[k] = smaller(larger(share[k] * scale, 0.0), 1.0);
    for (int64_t j = 0; j < dim; j++)
        for (int64_t k = 0; k < count; k++)
            squared[k] += square(points[j * apart + k] - begin[j] - share[k] * (end[j] - begin[j]));
}

/* A group of chords, coordinate by coordinate: the same point of all of them in a row.  Of coordinate j point q stride + r of the
 * group is the q-th of phase r, lanes[(j stride + r) phase + q]. */
typedef struct {
    int64_t chords, dim, stride, parts, phase;
    int64_t row; /* numbers of a coordinate */
    double *lanes;
} Group;

static void group_load(const Group *group, const double *points)
{
    const int64_t count = (group->chords - 1) * group->stride + group->parts + 1;
    for (int64_t j = 0; j < group->dim; j++)
        for (int64_t r = 0; r < group->stride; r++) {
            double *row = group->lanes + j * group->row + r * group->phase;
            for (int64_t k = r; k < count; k += group->stride)
                *row++ = points[k * group->dim + j];
        }
}

/* The projections of points onto chords, and what is left of them, a coordinate each. */
INLINED void add_product(int64_t n, const double *begin, const double *end, const double *here, double *restrict sum)
{
    for (int64_t i = 0; i < n; i++)
        sum[i] += (here[i] - begin[i]) * (end[i] - begin[i]);
}

INLINED void add_rest(int64_t n, const double *begin, const double *end, const double *here, const double *share,
                      double *restrict sum)
{
    for (int64_t i = 0; i < n; i++)
        sum[i] += square(here[i] - begin[i] - share[i] * (end[i] - begin[i]));
}

/* Heights of a group of chords. */
INLINED void group_heights(const Group *group, double *restrict height, int64_t *restrict top, double *work)
{
    const int64_t chords = group->chords, dim = group->dim, parts = group->parts, row = group->row;
    const double *begin = group->lanes, *end = begin + parts % group->stride * group->phase + parts / group->stride;
    double *restrict squared = work, *restrict scale = work + (parts + 1) * chords, *restrict share = scale + chords;
    for (int64_t i = 0; i < chords; i++)
        scale[i] = height[i] = 0.0;
    for (int64_t j = 0; j < dim; j++)
        add_product(chords, begin + j * row, end + j * row, end + j * row, scale);
    for (int64_t i = 0; i < chords; i++) {
        scale[i] = scale[i] > 0.0 ? 1.0 / scale[i] : 0.0;
        top[i] = 0;
    }
    for (int64_t k = 0, r = 0, q = 0; k <= parts; k++, r++) {
        if (r == group->stride) {
            r = 0;
            q++;
        }
        const double *here = begin + r * group->phase + q;
        double *restrict apart = squared + k * chords;
        for (int64_t i = 0; i < chords; i++)
            share[i] = apart[i] = 0.0;
        for (int64_t j = 0; j < dim; j++)
            add_product(chords, begin + j * row, end + j * row, here + j * row, share);
        for (int64_t i = 0; i < chords; i++)
            share[i] = smaller(larger(share[i] * scale[i], 0.0), 1.0);
        for (int64_t j = 0; j < dim; j++)
            add_rest(chords, begin + j * row, end + j * row, here + j * row, share, apart);
        for (int64_t i = 0; i < chords; i++) {
            top[i] = apart[i] > height[i] ? k : top[i];
            height[i] = larger(height[i], apart[i]);
        }
    }
    for (int64_t i = 0; i < chords; i++) {
        double near[3]; /* what the parabola takes */
        const int64_t here = top[i], inside = here > 0 && here < parts;
        for (int64_t k = -inside; k <= inside; k++)
            near[inside + k] = sqrt(squared[(here + k) * chords + i]);
        height[i] = peak(1 + 2 * inside, near, inside);
    }
}

HOT void chord_heights(int64_t n, int64_t chords, int64_t dim, int64_t stride, int64_t parts, const double *points,
                       double *height, int64_t *top, double *work)
{
    const int64_t count = (chords - 1) * stride + parts + 1, phase = (count + stride - 1) / stride;
    const Group group = {chords, dim, stride, parts, phase, stride * phase, work};
    for (int64_t i = 0; i < n; i++) {
        group_load(&group, points + i * count * dim);
        group_heights(&group, height + i * chords, top + i * chords, work + dim * stride * phase);
    }
}

void chord_trials(int64_t intervals, const double *table, const double *begin, double low, double high, double period, int64_t n,
                  int64_t m, const double *steps, const double *halves, const double *start, const double *share, double *u)
{
    const Quintic *last = quintic_of(table, intervals - 1);
    const double end = last->start + last->h;
    int64_t interval = 0;
    for (int64_t i = 0; i < n; i++)
        for (int64_t chord = 0; chord < m; chord++) {
            const double t = within(start[i] + halves[0] * steps[chord], 0.0, end);
            for (int64_t k = 0; k < m + 2; k++) {
                const double place = k < 2 ? (double)k : within(share[i] + halves[1] * steps[k - 2], 0.0, 1.0);
                const double x = locate(table, intervals, begin, smaller(t + place * period, end), &interval);
                *u++ = within(quintic_value(quintic_of(table, interval), x), low, high);
            }
        }
}

HOT void chord_choose(int64_t n, int64_t m, int64_t dim, const double *steps, double end, double *halves, double *start,
                      double *share, double *height, double *work, const double *points)
{
    double *coordinates = work, *squared = work + dim * m, *along = squared + m;
    for (int64_t i = 0; i < n; i++) {
        int64_t best = 0, place = 0;
        height[i] = -1.0;
        for (int64_t chord = 0; chord < m; chord++) {
            const double *begin = points + (i * m + chord) * (m + 2) * dim, *between = begin + 2 * dim;
            for (int64_t j = 0; j < dim; j++)
                for (int64_t k = 0; k < m; k++)
                    coordinates[j * m + k] = between[k * dim + j];
            squared_distances(dim, m, begin, begin + dim, coordinates, m, squared, along);
            const int64_t here = highest(m, squared);
            if (squared[here] > height[i]) {
                height[i] = squared[here];
                best = chord;
                place = here;
            }
        }
        height[i] = sqrt(height[i]);
        start[i] = within(start[i] + halves[0] * steps[best], 0.0, end);
        share[i] = within(share[i] + halves[1] * steps[place], 0.0, 1.0);
    }
    halves[0] /= CLIMB_SHRINK;
    halves[1] /= CLIMB_SHRINK;
}

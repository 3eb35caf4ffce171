#include "planner/programs/path/path.h"

#include "planner/core.h"

#define SLIDE 16         /* vertices on either side */
#define LONGEST_RUN 1024 /* blocks looked at for one line, but for the first of a run */

/* Columns of the rows. */
enum { LENGTH, BOW, FEED, TOLERANCE, OFF, ALIKE, COLUMNS };

typedef struct {
    int64_t dim;
    const double *points, *rows;
    double share;
} Polyline;

/* Distance of the blocks i to j - 1 from one line between their ends; inf where they may not become that line.
 *
 * Points of the line go with the vertices in their order, so the distance holds in both directions. */
static double strip_width(const Polyline *path, int64_t i, int64_t j)
{
    const double *rows = path->rows, *begin = path->points + i * path->dim, *end = path->points + j * path->dim;
    if (j == i + 1)
        return rows[i * COLUMNS + OFF];
    double squared = 0.0, least = rows[i * COLUMNS + TOLERANCE], off = 0.0;
    const double *longest = rows + i * COLUMNS;
    for (int64_t a = 0; a < path->dim; a++)
        squared += square(end[a] - begin[a]);
    for (int64_t k = i; k < j; k++) {
        const double *row = rows + k * COLUMNS;
        longest = row[LENGTH] > longest[LENGTH] ? row : longest;
        least = smaller(least, row[TOLERANCE]);
        off = larger(off, row[BOW] + row[OFF]);
    }
    if (squared == 0.0 || off > path->share * least)
        return INFINITY;
    const double room = path->share * least - off;
    double along = 0.0, worst = 0.0;
    for (int64_t k = i; k < j; k++) {
        const double *row = rows + k * COLUMNS, *p = path->points + k * path->dim;
        if (row[FEED] != longest[FEED] && row[LENGTH] > row[ALIKE])
            return INFINITY;
        if (k == i)
            continue;
        double at = 0.0, away = 0.0;
        for (int64_t a = 0; a < path->dim; a++)
            at += (p[a] - begin[a]) * (end[a] - begin[a]);
        along = smaller(1.0, larger(along, at / squared));
        for (int64_t a = 0; a < path->dim; a++)
            away += square(p[a] - begin[a] - along * (end[a] - begin[a]));
        worst = larger(worst, away);
        if (worst > room * room)
            return INFINITY;
    }
    return sqrt(worst) + off;
}

/* Move every vertex that stays between begin and end to the neighbour that leaves the least distance. */
static void slide(const Polyline *path, const uint8_t *loose, int64_t begin, int64_t end, uint8_t *kept)
{
    int64_t before = begin;
    for (int64_t k = begin + 1; k < end; k++) {
        if (!kept[k] || !loose[k])
            continue;
        int64_t after = k + 1, place = k;
        while (!kept[after])
            after++;
        const int64_t first = before + 1 > k - SLIDE ? before + 1 : k - SLIDE;
        const int64_t last = after < k + SLIDE + 1 ? after : k + SLIDE + 1;
        double best = INFINITY;
        for (int64_t c = first; c < last; c++) {
            const double width = larger(strip_width(path, before, c), strip_width(path, c, after));
            if (width < best) {
                best = width;
                place = c;
            }
        }
        kept[k] = 0;
        kept[place] = 1;
        before = place;
        k = place > k ? place : k;
    }
}

/* How many blocks from i on one line may replace, most of all: halved until it may, then what bisection finds. */
static int64_t run_from(const Polyline *path, int64_t i, int64_t most)
{
    int64_t step = most, failed = most + 1;
    while (step > 1 && strip_width(path, i, i + step) == INFINITY) {
        failed = step;
        step /= 2;
    }
    while (failed - step > 1) {
        const int64_t middle = (step + failed) / 2;
        if (strip_width(path, i, i + middle) < INFINITY)
            step = middle;
        else
            failed = middle;
    }
    return step;
}

/* Between two vertices that are not loose, lines as long as possible within the share of the tolerance replace the
 * blocks; then each vertex between two of them moves to the neighbour that leaves the least distance. */
void absorb_runs(int64_t blocks, int64_t dim, const double *points, const double *rows, const uint8_t *loose,
                 double share, uint8_t *kept)
{
    const Polyline path = {dim, points, rows, share};
    for (int64_t k = 0; k <= blocks; k++)
        kept[k] = 1;
    for (int64_t begin = 0, end; begin < blocks; begin = end) {
        end = begin + 1;
        while (end < blocks && loose[end])
            end++;
        if (end == begin + 1)
            continue;
        for (int64_t i = begin; i < end;) {
            /* Zigzags lie about their mean, not about the lines between their vertices: the long lines come first. */
            const int64_t left = end - i, most = i == begin || left < LONGEST_RUN ? left : LONGEST_RUN;
            const int64_t step = run_from(&path, i, most);
            for (int64_t k = i + 1; k < i + step; k++)
                kept[k] = 0;
            i += step;
        }
        slide(&path, loose, begin, end, kept);
    }
}

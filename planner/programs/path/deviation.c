#include "planner/programs/path/path.h"

#include "planner/geometry/blend_inline.h"

#define FAR 1e300      /* no distance is as large */
#define SCAN_ANGLE 0.5 /* rad between looks at a curved leg */
#define SCAN_CURVE 24  /* parts of a curve between looks at it */
#define PASSES 8       /* of Gauss-Newton */
#define MIN_BEND 0.1   /* of the square of the slope: below that Newton's step may lead uphill */
#define ROUNDING 1e-6  /* of a way, on the safe side */

/* Squared distance from p to the points start + x direction, lo <= x <= hi, of a unit direction. */
static double to_segment(int64_t dim, const double *p, double lo, double hi, const double *start,
                         const double *direction)
{
    double x = 0.0, total = 0.0;
    for (int64_t j = 0; j < dim; j++)
        x += (p[j] - start[j]) * direction[j];
    x = smaller(larger(x, lo), hi);
    for (int64_t j = 0; j < dim; j++)
        total += square(start[j] + x * direction[j] - p[j]);
    return total;
}

/* Squared distance from p to a curved leg at x: centre + (1 + k x) (a cos w x + b sin w x) + c x. */
static double to_leg_at(int64_t dim, const double *p, double x, const double *vectors, double w, double k)
{
    const double *centre = vectors, *a = vectors + dim, *b = vectors + 2 * dim, *along = vectors + 3 * dim;
    const double c = cos(w * x), s = sin(w * x);
    double total = 0.0;
    for (int64_t j = 0; j < dim; j++)
        total += square(centre[j] + (1.0 + k * x) * (a[j] * c + b[j] * s) + along[j] * x - p[j]);
    return total;
}

/* Gauss-Newton from x on a curved leg towards the point nearest to p. */
static double nearer(int64_t dim, const double *p, double x, const double *vectors, double w, double k)
{
    const double *centre = vectors, *a = vectors + dim, *b = vectors + 2 * dim, *along = vectors + 3 * dim;
    const double c = cos(w * x), s = sin(w * x), growth = 1.0 + k * x;
    double slope = 0.0, squares = 0.0, bend = 0.0;
    for (int64_t j = 0; j < dim; j++) {
        const double circle = a[j] * c + b[j] * s, turned = w * (b[j] * c - a[j] * s);
        const double away = centre[j] + growth * circle + along[j] * x - p[j];
        const double d1 = growth * turned + k * circle + along[j];
        const double d2 = 2.0 * k * turned - growth * w * w * circle;
        slope += away * d1;
        squares += d1 * d1;
        bend += away * d2;
    }
    double curvature = squares + bend;
    if (curvature < MIN_BEND * squares)
        curvature = squares;
    return x - slope / curvature;
}

/* Squared distance from p to a curved leg between lo and hi: scanned, then Gauss-Newton on the nearest part. */
static double to_curve(int64_t dim, const double *p, double lo, double hi, const double *vectors, const double *rates)
{
    const double w = rates[0], k = rates[1];
    const int64_t count = 1 + (int64_t)(fabs(w) * (hi - lo) / SCAN_ANGLE);
    double best = FAR, x = lo;
    for (int64_t i = 0; i <= count; i++) {
        const double at = lo + (hi - lo) * (double)i / (double)count;
        const double total = to_leg_at(dim, p, at, vectors, w, k);
        if (total < best) {
            best = total;
            x = at;
        }
    }
    for (int pass = 0; pass < PASSES; pass++) {
        x = smaller(larger(nearer(dim, p, x, vectors, w, k), lo), hi);
        best = smaller(best, to_leg_at(dim, p, x, vectors, w, k));
    }
    return best;
}

/* Squared distance from p, counted from the start of a curve, to it at w; and where Gauss-Newton leads from there. */
static double to_bezier_at(const Beziers *beziers, int64_t curve, const double *p, double w, double *next)
{
    Derivatives d;
    bezier_over_parameter(beziers, curve, w, d);
    double total = 0.0, slope = 0.0, squares = 0.0, bend = 0.0;
    for (int64_t j = 0; j < beziers->dim; j++) {
        const double away = d[0][j] - p[j];
        total += square(away);
        slope += away * d[1][j];
        squares += square(d[1][j]);
        bend += away * d[2][j];
    }
    const double curvature = squares + bend < MIN_BEND * squares ? squares : squares + bend;
    *next = w - slope / curvature;
    return total;
}

/* Squared distance from p to a stretch of a curve between lo and hi: as to_curve, over the curve's own parameter. */
static double to_stretch(const Leg *leg, const double *point, double lo, double hi)
{
    const int64_t curve = (int64_t)leg->way[0];
    double p[CHAIN_COLUMNS], best = FAR, nearest = 0.0, next;
    for (int64_t j = 0; j < leg->dim; j++)
        p[j] = point[j] - leg->vectors[j];
    int64_t panel = 0;
    const double a = bezier_parameter(leg->beziers, curve, leg->way[1] + leg->way[2] * lo, &panel);
    const double b = bezier_parameter(leg->beziers, curve, leg->way[1] + leg->way[2] * hi, &panel);
    const double first = smaller(a, b), last = larger(a, b);
    for (int64_t i = 0; i <= SCAN_CURVE; i++) {
        const double w = first + (last - first) * (double)i / SCAN_CURVE;
        const double total = to_bezier_at(leg->beziers, curve, p, w, &next);
        if (total < best) {
            best = total;
            nearest = next;
        }
    }
    for (int pass = 0; pass < PASSES; pass++) {
        const double w = smaller(larger(nearest, first), last);
        best = smaller(best, to_bezier_at(leg->beziers, curve, p, w, &nearest));
    }
    return best;
}

/* The blocks of a program. */
typedef struct {
    int64_t count, dim;
    const double *edges, *vectors, *rates, *ways;
    const Beziers *beziers;
} Blocks;

static inline Leg leg_of(const Blocks *blocks, int64_t i)
{
    const Leg leg = {blocks->dim, blocks->vectors + i * 4 * blocks->dim, blocks->rates + 2 * i,
                     blocks->ways ? blocks->ways + 3 * i : blocks->ways, blocks->beziers};
    return leg;
}

/* Index of the block in which an abscissa lies; the first or last beyond the ends. */
static int64_t block_at(const Blocks *blocks, double abscissa)
{
    int64_t lo = 0, hi = blocks->count;
    while (hi - lo > 1) {
        const int64_t mid = (lo + hi) / 2;
        if (blocks->edges[mid] <= abscissa)
            lo = mid;
        else
            hi = mid;
    }
    return lo;
}

/* Squared distance from p to block i within the abscissae low to high. */
static double to_block(const Blocks *blocks, int64_t i, const double *p, double low, double high)
{
    const double *edges = blocks->edges;
    const Leg leg = leg_of(blocks, i);
    const double begin = larger(0.0, low - edges[i]), end = smaller(edges[i + 1], high) - edges[i];
    if (is_stretch(&leg))
        return to_stretch(&leg, p, begin, end);
    return leg.rates[0] == 0.0 ? to_segment(blocks->dim, p, begin, end, leg.vectors, leg.vectors + 3 * blocks->dim)
                               : to_curve(blocks->dim, p, begin, end, leg.vectors, leg.rates);
}

/* Whether block i is a line. */
static int is_line(const Blocks *blocks, int64_t i)
{
    return blocks->rates[2 * i] == 0.0 && !(blocks->ways && blocks->ways[3 * i] >= 0.0);
}

/* The first block from i on that may be nearer to p than so much.
 *
 * Along lines, each from the end of the last, nothing is nearer to p than the start of the first less the way from there. */
static int64_t next_near(const Blocks *blocks, int64_t i, const double *p, double near)
{
    if (!is_line(blocks, i))
        return i;
    const double *start = blocks->vectors + i * 4 * blocks->dim;
    double squared = 0.0;
    for (int64_t j = 0; j < blocks->dim; j++)
        squared += square(p[j] - start[j]);
    if (!(squared > near * near))
        return i;
    const double free = blocks->edges[i] + (1.0 - ROUNDING) * (sqrt(squared) - near);
    while (i < blocks->count && is_line(blocks, i) && blocks->edges[i + 1] < free)
        i++;
    return i;
}

void deviation_to_blocks(int64_t blocks, int64_t dim, const double *edges, const double *vectors, const double *rates,
                         const double *ways, int64_t terms, const double *powers, const double *curve_length,
                         const int64_t *first_curve_panel, const double *curve_edges, const double *curve_panels,
                         int64_t n, const double *points, const double *abscissa, const double *window, double *out)
{
    const Beziers beziers = {dim, terms, powers, curve_length, first_curve_panel, curve_edges, curve_panels, 0};
    const Blocks path = {blocks, dim, edges, vectors, rates, ways, &beziers};
    for (int64_t m = 0; m < n; m++) {
        const double low = abscissa[m] - window[m], high = abscissa[m] + window[m];
        const double *p = points + m * dim;
        const int64_t first = block_at(&path, low);
        /* What lies at the abscissa itself is near, and most of the others need no look then. */
        double near = sqrt(to_block(&path, block_at(&path, abscissa[m]), p, low, high));
        for (int64_t i = first; i < blocks && (edges[i] <= high || i == first); i++) {
            i = next_near(&path, i, p, near);
            if (i < blocks && (edges[i] <= high || i == first))
                near = smaller(near, sqrt(to_block(&path, i, p, low, high)));
        }
        out[m] = near;
    }
}

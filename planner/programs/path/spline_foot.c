/* Places of a quartic spline, and distances of points to it: the search of foot_distance in deviation.py, point by point. */
#include "planner/programs/path/path.h"

#include "planner/core.h"

static const double CONVEX = 0.2;
static const double SETTLED = 1e-9; /* of the distance, by which another step could shorten it */
enum { PASSES = 8 };

/* The span whose half-open stretch of knots (spans + 1) holds s; the first or last beyond the ends. */
static int64_t span_of(int64_t spans, const double *knots, double s) {
    int64_t lo = 0, hi = spans;
    while (hi - lo > 1) {
        const int64_t middle = lo + (hi - lo) / 2;
        if (knots[middle] <= s) lo = middle;
        else hi = middle;
    }
    return lo;
}

static double place_of(const double *c, double w) { return c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * c[4]))); }

void spline_places(int64_t spans, int64_t dim, const double *knots, const double *powers, int64_t n, const double *s,
                   double *restrict out) {
    for (int64_t i = 0; i < n; i++) {
        const int64_t k = span_of(spans, knots, s[i]);
        const double w = (s[i] - knots[k]) / (knots[k + 1] - knots[k]);
        for (int64_t j = 0; j < dim; j++) out[i * dim + j] = place_of(powers + (k * dim + j) * 5, w);
    }
}

/* At a place: the square of the distance, of the speed, and the products of what lies between with the speed and the bend. */
typedef struct {
    double distance, speed, along, bend;
} Foot;

static Foot foot_at(int64_t spans, int64_t dim, const double *knots, const double *powers, const double *point, double s) {
    const int64_t k = span_of(spans, knots, s);
    const double width = knots[k + 1] - knots[k], w = (s - knots[k]) / width;
    Foot foot = {0.0, 0.0, 0.0, 0.0};
    for (int64_t j = 0; j < dim; j++) {
        const double *c = powers + (k * dim + j) * 5;
        const double away = place_of(c, w) - point[j];
        const double first = (c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * 4.0 * c[4]))) / width;
        const double second = (2.0 * c[2] + w * (6.0 * c[3] + w * 12.0 * c[4])) / square(width);
        foot.distance += away * away;
        foot.speed += first * first;
        foot.along += away * first;
        foot.bend += away * second;
    }
    return foot;
}

void spline_distances(int64_t spans, int64_t dim, const double *knots, const double *powers, int64_t n,
                      const double *points, const double *s, const double *lo, const double *hi, double *restrict out) {
    for (int64_t i = 0; i < n; i++) {
        double at = s[i], x = s[i], best = INFINITY;
        for (int pass = 0;; pass++) {
            const Foot foot = foot_at(spans, dim, knots, powers, points + i * dim, x);
            const double distance = sqrt(foot.distance);
            const int nearer = distance < best;
            if (nearer) {
                at = x;
                best = distance;
            }
            if (pass == PASSES) break;
            const double convex = foot.speed + foot.bend, slope = convex > CONVEX * foot.speed ? convex : foot.speed;
            const double step = smaller(larger(x - foot.along / slope, lo[i]), hi[i]);
            /* a step that led away is halved, from the best place so far */
            const double following = nearer ? step : 0.5 * (at + x);
            const double reach = fabs(following - x) * sqrt(foot.speed);
            x = following;
            if (!(reach * smaller(reach, best) > SETTLED * square(best))) break;
        }
        out[i] = best;
    }
}

#include "planner/plan/solvers/solvers.h"

#include "planner/core.h"

#define MAX_STEPS 200    /* of Newton; as many as there are lines at most, but for rounding */
#define NEAR_BOUND 0.98  /* of a row's bound, from which on a law is taken to follow it */
#define MAX_LEAN 0.5     /* of x / h: x does not bend back within an interval */
#define ROUNDING 1e-12   /* of the largest x, by which the least may lie above it */

typedef struct {
    int64_t count, n, points;
    const double *rows, *bounds, *cap, *offset;
} Stage;

/* Range of a on an interval, and how fast its ends move with x. */
typedef struct {
    double low, high, low_slope, high_slope;
} Range;

/* Coefficient of x (part 0) or of its half slope (part 1) in a row at a point. */
static inline double row_at(const Stage *s, int64_t row, int64_t part, int64_t k, int64_t p)
{
    return s->rows[((2 * row + part) * s->n + k) * s->points + p];
}

/* Range of a on interval k from x: rows and 0 <= x <= cap at all of its points, and floor <= next x <= ceiling. */
static Range control_range(const Stage *s, int64_t k, double lean, double x, double floor, double ceiling)
{
    const double *offset = s->offset + k * s->points, *cap = s->cap + k * s->points;
    const double twice = 2.0 * offset[s->points - 1];
    Range found = {(floor - x) / twice, (ceiling - x) / twice, -1.0 / twice, -1.0 / twice};
    for (int64_t p = 0; p < s->points; p++) {
        const double reach = 2.0 * offset[p];
        const double bump = lean * reach * (1.0 - reach / twice), tilt = lean * (1.0 - 2.0 * reach / twice);
        if (reach > 0.0) {
            if (cap[p] - bump - x < found.high * reach) {
                found.high = (cap[p] - bump - x) / reach;
                found.high_slope = -1.0 / reach;
            }
            if (-bump - x > found.low * reach) {
                found.low = (-bump - x) / reach;
                found.low_slope = -1.0 / reach;
            }
        }
        for (int64_t r = 0; r < s->count; r++) {
            double alpha = row_at(s, r, 0, k, p), beta = row_at(s, r, 1, k, p);
            double shift = alpha * bump + beta * tilt, most = s->bounds[2 * r], least = s->bounds[2 * r + 1];
            beta += reach * alpha;
            if (beta < 0.0) {
                const double upper = most;
                alpha = -alpha;
                beta = -beta;
                shift = -shift;
                most = least;
                least = upper;
            }
            if (!(beta > 0.0))
                continue;
            const double lower = (-least - shift - alpha * x) / beta, upper = (most - shift - alpha * x) / beta;
            if (lower > found.low) {
                found.low = lower;
                found.low_slope = -alpha / beta;
            }
            if (upper < found.high) {
                found.high = upper;
                found.high_slope = -alpha / beta;
            }
        }
    }
    return found;
}

/* Extreme x at the left of interval k from which its right end can be reached: from above (sign 1) or below (-1).
 *
 * The width of the range of controls is a concave function of x, made of straight lines, so that Newton's iteration
 * from outside meets its zero in as many steps as there are lines, at most (Pham and Pham, TOPP-RA, IEEE T-RO 34
 * (2018)). */
static double extreme(const Stage *s, int64_t k, double lean, double x, double sign, double floor, double ceiling)
{
    for (int step = 0; step < MAX_STEPS; step++) {
        const Range range = control_range(s, k, lean, x, floor, ceiling);
        if (!(range.low > range.high))
            return x;
        const double closing = sign * (range.low_slope - range.high_slope);
        if (!(closing > 0.0))
            return sign < 0.0 ? NAN : 0.0;
        const double following = x - sign * (range.low - range.high) / closing;
        if (sign > 0.0 && !(0.0 < following && following < x))
            return larger(smaller(following, x), 0.0);
        if (sign < 0.0 && !(following > x))
            return x;
        x = following;
    }
    return x;
}

/* Largest x at the left of interval k by its caps and by rows in which the control has no say; these forbid a lean. */
static double top_of(const Stage *s, int64_t k, double *lean)
{
    const int64_t last = s->points - 1;
    double top = s->cap[k * s->points];
    if (k > 0)
        top = smaller(top, s->cap[(k - 1) * s->points + last]);
    for (int64_t r = 0; r < s->count; r++)
        for (int64_t p = 0; p <= last; p++) {
            const double alpha = row_at(s, r, 0, k, p);
            if (alpha == 0.0 || row_at(s, r, 1, k, p) + 2.0 * s->offset[k * s->points + p] * alpha != 0.0)
                continue;
            *lean = 0.0;
            top = smaller(top, alpha > 0.0 ? s->bounds[2 * r] / alpha : -s->bounds[2 * r + 1] / alpha);
        }
    return top;
}

void accelerations_controllable(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                                const double *cap, const double *offset, double *lean, double slowest, double fastest,
                                double *reach)
{
    const Stage stage = {count, n, points, rows, bounds, cap, offset};
    double *least = reach, *largest = reach + n + 1;
    least[n] = slowest;
    largest[n] = fastest;
    for (int64_t k = n - 1; k >= 0; k--) {
        const double floor = least[k + 1], ceiling = smaller(largest[k + 1], cap[k * points + points - 1]);
        const double top = top_of(&stage, k, lean + k);
        if (lean[k] != 0.0) {
            const Range at_rest = control_range(&stage, k, lean[k], 0.0, 0.0, ceiling);
            if (!(at_rest.low <= at_rest.high))
                lean[k] = 0.0;
        }
        largest[k] = extreme(&stage, k, lean[k], top, 1.0, floor, ceiling);
        least[k] = floor > 0.0 ? extreme(&stage, k, lean[k], 0.0, -1.0, floor, ceiling) : 0.0;
        if (!(least[k] <= largest[k] * (1.0 + ROUNDING))) {
            for (int64_t i = 0; i <= k; i++)
                least[i] = largest[i] = NAN;
            return;
        }
    }
}

void accelerations_fastest(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                           const double *cap, const double *offset, const double *lean, const double *reach,
                           double start, double *x)
{
    const Stage stage = {count, n, points, rows, bounds, cap, offset};
    const double *least = reach, *largest = reach + n + 1;
    x[0] = start;
    for (int64_t k = 0; k < n; k++) {
        const Range range = control_range(&stage, k, lean[k], x[k], least[k + 1], largest[k + 1]);
        const double following = x[k] + 2.0 * offset[k * points + points - 1] * range.high;
        x[k + 1] = smaller(larger(following, least[k + 1]), largest[k + 1]);
    }
}

/* Along a smooth row at its bound b a is (b - alpha x) / beta at both ends; half their difference is the lean. */
void accelerations_follow_rows(int64_t count, int64_t n, int64_t points, const double *rows, const double *bounds,
                               const double *offset, const double *x, const double *lean, double *out)
{
    const Stage stage = {count, n, points, rows, bounds, 0, offset};
    const int64_t last = points - 1;
    for (int64_t k = 0; k < n; k++) {
        const double h = offset[k * points + last], a = 0.5 * (x[k + 1] - x[k]) / h;
        out[k] = 0.0;
        if (!(x[k] > 0.0 && x[k + 1] > 0.0))
            continue;
        double nearest = NEAR_BOUND, bound = 1.0;
        int64_t which = -1;
        for (int64_t r = 0; r < count; r++)
            for (int64_t p = 0; p <= last; p++) {
                const double w = offset[k * points + p];
                const double here = x[k] + 2.0 * w * (a + lean[k] * (1.0 - w / h));
                const double slope = a + lean[k] * (1.0 - 2.0 * w / h);
                const double value = row_at(&stage, r, 0, k, p) * here + row_at(&stage, r, 1, k, p) * slope;
                const double most = value > 0.0 ? bounds[2 * r] : -bounds[2 * r + 1];
                const double share = value / most;
                if (share > nearest) {
                    nearest = share;
                    which = r;
                    bound = most;
                }
            }
        if (which < 0)
            continue;
        const double first = row_at(&stage, which, 1, k, 0), second = row_at(&stage, which, 1, k, last);
        if (!(first * second > 0.0))
            continue;
        const double begin = (bound - row_at(&stage, which, 0, k, 0) * x[k]) / first;
        const double end = (bound - row_at(&stage, which, 0, k, last) * x[k + 1]) / second;
        const double most = MAX_LEAN * smaller(x[k], x[k + 1]) / h;
        out[k] = smaller(larger(0.5 * (begin - end), -most), most);
    }
}

#include "planner/geometry/geometry.h"

#include "planner/geometry/curve_inline.h"

/* Newton converges in 3-5 passes; bisection, which takes over where it leaves the bracket, in 60. */
#define MAX_PASSES 100
#define CLOSE 4e-16 /* of the panel's half: rounding */

/* Value of a Chebyshev series at x in [-1, 1], by Clenshaw's recurrence. */
static double clenshaw(const double *series, int64_t terms, double x)
{
    double b1 = 0.0, b2 = 0.0;
    for (int64_t k = terms - 1; k > 0; k--) {
        const double b0 = series[k] + 2.0 * x * b1 - b2;
        b2 = b1;
        b1 = b0;
    }
    return series[0] + x * b1 - b2;
}

void arclength_at(int64_t panels, int64_t terms, const double *edges, const double *lengths, const double *series,
                  int64_t n, const double *u, double *out)
{
    int64_t panel = 0;
    for (int64_t i = 0; i < n; i++) {
        panel = find_piece(panels, edges, u[i], 0, panel);
        const double begin = edges[panel], end = edges[panel + 1];
        if (u[i] <= begin) {
            out[i] = lengths[panel];
        } else if (u[i] >= end) {
            out[i] = lengths[panel + 1];
        } else {
            const double x = 2.0 * (u[i] - begin) / (end - begin) - 1.0;
            const double length = lengths[panel] + clenshaw(series + panel * terms, terms, x);
            out[i] = smaller(larger(length, lengths[panel]), lengths[panel + 1]);
        }
    }
}

/* Place x in [-1, 1] of a panel at which its length is the target, of a positive total: Newton, with bisection where
 * that leaves the bracket. */
static double place_of_length(int64_t terms, int64_t speed_terms, const double *series, const double *speeds,
                              double half, double target, double total)
{
    double lo = -1.0, hi = 1.0, x = 2.0 * target / total - 1.0;
    for (int pass = 0; pass < MAX_PASSES; pass++) {
        const double error = clenshaw(series, terms, x) - target;
        if (error > 0.0)
            hi = x;
        else
            lo = x;
        const double slope = clenshaw(speeds, speed_terms, x) * half;
        const double step = slope > 0.0 ? -error / slope : 4.0; /* beyond any bracket */
        if (fabs(step) <= CLOSE || hi - lo <= CLOSE)
            break;
        const double trial = x + step;
        x = lo <= trial && trial <= hi ? trial : 0.5 * (lo + hi);
    }
    return x;
}

/* The lengths at the edges give the edges themselves, so breaks are met exactly. */
void arclength_inverse(int64_t panels, int64_t terms, int64_t speed_terms, const double *edges, const double *lengths,
                       const double *series, const double *speeds, int64_t n, const double *s, int64_t left,
                       double *out)
{
    int64_t panel = 0;
    for (int64_t i = 0; i < n; i++) {
        panel = find_piece(panels, lengths, s[i], left != 0, panel);
        const double begin = edges[panel], end = edges[panel + 1];
        const double target = s[i] - lengths[panel], total = lengths[panel + 1] - lengths[panel];
        if (target >= total && (total > 0.0 || !left)) {
            out[i] = end;
        } else if (target <= 0.0) {
            out[i] = begin;
        } else {
            const double half = 0.5 * (end - begin);
            const double x = place_of_length(terms, speed_terms, series + panel * terms, speeds + panel * speed_terms,
                                             half, target, total);
            out[i] = smaller(larger(begin + half * (x + 1.0), begin), end);
        }
    }
}

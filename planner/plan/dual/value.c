#include "planner/plan/dual/dual.h"

#include "planner/plan/dual/track_inline.h"

/* Value and first two derivatives of a quadratic with Bernstein coefficients a, b, c on a cell of length h, at r. */
typedef struct {
    double value, slope, bend;
} Quadratic;

static inline Quadratic quadratic_at(double a, double b, double c, double r, double h)
{
    const double s = 1.0 - r;
    const Quadratic found = {s * s * a + 2.0 * r * s * b + r * r * c, 2.0 * (s * (b - a) + r * (c - b)) / h,
                             2.0 * (a - 2.0 * b + c) / (h * h)};
    return found;
}

void value_integrand(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces,
                     int64_t terms, const double *breaks, const double *coefficients, int64_t rational,
                     const uint8_t *resting, const double *origin, int64_t tip_pieces, int64_t tip_dim,
                     int64_t tip_terms, const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                     const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                     const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                     const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                     const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t jerks,
                     const int64_t *jerk_motions, const double *most_jerk, const double *controls,
                     int64_t accelerations, const int64_t *acceleration_motions, const double *most_acceleration,
                     const double *spline, int64_t n, const int64_t *k, const double *r, double *weight, double *pull,
                     double *cap)
{
    const Track track = track_of(cells, motions, sigma, u, pieces, terms, breaks, coefficients, rational,
                                 resting, origin, tip_pieces, tip_dim, tip_terms, tip_breaks, tip_coefficients,
                                 tip_rational, tip_resting, tip_origin, stretches, cap_edges, cap_feed, scalars,
                                 velocity, acceleration, jerk, axis_weight, start_speed, end_speed, way, rise, ramps,
                                 near);
    LastPieces piece = {0, 0};
    for (int64_t i = 0; i < n; i++) {
        TrackPoint at;
        point_on_track(&track, k[i], r[i], &piece, &at);
        const double h = sigma[k[i] + 1] - sigma[k[i]];
        double load = 0.0, by_jerk = 0.0, by_acceleration = 0.0;
        for (int64_t j = 0; j < jerks; j++) {
            const double *a = controls + j * cells + k[i], *b = a + jerks * cells, *c = b + jerks * cells;
            const Quadratic l = quadratic_at(*a, *b, *c, r[i], h);
            const int64_t m = jerk_motions[j];
            load += fabs(l.value);
            by_jerk += (l.bend * at.first[m] - l.slope * at.second[m]) / most_jerk[j];
        }
        for (int64_t j = 0; j < accelerations; j++) {
            const double *ends = spline + j * (cells + 1) + k[i], slope = (ends[1] - ends[0]) / h;
            const double value = ends[0] + (ends[1] - ends[0]) * r[i];
            const int64_t m = acceleration_motions[j];
            by_acceleration += (value * at.second[m] - slope * at.first[m]) / most_acceleration[j];
        }
        weight[i] = 1.0 - load;
        pull[i] = 0.5 * (by_jerk + by_acceleration);
        cap[i] = at.cap;
    }
}

/* For g > 0 the smallest is at x = (w / 2g)^(2/3), where that is below the cap. */
void value_min_price(int64_t n, const double *w, const double *g, const double *cap, double *out)
{
    for (int64_t i = 0; i < n; i++) {
        const double weight = larger(w[i], 0.0);
        if (g[i] > 0.0 && square(0.5 * weight / g[i]) < cap[i] * cap[i] * cap[i])
            out[i] = 3.0 * cbrt(square(0.5 * weight) * g[i]);
        else
            out[i] = weight / sqrt(cap[i]) + (g[i] == 0.0 ? 0.0 : g[i] * cap[i]);
    }
}

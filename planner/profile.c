#include "planner/planner.h"

#include "planner/core.h"

enum { MOST_AXES = 9 };

void profile_jerk(int64_t n, const double *u, const double *rate, const double *acceleration, const uint8_t *forward,
                  const double *duration, const double *powers, double *jerk)
{
    const int64_t m = n - 1;
    double at_end = 0.0;
    for (int64_t i = 0; i < n; i++) {
        jerk[i] = at_end;
        if (i == m)
            return;
        /* quintic_coefficients in law.py */
        const double h = duration[i], v0 = rate[i], v1 = rate[i + 1], a0 = acceleration[i], a1 = acceleration[i + 1];
        const double rest = u[i + 1] - u[i] - h * (v0 + 0.5 * a0 * h), dv = (v1 - v0 - a0 * h) * h;
        const double da = (a1 - a0) * (h * h);
        const double c3 = (10.0 * rest - 4.0 * dv + 0.5 * da) / powers[i];
        const double c4 = (-15.0 * rest + 7.0 * dv - da) / powers[m + i];
        const double c5 = (6.0 * rest - 3.0 * dv + 0.5 * da) / powers[2 * m + i];
        if (forward[i])
            jerk[i] = 6.0 * c3;
        at_end = 6.0 * c3 + h * (24.0 * c4 + h * 60.0 * c5);
    }
}

static inline double dot(const double *a, const double *b, int64_t dim)
{
    double sum = 0.0;
    for (int64_t j = 0; j < dim; j++)
        sum += a[j] * b[j];
    return sum;
}

/* The largest share so far and whose it is; what is no number counts as the largest. */
typedef struct {
    double share;
    int64_t name;
} Most;

static inline void offer(Most *most, double share, int64_t name)
{
    if (most->share == most->share && !(share <= most->share)) {
        most->share = share;
        most->name = name;
    }
}

/* Feed over that at which a chord of one period leaves the osculating circle by the chord error, as in feed_limits.py. */
static double chord_share(const double *d1, const double *d2, int64_t dim, double feed, double error, double period)
{
    const double speed2 = dot(d1, d1, dim), slope = dot(d1, d2, dim) / speed2;
    double normal[MOST_AXES];
    for (int64_t j = 0; j < dim; j++)
        normal[j] = d2[j] - slope * d1[j];
    const double curvature = sqrt(dot(normal, normal, dim)) / speed2;
    if (!(speed2 > 0.0 && curvature > 0.0))
        return 0.0;
    const double radius = 1.0 / curvature, sagitta = error < radius ? error : radius;
    const double share = feed / (2.0 / period * sqrt(sagitta * (2.0 * radius - sagitta)));
    return share <= INFINITY ? share : 0.0;
}

HOT void profile_binding(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip,
                         const double *rates, const double *cube, const double *slowed, const double *slowed_cube,
                         const double *feed, double chord_error, double period, int64_t rows, const double *bounds,
                         const int64_t *kinds, int64_t feed_name, int64_t chord_name, double least, double *along,
                         uint8_t *binding)
{
    for (int64_t i = 0; i < n; i++) {
        const double u1 = rates[i], u2 = rates[n + i], u3 = rates[2 * n + i], u111 = cube[i];
        const double *d1 = tip + (n + i) * tip_dim, *d2 = d1 + n * tip_dim, *d3 = d2 + n * tip_dim;
        const double speed = sqrt(dot(d1, d1, tip_dim)), slope = speed > 0.0 ? dot(d1, d2, tip_dim) / speed : 0.0;
        const double bend =
            speed > 0.0 ? (dot(d2, d2, tip_dim) + dot(d1, d3, tip_dim) - slope * slope) / speed : 0.0;
        const double factors[3] = {slowed ? slowed[i] : 1.0, slowed ? slowed[i] * slowed[i] : 1.0,
                                   slowed ? slowed_cube[i] : 1.0};
        double motion[MOST_AXES + 1][3];
        motion[dim][0] = speed * u1;
        motion[dim][1] = speed * u2 + slope * (u1 * u1);
        motion[dim][2] = speed * u3 + 3.0 * slope * u1 * u2 + bend * u111;
        for (int64_t j = 0; j < dim; j++) {
            const double *of = q + (n + i) * dim + j;
            const double q1 = of[0], q2 = of[n * dim], q3 = of[2 * n * dim];
            motion[j][0] = q1 * u1;
            motion[j][1] = q2 * (u1 * u1) + q1 * u2;
            motion[j][2] = q3 * u111 + 3.0 * q2 * u1 * u2 + q1 * u3;
        }
        Most most = {least, 0};
        offer(&most, motion[dim][0] * factors[0] / feed[i], feed_name);
        if (isfinite(chord_error))
            offer(&most, chord_share(d1, d2, tip_dim, motion[dim][0], chord_error, period) * factors[0], chord_name);
        for (int64_t r = 0; r < rows; r++) {
            const double *row = bounds + 5 * r, *rate = motion[kinds[2 * r]];
            double value = 0.0;
            for (int k = 0; k < 3; k++)
                if (row[k] != 0.0)
                    value += row[k] * rate[k] * factors[k];
            offer(&most, value / (value > 0.0 ? row[4] : row[3]), kinds[2 * r + 1]);
        }
        for (int k = 0; k < 3; k++)
            along[k * n + i] = motion[dim][k];
        binding[i] = (uint8_t)most.name;
    }
}

#include "planner/plan/plan.h"

#include "planner/core.h"

enum { MOST_AXES = 9 };

/* As numpy's fmin: the smaller one, or the one that is a number. */
static inline double least(double a, double b) { return a <= b || b != b ? a : b; }

static inline double dot(const double *a, const double *b, int64_t dim)
{
    double sum = 0.0;
    for (int64_t j = 0; j < dim; j++)
        sum += a[j] * b[j];
    return sum;
}

/* Limits over the sizes of a vector's components, the least of them. */
static inline double least_ratio(const double *limits, const double *vector, int64_t dim)
{
    double ratio = NAN;
    for (int64_t j = 0; j < dim; j++)
        ratio = least(ratio, limits[j] / fabs(vector[j]));
    return ratio;
}

/* Feed at which the chord of one period leaves the osculating circle of the tip by the chord error, as chord_feed_limit in
 * feed_limits.py has it; inf where nothing bends. */
static double chord_feed(const double *first, const double *second, int64_t dim, double error, double period)
{
    const double speed2 = dot(first, first, dim), slope = dot(first, second, dim) / speed2;
    double normal[MOST_AXES];
    for (int64_t j = 0; j < dim; j++)
        normal[j] = second[j] - slope * first[j];
    const double curvature = sqrt(dot(normal, normal, dim)) / speed2;
    if (!(speed2 > 0.0 && curvature > 0.0))
        return INFINITY;
    const double radius = 1.0 / curvature, sagitta = error < radius ? error : radius;
    return 2.0 / period * sqrt(sagitta * (2.0 * radius - sagitta));
}

/* First three derivatives over an arc length of which the parameter's speed is v, as along_length in differential.py. */
static void along_length(const double *q, int64_t stride, int64_t dim, const double *weights, double v, double cube,
                         double arc[3][MOST_AXES])
{
    double d1[MOST_AXES], d2[MOST_AXES], d3[MOST_AXES];
    for (int64_t j = 0; j < dim; j++) {
        d1[j] = q[stride + j] * weights[j];
        d2[j] = q[2 * stride + j] * weights[j];
        d3[j] = q[3 * stride + j] * weights[j];
    }
    const double slope = v > 0.0 ? dot(d1, d2, dim) / v : 0.0;
    const double bend = v > 0.0 ? (dot(d2, d2, dim) + dot(d1, d3, dim) - slope * slope) / v : 0.0;
    for (int64_t j = 0; j < dim; j++) {
        arc[0][j] = d1[j] / v;
        arc[1][j] = (d2[j] - slope * arc[0][j]) / (v * v);
        arc[2][j] = (d3[j] - 3.0 * v * slope * arc[1][j] - bend * arc[0][j]) / cube;
    }
}

HOT void guess_ceiling(int64_t n, int64_t dim, int64_t tip_dim, const double *q, const double *tip,
                       const double *weights, const double *speed, const double *cube, const double *along,
                       const double *velocity, const double *acceleration, const double *jerk, const double *feed,
                       double chord_error, double period, double tangential_acceleration, double tangential_jerk,
                       double *found)
{
    for (int64_t i = 0; i < n; i++) {
        double arc[3][MOST_AXES], commanded = feed[i];
        along_length(q + i * dim, n * dim, dim, weights, speed[i], cube[i], arc);
        if (isfinite(chord_error)) {
            const double *first = tip + (n + i) * tip_dim, *second = first + n * tip_dim;
            commanded = least(commanded, chord_feed(first, second, tip_dim, chord_error, period));
        }
        const double ratio = along[i];
        double ceiling = least_ratio(velocity, arc[0], dim);
        ceiling = least(ceiling, sqrt(least_ratio(acceleration, arc[1], dim)));
        found[i] = least(ceiling, ratio > 0.0 ? commanded / ratio : INFINITY);
        found[n + i] = least_ratio(jerk, arc[2], dim);
        found[2 * n + i] = least(least_ratio(acceleration, arc[0], dim),
                                 ratio > 0.0 ? tangential_acceleration / ratio : INFINITY);
        found[3 * n + i] = least(least_ratio(jerk, arc[0], dim), ratio > 0.0 ? tangential_jerk / ratio : INFINITY);
        found[4 * n + i] = sqrt(dot(arc[1], arc[1], dim));
    }
}

void guess_limit_growth(int64_t n, double *values, const double *steps)
{
    for (int64_t i = 1; i < n; i++)
        values[i] = smaller(values[i], values[i - 1] + steps[i - 1]);
    for (int64_t i = n - 2; i >= 0; i--)
        values[i] = smaller(values[i], values[i + 1] + steps[i]);
}

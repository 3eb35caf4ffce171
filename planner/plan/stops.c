#include "planner/plan/plan.h"

#include "planner/geometry/curve_inline.h"

enum { MOST_AXES = 9, SAMPLES = 16 /* a piece */, PASSES = 48 /* of the golden section, 1e-10 of the interval */ };

static const double WORTH_REFINING = 0.1; /* of the curvature at which a bend is a corner */
static const double SLOW = 0.5;           /* |C'| against its values around */
static const double NEAR = 1e-3;          /* of the interval between samples */
static const double GOLDEN = 0.6180339887498949;

/* A curve in weighted axes, and the piece that it was last asked on. */
typedef struct {
    const Pieces *pieces;
    const double *weights;
    int64_t piece;
    double d[3][MOST_AXES];
} Path;

static double dot(const double *a, const double *b, int64_t dim)
{
    double sum = 0.0;
    for (int64_t j = 0; j < dim; j++)
        sum += a[j] * b[j];
    return sum;
}

static void evaluate(Path *path, double u)
{
    const int64_t dim = path->pieces->dim;
    path->piece = point_on_pieces(path->pieces, u, 0, path->piece, 2, MOST_AXES, path->d[0]);
    for (int64_t j = 0; j < dim; j++) {
        path->d[1][j] *= path->weights[j];
        path->d[2][j] *= path->weights[j];
    }
}

/* |C'|^2 where the path was evaluated last. */
static double squared_speed(const Path *path) { return dot(path->d[1], path->d[1], path->pieces->dim); }

static double curvature(const Path *path)
{
    const int64_t dim = path->pieces->dim;
    const double *d1 = path->d[1], *d2 = path->d[2], speed2 = squared_speed(path);
    const double along = dot(d1, d2, dim) / speed2;
    double normal[MOST_AXES];
    for (int64_t j = 0; j < dim; j++)
        normal[j] = d2[j] - along * d1[j];
    return speed2 > 0.0 ? sqrt(dot(normal, normal, dim)) / speed2 : 0.0;
}

static double slowness(Path *path, double u)
{
    evaluate(path, u);
    return squared_speed(path);
}

static double flatness(Path *path, double u)
{
    evaluate(path, u);
    return -curvature(path);
}

/* Golden-section search, as golden_minimum in curve.py: the place of the minimum of f, and f there into least. */
static double golden_minimum(double (*f)(Path *, double), Path *path, double lo, double hi, double *least)
{
    for (int pass = 0; pass < PASSES; pass++) {
        const double inner = hi - GOLDEN * (hi - lo), outer = lo + GOLDEN * (hi - lo);
        const double at_inner = f(path, inner), at_outer = f(path, outer);
        if (at_inner <= at_outer)
            hi = outer;
        else
            lo = inner;
    }
    const double at = 0.5 * (lo + hi);
    *least = f(path, at);
    return at;
}

/* What is known of n samples; the radius of each is that of a bend that is a corner there. */
typedef struct {
    int64_t n;
    double *u, *bend, *speed, *radius, *second, *across;
} Samples;

/* Take sample i.  By the second derivative C' runs along a straight line, which comes as close to 0 as |n|, n its part across
 * C''; there the curvature is |C''| / |n|^2. */
static void put_sample(Path *path, const Samples *samples, int64_t i)
{
    const int64_t dim = path->pieces->dim;
    evaluate(path, samples->u[i]);
    const double *d1 = path->d[1], *d2 = path->d[2], second = dot(d2, d2, dim), along = dot(d1, d2, dim) / second;
    double across[MOST_AXES];
    for (int64_t j = 0; j < dim; j++)
        across[j] = d1[j] - along * d2[j];
    samples->bend[i] = curvature(path);
    samples->speed[i] = sqrt(squared_speed(path));
    samples->second[i] = sqrt(second);
    samples->across[i] = dot(across, across, dim);
}

/* Whether a curvature, or a least |C'|, at sample i has a bend beside it that may be tight. */
static int is_candidate(const Samples *samples, int64_t i)
{
    const double *bend = samples->bend, *speed = samples->speed, here = bend[i], v = speed[i];
    const int64_t last = samples->n - 1, before = i > 0 ? i - 1 : 0, after = i < last ? i + 1 : last;
    const int64_t before2 = i > 1 ? i - 2 : 0, after2 = i < last - 1 ? i + 2 : last;
    if (here >= bend[before] && here >= bend[after] && here * samples->radius[i] > WORTH_REFINING)
        return 1;
    return v <= speed[before] && v <= speed[after] && v <= SLOW * larger(speed[before2], speed[after2]) &&
           samples->second[i] * samples->radius[i] > WORTH_REFINING * samples->across[i];
}

int64_t stops_sharpest(int64_t pieces, int64_t dim, int64_t terms, const double *breaks, const double *coefficients,
                       int64_t rational, const uint8_t *resting, const double *origin, const double *weights,
                       int64_t first, int64_t count, double least_radius, double of_digit, double *scratch,
                       double *u_found, double *bend_found)
{
    const Pieces curve = {pieces, dim, terms, breaks, coefficients, origin, resting, rational != 0};
    const int64_t n = SAMPLES * count;
    const Samples samples = {n, scratch, scratch + n, scratch + 2 * n, scratch + 3 * n, scratch + 4 * n,
                             scratch + 5 * n};
    double *const u = samples.u;
    Path path = {&curve, weights, first, {{0.0}}};
    for (int64_t p = 0; p < count; p++) {
        const double begin = breaks[first + p], width = breaks[first + p + 1] - begin;
        double mean = 0.0;
        for (int64_t i = SAMPLES * p; i < SAMPLES * (p + 1); i++) {
            u[i] = begin + width * (((double)(i - SAMPLES * p) + 0.5) / SAMPLES);
            put_sample(&path, &samples, i);
            mean += samples.speed[i] / SAMPLES;
        }
        for (int64_t i = SAMPLES * p; i < SAMPLES * (p + 1); i++) {
            /* A bend of less is not resolved by the digits of u. */
            const double digit = nextafter(fabs(u[i]), INFINITY) - fabs(u[i]);
            samples.radius[i] = larger(least_radius, of_digit * digit * (mean * width) / width);
        }
    }
    int64_t found = 0;
    const double begin = breaks[first], end = breaks[first + count];
    for (int64_t i = 0; i < n; i++) {
        if (!is_candidate(&samples, i))
            continue;
        /* First to where the curve is slowest, next to which its curvature has its peak; then to the peak, there and here. */
        const double lo = i > 0 ? u[i - 1] : begin, hi = i < n - 1 ? u[i + 1] : end;
        double least;
        const double slow = golden_minimum(slowness, &path, lo, hi, &least);
        const double reach = smaller(hi - lo, 4.0 * sqrt(least) * samples.radius[i] + NEAR * (hi - lo));
        u_found[found] = golden_minimum(flatness, &path, larger(slow - reach, lo), smaller(slow + reach, hi), &least);
        bend_found[found++] = -least;
        u_found[found] = golden_minimum(flatness, &path, lo, hi, &least);
        bend_found[found++] = -least;
    }
    return found;
}

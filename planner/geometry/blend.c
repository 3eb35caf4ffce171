#include "planner/geometry/blend_inline.h"
#include "planner/geometry/geometry.h"

enum { FIRST_HALVINGS = 4, MOST_HALVINGS = 20 }; /* of 0 .. 1, the width of a panel of the table */
enum { MAX_PASSES = 60 };                        /* Newton from a neighbour converges in 3, bisection in 52 */
static const double NEGLIGIBLE = 1e-18;          /* of the largest term of a series */
static const double CLOSE = 4e-16;               /* of x in [-1, 1]: rounding */
static const double RESOLVED = 4e-16;            /* rounding of tau, and of the share of the length */
static const double PI = 3.14159265358979323846;

/* Terms of a series that count. */
static int64_t terms_that_count(int64_t terms, const double *series)
{
    double most = 0.0;
    for (int64_t k = 0; k < terms; k++)
        most = larger(most, fabs(series[k]));
    while (terms > 1 && fabs(series[terms - 1]) <= NEGLIGIBLE * most)
        terms--;
    return terms;
}

/* The length of a blend over x in [-1, 1], and what its inverse takes: b and eta of tau = b sinh(eta x), and the Chebyshev nodes
 * of a panel, from its end to its start, with the matrix that turns values there into a series. */
typedef struct {
    int64_t terms, speed_terms;
    const double *lengths, *speeds;
    double total, b, eta;
    double nodes[SHARE_TERMS], to_series[SHARE_TERMS][SHARE_TERMS];
} Shape;

static Shape shape_of(int64_t terms, const double *lengths, int64_t speed_terms, const double *speeds, double b)
{
    Shape shape = {.lengths = lengths, .speeds = speeds, .total = 0.0, .b = b, .eta = asinh(1.0 / b)};
    for (int64_t k = 0; k < terms; k++)
        shape.total += lengths[k]; /* T_k(1) = 1 */
    shape.terms = terms_that_count(terms, lengths);
    shape.speed_terms = terms_that_count(speed_terms, speeds);
    for (int i = 0; i < SHARE_TERMS; i++) {
        shape.nodes[i] = cos(PI * (i + 0.5) / SHARE_TERMS);
        for (int k = 0; k < SHARE_TERMS; k++)
            shape.to_series[k][i] = cos(PI * k * (i + 0.5) / SHARE_TERMS) * (k ? 2.0 : 1.0) / SHARE_TERMS;
    }
    return shape;
}

/* x at a length s, from the x of a smaller one on, by Newton, with bisection where that leaves the bracket; last: |L'| there. */
static double place_of(const Shape *shape, double s, double x, double *last)
{
    double lo = x, hi = 1.0;
    x = *last > 0.0 ? smaller(x + (s - chebyshev_value(shape->lengths, shape->terms, x)) / *last, hi) : x;
    for (int pass = 0; pass < MAX_PASSES; pass++) {
        const double error = chebyshev_value(shape->lengths, shape->terms, x) - s;
        const double slope = *last = chebyshev_value(shape->speeds, shape->speed_terms, x);
        if (error > 0.0)
            hi = x;
        else
            lo = x;
        const double step = -error / slope, trial = x + step;
        x = lo <= trial && trial <= hi ? trial : 0.5 * (lo + hi);
        if (fabs(step) <= CLOSE || hi - lo <= CLOSE)
            break;
    }
    return x;
}

/* The Chebyshev series of tau over the part lo .. hi of the length, which begins at x; whether its last terms are rounding. */
static int tau_series(const Shape *shape, double lo, double hi, double x, double *series)
{
    double tau[SHARE_TERMS], size = 0.0, slope = 0.0;
    for (int i = SHARE_TERMS - 1; i >= 0; i--) {
        x = place_of(shape, shape->total * (lo + (hi - lo) * 0.5 * (1.0 + shape->nodes[i])), x, &slope);
        tau[i] = shape->b * sinh(shape->eta * x);
        size = larger(size, fabs(tau[i]));
    }
    for (int k = 0; k < SHARE_TERMS; k++) {
        series[k] = 0.0;
        for (int i = 0; i < SHARE_TERMS; i++)
            series[k] += tau[i] * shape->to_series[k][i];
    }
    const double rise = fabs(tau[0] - tau[SHARE_TERMS - 1]) / (hi - lo); /* of tau over the share */
    const double tail = larger(fabs(series[SHARE_TERMS - 1]), fabs(series[SHARE_TERMS - 2]));
    return tail <= RESOLVED * (size + rise);
}

int64_t blend_tabulate(int64_t terms, const double *lengths, int64_t speed_terms, const double *speeds, double b,
                       int64_t room, double *edges, double *series)
{
    const Shape shape = shape_of(terms, lengths, speed_terms, speeds, b);
    const double widest = ldexp(1.0, -FIRST_HALVINGS), narrowest = ldexp(1.0, -MOST_HALVINGS);
    double lo = 0.0, width = widest, x = -1.0, slope = 0.0;
    int64_t panels = 0;
    edges[0] = 0.0;
    while (lo < 1.0) {
        if (panels == room)
            return -1;
        if (!tau_series(&shape, lo, lo + width, x, series + panels * SHARE_TERMS) && width > narrowest) {
            width *= 0.5;
            continue;
        }
        lo += width;
        x = place_of(&shape, shape.total * lo, x, &slope);
        edges[++panels] = lo;
        /* Edges are multiples of the widths beside them, so a panel may be wider where its start is a multiple of that. */
        if (width < widest && fmod(lo, 2.0 * width) == 0.0)
            width *= 2.0;
    }
    return panels;
}

void blend_tau(int64_t n, const int64_t *shape, const double *share, const int64_t *first_panel, const double *edges,
               const double *series, double *tau)
{
    int64_t panel = 0;
    for (int64_t i = 0; i < n; i++)
        tau[i] = tau_of_share(first_panel, edges, series, shape[i], share[i], &panel);
}

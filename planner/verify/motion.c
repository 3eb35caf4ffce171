#include "planner/verify/verify.h"

#include <string.h>

#include "planner/verify/law_inline.h"
#include "planner/verify/motion_inline.h"

enum { BISECTIONS = 60 };
static const double EPS = 2.220446049250313e-16;

int64_t law_table(int64_t nodes, const double *t, const double *u, const double *u_rate, const double *u_acceleration,
                  double *table)
{
    Quintic *law = (Quintic *)table;
    for (int64_t i = 0; i + 1 < nodes; i++) {
        const double h = t[i + 1] - t[i];
        if (!(h > 0.0)) /* a double node */
            continue;
        const double u0 = u[i], v0 = u_rate[i], a0 = u_acceleration[i];
        const double u1 = u[i + 1], v1 = u_rate[i + 1], a1 = u_acceleration[i + 1];
        /* The conditions at x = 1 that the Taylor part from x = 0 leaves to x^3, x^4 and x^5. */
        const double value = u1 - u0 - v0 * h - 0.5 * a0 * (h * h), slope = (v1 - v0 - a0 * h) * h;
        const double bend = (a1 - a0) * (h * h);
        const double c3 = 10.0 * value - 4.0 * slope + 0.5 * bend, c4 = -15.0 * value + 7.0 * slope - bend;
        const double c5 = 6.0 * value - 3.0 * slope + 0.5 * bend;
        /* Rounding: half a digit at each end of u, u' and u''; that of t moves u by u' times as much.  The factors are the
         * largest derivatives of the quintics that answer to a unit of u, of u' h and of u'' h^2. */
        const double size_v = larger(fabs(v0), fabs(v1));
        const double du = EPS * (larger(fabs(u0), fabs(u1)) + size_v * (t[i] + h));
        const double dv = EPS * size_v * h, da = EPS * larger(fabs(a0), fabs(a1)) * (h * h);
        const Quintic made = {
            t[i], h, {{u0, v0, a0}, {u1, v1, a1}}, {u0, v0 * h, 0.5 * a0 * (h * h), c3, c4, c5},
            {2.0 * (du + dv + da) / h, (6.0 * du + 4.0 * dv + da) / (h * h),
             (60.0 * du + 36.0 * dv + 9.0 * da) / (h * h * h)}};
        *law++ = made;
    }
    return law - (Quintic *)table;
}

/* First three time derivatives of u at x (k), from out on, apart numbers from one another. */
INLINED void quintic_rates(const Quintic *law, int64_t k, const double *x, int64_t apart, double *restrict out)
{
    const double *c = law->c, *begin = law->ends[0], *end = law->ends[1];
    const double h1 = law->h, h2 = h1 * h1, h3 = h1 * h1 * h1;
    for (int64_t p = 0; p < k; p++) {
        const double w = x[p];
        const double u1 = (c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5])))) / h1;
        const double u2 = (2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5]))) / h2;
        out[p] = w == 0.0 ? begin[1] : w == 1.0 ? end[1] : u1;
        out[apart + p] = w == 0.0 ? begin[2] : w == 1.0 ? end[2] : u2;
        out[2 * apart + p] = (6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5])) / h3;
    }
}

void law_locate(int64_t intervals, const double *table, const double *start, int64_t n, const double *t,
                int64_t *interval, double *x)
{
    int64_t i = 0;
    for (int64_t k = 0; k < n; k++) {
        x[k] = locate(table, intervals, start, t[k], &i);
        interval[k] = i;
    }
}

void law_parameters(int64_t intervals, const double *table, const double *start, int64_t n, const double *t, double low,
                    double high, double *u)
{
    const double end = start[intervals - 1] + quintic_of(table, intervals - 1)->h;
    int64_t i = 0;
    for (int64_t k = 0; k < n; k++) {
        const double x = locate(table, intervals, start, smaller(t[k], end), &i);
        u[k] = smaller(larger(quintic_value(quintic_of(table, i), x), low), high);
    }
}

HOT void law_values(const double *table, int64_t n, int64_t k, const int64_t *interval, const double *x, int64_t rows,
                    double *out)
{
    for (int64_t i = 0; i < n; i++) {
        const Quintic *law = quintic_of(table, interval[i]);
        for (int64_t p = 0; p < k; p++)
            out[i * k + p] = quintic_value(law, x[i * k + p]);
        if (rows == 4)
            quintic_rates(law, k, x + i * k, n * k, out + n * k + i * k);
    }
}

void law_crossings(const double *table, int64_t n, const int64_t *interval, const double *u, double *x)
{
    for (int64_t i = 0; i < n; i++) {
        const Quintic *law = quintic_of(table, interval[i]);
        double lo = 0.0, hi = 1.0;
        for (int pass = 0; pass < BISECTIONS; pass++) {
            const double middle = 0.5 * (lo + hi);
            const int below = quintic_value(law, middle) < u[i];
            lo = below ? middle : lo;
            hi = below ? hi : middle;
        }
        x[i] = hi;
    }
}

/* Write k >= 2 equidistant places from begin to end, both included exactly. */
INLINED void divide_span(int64_t k, double begin, double end, double *restrict x)
{
    const double step = 1.0 / (double)(k - 1), width = end - begin;
    for (int64_t p = 0; p < k; p++)
        x[p] = begin + width * ((double)p * step);
    x[k - 1] = end;
}

/* Write u at k places of a span within its ends, begin and end, and which of them are its last; last: x there. */
INLINED void place_span(const Quintic *law, int64_t k, const double *restrict x, double begin, double end, double last,
                        double *restrict u, uint8_t *restrict left)
{
    const double low = smaller(begin, end), high = larger(begin, end);
    for (int64_t p = 0; p < k; p++)
        u[p] = smaller(larger(quintic_value(law, x[p]), low), high);
    for (int64_t p = 0; p < k; p++)
        left[p] = (u[p] >= end) | (x[p] >= last);
}

HOT void motion_grid(int64_t n, int64_t k, const int64_t *span, const double *lower, const double *upper, double *x)
{
    for (int64_t i = 0; i < n; i++)
        divide_span(k, lower[span[i]], upper[span[i]], x + i * k);
}

HOT void motion_place(const double *table, int64_t spans, const int64_t *interval, const double *upper,
                      const double *u_ends, int64_t n, int64_t k, const int64_t *span, const double *x, double *u,
                      uint8_t *left, double *rates, double *slack)
{
    for (int64_t i = 0; i < n; i++) {
        const int64_t at = span[i];
        const Quintic *law = quintic_of(table, interval[at]);
        place_span(law, k, x + i * k, u_ends[at], u_ends[spans + at], upper[at], u + i * k, left + i * k);
        if (rates)
            quintic_rates(law, k, x + i * k, n * k, rates + i * k);
        for (int j = 0; slack && j < 3; j++)
            slack[3 * i + j] = law->slack[j];
    }
}

HOT void motion_sweep(const double *table, int64_t spans, const int64_t *interval, const double *lower,
                      const double *upper, const double *u_ends, int64_t room, int64_t k, const int64_t *window, double *x,
                      double *u, uint8_t *left, double *rates, double *slack)
{
    for (int64_t i = 0; i < window[1]; i++) {
        const int64_t at = window[0] + i;
        const Quintic *law = quintic_of(table, interval[at]);
        divide_span(k, lower[at], upper[at], x + i * k);
        place_span(law, k, x + i * k, u_ends[at], u_ends[spans + at], upper[at], u + i * k, left + i * k);
        quintic_rates(law, k, x + i * k, room * k, rates + i * k);
        for (int j = 0; j < 3; j++)
            slack[3 * i + j] = law->slack[j];
    }
}

HOT void motion_measure(int64_t n, int64_t k, int64_t dim, int64_t tip, const double *d, const double *p,
                        const double *rates, const double *slack, double *values, double *granted)
{
    const States states = {n * k, dim, tip, d, p, rates, slack, k};
    const int64_t rows = FIRST_AXIS + 3 * dim, points = n * k;
    Quantities block;
    for (int64_t first = 0; first < points; first += BLOCK) {
        const int64_t count = points - first < BLOCK ? points - first : BLOCK;
        measure_block(&states, first, count, &block);
        for (int64_t row = 0; row < rows; row++) {
            memcpy(values + row * points + first, block.value[row], (size_t)count * sizeof(double));
            memcpy(granted + row * points + first, block.granted[row], (size_t)count * sizeof(double));
        }
    }
}

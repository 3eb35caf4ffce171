#include "planner/verify/verify.h"

#include "planner/geometry/curve_inline.h"
#include "planner/verify/motion_inline.h"

void law_locate(int64_t intervals, const double *start, const double *h, int64_t n, const double *t, int64_t *interval,
                double *x)
{
    int64_t i = 0;
    for (int64_t k = 0; k < n; k++) {
        i = t[k] >= start[intervals - 1] ? intervals - 1 : find_piece(intervals - 1, start, t[k], 0, i);
        interval[k] = i;
        x[k] = smaller(larger((t[k] - start[i]) / h[i], 0.0), 1.0);
    }
}

/* A quintic between two nodes: coefficients of the powers of x, u, u' and u'' at both ends as tabulated, duration. */
typedef struct {
    double c[6], ends[2][3], h;
} Quintic;

static inline Quintic quintic_of(int64_t intervals, const double *h, const double *ends, const double *coefficients,
                                 int64_t i)
{
    Quintic law;
    for (int k = 0; k < 6; k++)
        law.c[k] = coefficients[k * intervals + i];
    for (int side = 0; side < 2; side++)
        for (int k = 0; k < 3; k++)
            law.ends[side][k] = ends[(side * 3 + k) * intervals + i];
    law.h = h[i];
    return law;
}

static inline double quintic_value(const Quintic *law, double w)
{
    const double *c = law->c;
    const double u = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))));
    return w == 1.0 ? law->ends[1][0] : u;
}

HOT void law_values(int64_t intervals, const double *h, const double *ends, const double *coefficients, int64_t n,
                    int64_t k, const int64_t *interval, const double *x, int64_t rows, double *out)
{
    double *restrict first = out + n * k, *restrict second = first + n * k, *restrict third = second + n * k;
    for (int64_t i = 0; i < n; i++) {
        const Quintic law = quintic_of(intervals, h, ends, coefficients, interval[i]);
        const double *c = law.c, *begin = law.ends[0], *end = law.ends[1], *at = x + i * k;
        const double h1 = law.h, h2 = h1 * h1, h3 = h1 * h1 * h1;
        double *restrict value = out + i * k;
        for (int64_t p = 0; p < k; p++)
            value[p] = quintic_value(&law, at[p]);
        if (rows < 4)
            continue;
        for (int64_t p = 0; p < k; p++) {
            const double w = at[p];
            const double u1 = (c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5])))) / h1;
            const double u2 = (2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5]))) / h2;
            first[i * k + p] = w == 0.0 ? begin[1] : w == 1.0 ? end[1] : u1;
            second[i * k + p] = w == 0.0 ? begin[2] : w == 1.0 ? end[2] : u2;
            third[i * k + p] = (6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5])) / h3;
        }
    }
}

void law_parameters(int64_t intervals, const double *start, const double *h, const double *ends,
                    const double *coefficients, int64_t n, const double *t, double low, double high, double *u)
{
    const double last = start[intervals - 1] + h[intervals - 1];
    Quintic law = quintic_of(intervals, h, ends, coefficients, 0);
    int64_t i = 0;
    for (int64_t k = 0; k < n; k++) {
        const double time = smaller(t[k], last);
        const int64_t now =
            time >= start[intervals - 1] ? intervals - 1 : find_piece(intervals - 1, start, time, 0, i);
        if (now != i) {
            i = now;
            law = quintic_of(intervals, h, ends, coefficients, i);
        }
        const double x = smaller(larger((time - start[i]) / h[i], 0.0), 1.0);
        u[k] = smaller(larger(quintic_value(&law, x), low), high);
    }
}

HOT void motion_place(int64_t intervals, const double *h, const double *ends, const double *coefficients,
                      int64_t spans, const int64_t *interval, const double *upper, const double *u_ends, int64_t n,
                      int64_t k, const int64_t *span, const double *x, double *u, uint8_t *left)
{
    for (int64_t i = 0; i < n; i++) {
        const int64_t at = span[i];
        const Quintic law = quintic_of(intervals, h, ends, coefficients, interval[at]);
        const double begin = u_ends[at], end = u_ends[spans + at], last = upper[at];
        const double low = smaller(begin, end), high = larger(begin, end);
        const double *restrict place = x + i * k;
        double *restrict value = u + i * k;
        uint8_t *restrict inside = left + i * k;
        for (int64_t p = 0; p < k; p++)
            value[p] = smaller(larger(quintic_value(&law, place[p]), low), high);
        for (int64_t p = 0; p < k; p++)
            inside[p] = (value[p] >= end) | (place[p] >= last);
    }
}

HOT void motion_measure(int64_t n, int64_t k, int64_t dim, int64_t tip, const double *d, const double *p,
                        const double *rates, const double *slack, double *values, double *granted)
{
    const States states = {n * k, dim, tip, d, p, rates};
    const int64_t rows = FIRST_AXIS + 3 * dim;
    Quantities block;
    for (int64_t i = 0; i < n; i++)
        for (int64_t first = 0; first < k; first += BLOCK) {
            const int64_t count = k - first < BLOCK ? k - first : BLOCK, at = i * k + first;
            measure_block(&states, at, count, slack + 3 * i, &block);
            for (int64_t row = 0; row < rows; row++)
                for (int64_t point = 0; point < count; point++) {
                    values[row * n * k + at + point] = block.value[row][point];
                    granted[row * n * k + at + point] = block.granted[row][point];
                }
        }
}

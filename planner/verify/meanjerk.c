#include "planner/core.h"
#include "planner/verify/verify.h"

static const double EPS = 2.220446049250313e-16;
static const double DIGITS = 16.0; /* that derivatives, sums of a few products, may be off by */

void meanjerk_measure(int64_t n, int64_t dim, const double *d, const double *rates, const double *u, const double *start,
                      const double *h, const double *gap, double *mean, double *slack)
{
    const int64_t order = 2 * n * dim; /* numbers of one derivative */
    for (int64_t i = 0; i < n; i++) {
        const double low = fabs(u[2 * i]), high = fabs(u[2 * i + 1]);
        const double later = EPS * (start[i] + h[i]) / h[i];
        for (int64_t j = 0; j < dim; j++) {
            double acceleration[2], off = 0.0;
            for (int side = 0; side < 2; side++) {
                const double *q = d + (2 * i + side) * dim + j;
                const double u1 = rates[2 * i + side], u2 = rates[2 * (n + i) + side], squared = u1 * u1;
                acceleration[side] = q[2 * order] * squared + q[order] * u2;
                off += DIGITS * EPS * (fabs(q[2 * order]) * squared + fabs(q[order] * u2) +
                                       fabs(q[0]) * squared / (gap[i] * gap[i]));
                off += EPS * (side ? high : low) * (fabs(q[3 * order]) * squared + fabs(q[2 * order] * u2));
            }
            mean[j * n + i] = fabs(acceleration[1] - acceleration[0]) / h[i];
            slack[j * n + i] = off / h[i] + mean[j * n + i] * later;
        }
    }
}

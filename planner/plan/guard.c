#include "planner/plan/plan.h"

#include "planner/core.h"

enum { PASSES, NOT_FINITE, NODES_BACK, BETWEEN_BACK };

static const double EPS = 2.220446049250313e-16;
/* Of the largest rate of u: slower than that is rounding. */
static const double BACKWARD = 1e-9;
static const int POINTS = 32;

/* Whether u' = sum rate[k] w^k falls below -allowed for a w in [0, 1].  Its Bernstein coefficients tell where to look. */
static int falls(const double *rate, double allowed)
{
    const double b[5] = {
        rate[0], rate[0] + rate[1] / 4.0, rate[0] + rate[1] / 2.0 + rate[2] / 6.0,
        rate[0] + 3.0 * rate[1] / 4.0 + rate[2] / 2.0 + rate[3] / 4.0,
        rate[0] + rate[1] + rate[2] + rate[3] + rate[4],
    };
    if (!(b[0] < -allowed || b[1] < -allowed || b[2] < -allowed || b[3] < -allowed || b[4] < -allowed))
        return 0;
    for (int k = 0; k <= POINTS; k++) {
        const double w = (double)k / POINTS;
        if (rate[0] + w * (rate[1] + w * (rate[2] + w * (rate[3] + w * rate[4]))) < -allowed)
            return 1;
    }
    return 0;
}

int64_t guard_first_defect(int64_t n, const double *t, const double *u, const double *rate, const double *acceleration,
                           int64_t *at)
{
    double fastest = 0.0;
    for (int64_t i = 0; i < n; i++) {
        *at = i;
        if (!(isfinite(t[i]) && isfinite(u[i]) && isfinite(rate[i]) && isfinite(acceleration[i])))
            return NOT_FINITE;
        fastest = larger(fastest, fabs(rate[i]));
    }
    for (int64_t i = 0; i < n - 1; i++) {
        *at = i;
        if (t[i + 1] < t[i] || u[i + 1] < u[i])
            return NODES_BACK;
    }
    for (int64_t i = 0; i < n - 1; i++) {
        const double h = t[i + 1] - t[i], v0 = rate[i], a0 = acceleration[i];
        if (!(h > 0.0))
            continue;
        /* quintic_coefficients in law.py, over w = (t - t[i]) / h */
        const double rest = (u[i + 1] - u[i] - h * (v0 + 0.5 * a0 * h)) / h;
        const double dv = rate[i + 1] - v0 - a0 * h, da = (acceleration[i + 1] - a0) * h;
        const double of[5] = {v0, a0 * h, 3.0 * (10.0 * rest - 4.0 * dv + 0.5 * da),
                              4.0 * (-15.0 * rest + 7.0 * dv - da), 5.0 * (6.0 * rest - 3.0 * dv + 0.5 * da)};
        const double digit = EPS * (fabs(u[i + 1]) + fabs(v0) * t[i + 1]);
        *at = i;
        if (falls(of, BACKWARD * fastest + 4.0 * digit / h))
            return BETWEEN_BACK;
    }
    return PASSES;
}

#include "planner/core.h"
#include "planner/verify/motion_inline.h"
#include "planner/verify/verify.h"

static const double LARGEST = 1.7976931348623157e308; /* in place of what overflows */

void columns_terms(int64_t n, int64_t tip, const double *p, const double *rates, double *values, double *terms, double *bend)
{
    const double *slopes = p + n * tip, *seconds = slopes + n * tip, *thirds = seconds + n * tip;
    for (int64_t i = 0; i < n; i++) {
        const double *first = slopes + i * tip, *second = seconds + i * tip, *third = thirds + i * tip;
        double size1 = 0.0, size2 = 0.0, size3 = 0.0, along = 0.0, across = 0.0;
        for (int64_t j = 0; j < tip; j++) {
            size1 += square(first[j]);
            size2 += square(second[j]);
            size3 += square(third[j]);
            along += first[j] * second[j];
        }
        for (int64_t j = 0; j < tip; j++)
            across += square(second[j] - along / size1 * first[j]);
        bend[i] = size1 > 0.0 ? sqrt(across) / size1 : INFINITY;
        const double p1 = sqrt(size1), p2 = sqrt(size2), turn = p1 > 0.0 ? size2 / p1 : 0.0;
        const Triple sums = chain_rule(p1, p2, sqrt(size3) + turn, fabs(rates[i]), fabs(rates[n + i]), fabs(rates[2 * n + i]));
        terms[i] = sums.first;
        terms[n + i] = sums.second;
        terms[2 * n + i] = sums.third;
        if (p1 == 0.0) /* along the path nothing changes where the tip rests in the parameter */
            values[ALONG_ACCELERATION * n + i] = values[ALONG_JERK * n + i] = 0.0;
    }
}

void columns_used(int64_t n, const double *shown, const double *expected, const double *granted, double *used)
{
    for (int64_t i = 0; i < n; i++) {
        const double off = fabs(shown[i] - expected[i]);
        const double share = granted[i] > 0.0 ? off / granted[i] : off > 0.0 ? INFINITY : 0.0;
        used[i] = share < INFINITY ? share : INFINITY;
    }
}

/* A use that is no number counts as none. */
static inline double counted(double share) { return share > 0.0 ? smaller(share, LARGEST) : 0.0; }

void columns_shares(int64_t n, int64_t k, const int64_t *row, const double *allowed, const double *rate, const double *values,
                    const double *granted, double *shares, double *slack)
{
    for (int64_t limit = 0; limit < k; limit++) {
        const double *value = values + row[limit] * n, *grant = granted + row[limit] * n;
        for (int64_t i = 0; i < n; i++) {
            const double size = row[limit] == REVERSAL ? value[i] : fabs(value[i]), slowed = rate ? rate[limit * n + i] : 1.0;
            shares[limit * n + i] = counted(size * slowed / allowed[limit]);
            slack[limit * n + i] = counted(grant[i] * slowed / allowed[limit]);
        }
    }
}

int64_t columns_misnamed(int64_t n, int64_t k, const double *shares, const double *slack, const int64_t *named,
                         double tolerance, double slacks, uint8_t *wrong)
{
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        double most = 0.0, near = 0.0;
        const double share = named[i] >= 0 ? shares[named[i] * n + i] : -INFINITY;
        for (int64_t limit = 0; limit < k; limit++) {
            const double other = shares[limit * n + i];
            most = larger(most, other);
            near = larger(near, other >= share - tolerance ? slack[limit * n + i] : 0.0);
        }
        wrong[i] = named[i] < 0 || !(share >= most - (tolerance + slacks * near));
        count += wrong[i];
    }
    return count;
}

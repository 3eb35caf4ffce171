#include "planner/plan/plan.h"

#include "planner/core.h"

void speed_law_follow(int64_t n, const double *values, const double *bands, double *out)
{
    double last = 0.0;
    for (int64_t i = 0; i < n; i++) {
        last = smaller(larger(last, values[i] - bands[i]), values[i] + bands[i]);
        out[i] = last;
    }
}

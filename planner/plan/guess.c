#include "planner/plan/plan.h"

#include "planner/core.h"

void guess_limit_growth(int64_t n, double *values, const double *steps)
{
    for (int64_t i = 1; i < n; i++)
        values[i] = smaller(values[i], values[i - 1] + steps[i - 1]);
    for (int64_t i = n - 2; i >= 0; i--)
        values[i] = smaller(values[i], values[i + 1] + steps[i]);
}

#include "planner/verify/peaks_inline.h"
#include "planner/verify/verify.h"

void peaks_keep(int64_t rows, int64_t n, const double *height, const int64_t *index, const double *x, int64_t room,
                int64_t *kept, double *best, int64_t *best_index, double *best_x)
{
    for (int64_t row = 0; row < rows; row++) {
        const Tops tops = {room, kept + row, best + row * room, best_index + row * room, best_x + row * room};
        for (int64_t i = 0; i < n; i++)
            tops_take(&tops, height[row * n + i], index[i], x[row * n + i]);
    }
}

void peaks_trials(int64_t n, int64_t m, const double *steps, const double *x, const double *half, const double *lower,
                  const double *upper, double *trials)
{
    for (int64_t i = 0; i < n; i++)
        for (int64_t k = 0; k < m; k++)
            trials[i * m + k] = smaller(larger(x[i] + half[i] * steps[k], lower[i]), upper[i]);
}

void peaks_choose(int64_t n, int64_t m, const double *trials, const double *heights, double shrink, double *x, double *half)
{
    for (int64_t i = 0; i < n; i++) {
        x[i] = trials[i * m + highest(m, heights + i * m)];
        half[i] /= shrink;
    }
}

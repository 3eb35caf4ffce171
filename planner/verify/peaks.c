#include "planner/verify/peaks_inline.h"
#include "planner/verify/verify.h"

/* Whether one comes before another. */
static inline int precedes(double height, int64_t index, double other, int64_t other_index)
{
    return height > other || (height == other && index < other_index);
}

void peaks_keep(int64_t rows, int64_t n, const double *height, const int64_t *index, const double *x, int64_t room,
                int64_t *kept, double *best, int64_t *best_index, double *best_x)
{
    for (int64_t row = 0; row < rows; row++, best += room, best_index += room, best_x += room)
        for (int64_t i = 0; i < n; i++) {
            const double here = height[row * n + i];
            int64_t at = kept[row];
            if (at == room && !precedes(here, index[i], best[room - 1], best_index[room - 1]))
                continue;
            /* An insertion: those that are lower move on, and the last of a full row falls out. */
            at = at == room ? room - 1 : kept[row]++;
            for (; at > 0 && precedes(here, index[i], best[at - 1], best_index[at - 1]); at--) {
                best[at] = best[at - 1];
                best_index[at] = best_index[at - 1];
                best_x[at] = best_x[at - 1];
            }
            best[at] = here;
            best_index[at] = index[i];
            best_x[at] = x[row * n + i];
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

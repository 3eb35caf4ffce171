#include "planner/verify/verify.h"

void peaks_keep(int64_t rows, int64_t n, const double *height, const int64_t *index, const double *x, int64_t room,
                int64_t *kept, double *best, int64_t *best_index, double *best_x)
{
    for (int64_t row = 0; row < rows; row++, best += room, best_index += room, best_x += room)
        for (int64_t i = 0; i < n; i++) {
            const double here = height[row * n + i];
            int64_t at = kept[row];
            if (at == room && !(here > best[room - 1]))
                continue;
            /* An insertion: those that are lower move on, and the last of a full row falls out. */
            at = at == room ? room - 1 : kept[row]++;
            for (; at > 0 && here > best[at - 1]; at--) {
                best[at] = best[at - 1];
                best_index[at] = best_index[at - 1];
                best_x[at] = best_x[at - 1];
            }
            best[at] = here;
            best_index[at] = index[i];
            best_x[at] = x[row * n + i];
        }
}

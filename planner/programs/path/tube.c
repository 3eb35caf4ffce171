#include "planner/programs/path/path.h"

#include "planner/core.h"

#define TILE 1024 /* columns of the band at a time: what is read and written again stays near */

HOT void tube_add_rows(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                       const double *weight, int64_t n, double *restrict band)
{
    for (int64_t k = 0; k < count; k++) {
        const double *row = rows + k * width;
        for (int64_t j = 0; j < width; j++) {
            const double value = weight[k] * row[j];
            double *column = band + first[k] * dim + j;
            if (value != 0.0)
                for (int64_t i = j; i < width; i++)
                    column[(i - j) * n] += value * row[i];
        }
    }
}

void tube_apply_rows(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                     const double *x, double *restrict out)
{
    for (int64_t k = 0; k < count; k++) {
        const double *row = rows + k * width, *from = x + first[k] * dim;
        double total = 0.0;
        for (int64_t j = 0; j < width; j++)
            total += row[j] * from[j];
        out[k] = total;
    }
}

HOT void tube_add_transposed(int64_t count, int64_t width, int64_t dim, const int64_t *first, const double *rows,
                             const double *y, double *restrict out)
{
    for (int64_t k = 0; k < count; k++) {
        const double *row = rows + k * width;
        double *to = out + first[k] * dim;
        for (int64_t j = 0; j < width; j++)
            to[j] += y[k] * row[j];
    }
}

/* Each entry of the product is summed from the diagonal outwards, whatever the tiles. */
HOT void tube_apply_band(int64_t depth, int64_t n, const double *band, const double *x, double *restrict out)
{
    for (int64_t begin = 0; begin < n; begin += TILE) {
        const int64_t end = begin + TILE < n ? begin + TILE : n;
        for (int64_t j = begin; j < end; j++)
            out[j] = band[j] * x[j];
        for (int64_t i = 1; i < depth; i++) {
            const double *row = band + i * n;
            for (int64_t j = begin > i ? begin : i; j < end; j++)
                out[j] += row[j - i] * x[j - i];
            for (int64_t j = begin; j < (end < n - i ? end : n - i); j++)
                out[j] += row[j] * x[j + i];
        }
    }
}

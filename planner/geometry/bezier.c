#include "planner/geometry/bezier_inline.h"
#include "planner/geometry/geometry.h"

void bezier_over(int64_t n, int64_t dim, int64_t terms, const double *powers, int64_t m, const double *w, double *out)
{
    const Beziers beziers = {.dim = dim, .terms = terms, .powers = powers};
    for (int64_t i = 0; i < n; i++)
        for (int64_t k = 0; k < m; k++) {
            Derivatives d;
            bezier_over_parameter(&beziers, i, w[k], d);
            for (int order = 0; order < 4; order++)
                for (int64_t j = 0; j < dim; j++)
                    *out++ = d[order][j];
        }
}

void bezier_at(int64_t dim, int64_t terms, const double *powers, const double *length, const int64_t *first_panel,
               const double *edges, const double *series, int64_t n, const int64_t *row, const double *s, double *out)
{
    const Beziers beziers = {dim, terms, powers, length, first_panel, edges, series, 0};
    for (int64_t i = 0; i < n; i++) {
        Derivatives d;
        bezier_along(&beziers, row[i], s[i], d);
        for (int64_t order = 0; order < 4; order++)
            for (int64_t j = 0; j < dim; j++)
                out[(order * n + i) * dim + j] = d[order][j];
    }
}

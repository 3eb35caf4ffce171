#include "planner/geometry/geometry.h"

#include "planner/geometry/curve_inline.h"

void curve_evaluate(int64_t pieces, int64_t dim, int64_t terms, const double *breaks, const double *coefficients,
                    int64_t rational, const uint8_t *resting, const double *origin, int64_t n, const double *u,
                    const uint8_t *left, int64_t order, double *out)
{
    const Pieces curve = {pieces, dim, terms, breaks, coefficients, origin, resting, rational != 0};
    int64_t piece = 0;
    for (int64_t i = 0; i < n; i++)
        piece = point_on_pieces(&curve, u[i], left[i], piece, order, n * dim, out + i * dim);
}

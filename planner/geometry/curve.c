#include "planner/geometry/geometry.h"

#include "planner/geometry/lanes_inline.h"

/* Write four points at once from out on, derivatives 0..order; piece: to be tried first, and the last found. */
INLINE void four_points(const Pieces *curve, const double *u, const uint8_t *left, int64_t *piece, int64_t order,
                        int64_t stride, double *out)
{
    const Lanes at = {u[0], u[1], u[2], u[3]};
    const Mask from_left = {-(left[0] != 0), -(left[1] != 0), -(left[2] != 0), -(left[3] != 0)};
    int64_t found[LANES] = {*piece, *piece, *piece, *piece};
    LaneMotions q;
    lanes_on_pieces(curve, &at, &from_left, found, q);
    for (int64_t k = 0; k <= order; k++)
        for (int64_t j = 0; j < curve->dim; j++)
            for (int l = 0; l < LANES; l++)
                out[k * stride + l * curve->dim + j] = q[k][j][l];
    *piece = found[LANES - 1];
}

HOT void curve_evaluate(int64_t pieces, int64_t dim, int64_t terms, const double *breaks, const double *coefficients,
                        int64_t rational, const uint8_t *resting, const double *origin, int64_t n, const double *u,
                        const uint8_t *left, int64_t order, double *out)
{
    const Pieces curve = {pieces, dim, terms, breaks, coefficients, origin, resting, rational != 0};
    int64_t piece = 0, i = 0;
    for (; order == 0 && i < n; i++)
        piece = place_on_pieces(&curve, u[i], left[i], piece, out + i * dim);
    for (; dim <= MOST_AXES && i + LANES <= n; i += LANES)
        four_points(&curve, u + i, left + i, &piece, order, n * dim, out + i * dim);
    for (; i < n; i++)
        piece = point_on_pieces(&curve, u[i], left[i], piece, order, n * dim, out + i * dim);
}

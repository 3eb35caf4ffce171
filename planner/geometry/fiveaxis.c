#include "planner/geometry/curve_inline.h"
#include "planner/geometry/geometry.h"

/* Points that go through splines and tape at once; the axes, and the coordinates of a spline. */
enum { BLOCK = 32, AXES = 5, DIM = 3, ORDERS = 4 };

/* The angle of C at a parameter without the jumps of the arctangent, somewhat: from its places around. */
typedef struct {
    int64_t count;
    const double *places, *angles;
} Turns;

/* Add whole turns to count angles, each AXES after the other, so that they are next to those known. */
static void follow(const Turns *turns, int64_t count, const double *u, int64_t *guess, double *angle)
{
    const double turn = 6.28318530717958647693, *places = turns->places, *angles = turns->angles;
    for (int64_t i = 0; i < count; i++, angle += AXES) {
        const int64_t k = *guess = find_piece(turns->count - 1, places, u[i], 0, *guess);
        const double share = (u[i] - places[k]) / (places[k + 1] - places[k]);
        const double near = angles[k] + share * (angles[k + 1] - angles[k]);
        *angle += turn * rint((near - *angle) / turn);
    }
}

/* Copy derivatives 0..order of a block, (., count, width), to their place among those of n points. */
static void put(int64_t order, int64_t count, int64_t width, const double *from, int64_t stride, int64_t apart,
                int64_t n, double *to)
{
    for (int64_t k = 0; k <= order; k++)
        for (int64_t i = 0; i < count; i++)
            for (int64_t j = 0; j < width; j++)
                to[(k * n + i) * width + j] = from[k * stride + i * apart + j];
}

void fiveaxis_evaluate(int64_t bottom_pieces, int64_t bottom_terms, const double *bottom_breaks,
                       const double *bottom_coefficients, int64_t bottom_rational, const uint8_t *bottom_resting,
                       const double *bottom_origin, int64_t top_pieces, int64_t top_terms, const double *top_breaks,
                       const double *top_coefficients, int64_t top_rational, const uint8_t *top_resting,
                       const double *top_origin, int64_t steps, const int32_t *code, int64_t constants,
                       const double *constant, const int32_t *row, int64_t m, const double *places, const double *angles,
                       int64_t n, const double *u, const uint8_t *left, int64_t order, double *out, double *tip,
                       double *work)
{
    const Pieces splines[2] = {
        {bottom_pieces, DIM, bottom_terms, bottom_breaks, bottom_coefficients, bottom_origin, bottom_resting,
         bottom_rational != 0},
        {top_pieces, DIM, top_terms, top_breaks, top_coefficients, top_origin, top_resting, top_rational != 0},
    };
    const Turns turns = {m, places, angles};
    int64_t piece[2] = {0, 0}, near = 0;
    double points[ORDERS * BLOCK * 2 * DIM], axes[ORDERS * BLOCK * AXES];
    for (int64_t first = 0; first < n; first += BLOCK) {
        const int64_t count = n - first < BLOCK ? n - first : BLOCK, stride = count * 2 * DIM;
        for (int64_t i = 0; i < count; i++)
            for (int side = 0; side < 2; side++)
                piece[side] = point_on_pieces(&splines[side], u[first + i], left[first + i], piece[side], 3, stride,
                                              points + (2 * i + side) * DIM);
        tape_run(steps, code, 2 * DIM, constants, constant, AXES, row, count, order, ORDERS, points, axes, work);
        follow(&turns, count, u + first, &near, axes + AXES - 1);
        put(order, count, AXES, axes, count * AXES, AXES, n, out + first * AXES);
        if (tip)
            put(order, count, DIM, points, stride, 2 * DIM, n, tip + first * DIM);
    }
}

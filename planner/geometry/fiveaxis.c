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

/* Copy derivatives 0..order of count points, width numbers each, between blocks of rows so wide and derivatives so far apart. */
static void copy(int64_t order, int64_t count, int64_t width, const double *from, int64_t from_width, int64_t from_apart,
                 double *to, int64_t to_width, int64_t to_apart)
{
    for (int64_t k = 0; k <= order; k++)
        for (int64_t i = 0; i < count; i++)
            for (int64_t j = 0; j < width; j++)
                to[k * to_apart + i * to_width + j] = from[k * from_apart + i * from_width + j];
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
    const Turns turns = {m, places, angles};
    int64_t near = 0;
    double bottom[ORDERS * BLOCK * DIM], top[ORDERS * BLOCK * DIM], both[ORDERS * BLOCK * 2 * DIM];
    double axes[ORDERS * BLOCK * AXES];
    for (int64_t first = 0; first < n; first += BLOCK) {
        const int64_t count = n - first < BLOCK ? n - first : BLOCK, apart = count * DIM;
        curve_evaluate(bottom_pieces, DIM, bottom_terms, bottom_breaks, bottom_coefficients, bottom_rational,
                       bottom_resting, bottom_origin, count, u + first, left + first, 3, bottom);
        curve_evaluate(top_pieces, DIM, top_terms, top_breaks, top_coefficients, top_rational, top_resting, top_origin,
                       count, u + first, left + first, 3, top);
        copy(3, count, DIM, bottom, DIM, apart, both, 2 * DIM, 2 * apart);
        copy(3, count, DIM, top, DIM, apart, both + DIM, 2 * DIM, 2 * apart);
        tape_run(steps, code, 2 * DIM, constants, constant, AXES, row, count, order, ORDERS, both, axes, work);
        follow(&turns, count, u + first, &near, axes + AXES - 1);
        copy(order, count, AXES, axes, AXES, count * AXES, out + first * AXES, AXES, n * AXES);
        if (tip)
            copy(order, count, DIM, bottom, DIM, apart, tip + first * DIM, DIM, n * DIM);
    }
}

#include "planner/geometry/curve_inline.h"
#include "planner/geometry/geometry.h"

void angle_follow(int64_t m, const double *places, const double *angles, int64_t n, const double *u, int64_t apart,
                  double *angle)
{
    const double turn = 6.28318530717958647693;
    int64_t k = 0;
    for (int64_t i = 0; i < n; i++) {
        k = find_piece(m - 1, places, u[i], 0, k);
        const double share = (u[i] - places[k]) / (places[k + 1] - places[k]);
        const double near = angles[k] + share * (angles[k + 1] - angles[k]);
        angle[i * apart] += turn * rint((near - angle[i * apart]) / turn);
    }
}

/* The distance from a leg.  A tube about a line is a stadium, which is convex; together with the discs at the vertices it bounds
   the distance both of the path from the legs, and of the legs from the path. */
#include "joint_inline.h"

/* Distance from the point foot. */
static double from_point(int d, const double *p, const double *foot, double *off, double *curve) {
    double sum = 0.0;
    for (int k = 0; k < d; k++) {
        off[k] = p[k] - foot[k];
        sum += off[k] * off[k];
        for (int m = 0; m < d; m++) curve[k * d + m] = k == m;
    }
    return sum;
}

double joint_vertex(const Problem *problem, int64_t leg, const double *p, double *off, double *curve) {
    const int d = (int)problem->d;
    const double *const origin = problem->vectors + leg * 4 * d;
    double vertex[MOST_AXES];
    for (int k = 0; k < d; k++) vertex[k] = origin[k] + origin[d + k];
    return from_point(d, p, vertex, off, curve);
}

double joint_distance(const Problem *problem, int64_t leg, const double *p, double *off, double *curve) {
    const int d = (int)problem->d;
    const double *const origin = problem->vectors + leg * 4 * d, *const along = origin + 3 * d;
    const double length = problem->lengths[leg];
    double at = 0.0, foot[MOST_AXES];
    for (int k = 0; k < d; k++) at += (p[k] - origin[k]) * along[k];
    const int inside = at > 0.0 && at < length;
    at = smaller(larger(at, 0.0), length);
    for (int k = 0; k < d; k++) foot[k] = origin[k] + at * along[k];
    const double sum = from_point(d, p, foot, off, curve);
    if (inside)
        for (int k = 0; k < d; k++)
            for (int m = 0; m < d; m++) curve[k * d + m] -= along[k] * along[m];
    return sum;
}

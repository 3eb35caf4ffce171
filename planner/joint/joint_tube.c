/* The distance from a leg.  A tube about a line is a stadium, which is convex; together with the discs at the vertices it bounds
   the distance both of the path from the legs, and of the legs from the path.

   The leg o + (1 + k x) (e1 cos wx + e2 sin wx) + g x is a line where w = 0.  Else the foot is taken where the leg has the angle
   phi of p about its axis: with rho the radius of p there, r that of the leg at x = phi / w, and h the height along g,

       dist^2 = (rho - r)^2 + (h - |g| x)^2 + what is left of p across,

   which is the distance from a circle, and an upper bound of that from a helix or spiral. */
#include "joint_inline.h"

/* Distance from the point foot. */
INLINE double from_point(int d, const double *p, const double *foot, double *off, double *curve) {
    double sum = 0.0;
    for (int k = 0; k < d; k++) {
        off[k] = p[k] - foot[k];
        sum += off[k] * off[k];
        for (int m = 0; m < d; m++) curve[k * d + m] = k == m;
    }
    return sum;
}

INLINE double from_line(int d, const double *origin, const double *along, double length, const double *p, double *off,
                        double *curve) {
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

/* A bent leg: o, e1, e2, g, and w, k, length. */
typedef struct {
    const double *origin, *e1, *e2, *g;
    double w, k, length;
} Bend;

INLINE void point_of(int d, const Bend *leg, double x, double *foot) {
    const double grown = 1.0 + leg->k * x, cosine = grown * cos(leg->w * x), sine = grown * sin(leg->w * x);
    for (int k = 0; k < d; k++) foot[k] = leg->origin[k] + cosine * leg->e1[k] + sine * leg->e2[k] + leg->g[k] * x;
}

/* Where the leg has the angle phi: of all turns the one whose height is nearest, or that is on the leg. */
static double turn_of(const Bend *leg, double phi, double height, double rise) {
    const double pi = 3.14159265358979323846, turn = 2.0 * pi / fabs(leg->w), x = phi / leg->w;
    const double wanted = rise > 0.0 ? height / rise : 0.5 * leg->length;
    return x + turn * floor((wanted - x) / turn + 0.5);
}

INLINE double from_bend(int d, const Bend *leg, const double *p, double *off, double *curve) {
    double radius = 0.0, rise = 0.0, a = 0.0, b = 0.0, height = 0.0, foot[MOST_AXES];
    for (int k = 0; k < d; k++) {
        const double q = p[k] - leg->origin[k];
        radius += square(leg->e1[k]);
        rise += square(leg->g[k]);
        a += q * leg->e1[k];
        b += q * leg->e2[k];
        height += q * leg->g[k];
    }
    radius = sqrt(radius);
    rise = sqrt(rise);
    if (rise > 0.0) height /= rise;
    a /= radius;
    b /= radius;
    const double rho = sqrt(a * a + b * b), x = turn_of(leg, atan2(b, a), height, rise);
    if (x <= 0.0 || x >= leg->length || !(rho > 0.0)) {
        point_of(d, leg, x <= 0.0 ? 0.0 : leg->length, foot);
        return from_point(d, p, foot, off, curve);
    }
    /* gradients of the three parts: radial out, round about, and along g */
    const double outer = rho - radius * (1.0 + leg->k * x), higher = rise > 0.0 ? height - rise * x : 0.0;
    const double per = 1.0 / (rho * leg->w), out_x = -radius * leg->k * per, up_x = -rise * per;
    double sum = outer * outer + higher * higher, out[MOST_AXES], up[MOST_AXES];
    for (int k = 0; k < d; k++) {
        const double e1 = leg->e1[k] / radius, e2 = leg->e2[k] / radius, g = rise > 0.0 ? leg->g[k] / rise : 0.0;
        const double radial = (a * e1 + b * e2) / rho, round = (a * e2 - b * e1) / rho;
        const double across = p[k] - leg->origin[k] - a * e1 - b * e2 - height * g * (rise > 0.0);
        out[k] = radial + out_x * round;
        up[k] = rise > 0.0 ? g + up_x * round : 0.0;
        off[k] = outer * out[k] + higher * up[k] + across;
        sum += across * across;
    }
    for (int k = 0; k < d; k++)
        for (int m = 0; m < d; m++) {
            const double plane = (leg->e1[k] * leg->e1[m] + leg->e2[k] * leg->e2[m]) / (radius * radius);
            const double axial = rise > 0.0 ? leg->g[k] * leg->g[m] / (rise * rise) : 0.0;
            curve[k * d + m] = (k == m) - plane - axial + out[k] * out[m] + up[k] * up[m];
        }
    return sum;
}

INLINE double distance(const Problem *problem, int d, int64_t leg, const double *p, double *off, double *curve) {
    const double *const origin = problem->vectors + leg * 4 * d, length = problem->lengths[leg];
    const double w = problem->rates[2 * leg], k = problem->rates[2 * leg + 1];
    if (w == 0.0) return from_line(d, origin, origin + 3 * d, length, p, off, curve);
    const Bend bend = {origin, origin + d, origin + 2 * d, origin + 3 * d, w, k, length};
    return from_bend(d, &bend, p, off, curve);
}

HOT double joint_distance(const Problem *problem, int64_t leg, const double *p, double *off, double *curve) {
    switch (problem->d) {
    case 2: return distance(problem, 2, leg, p, off, curve);
    case 3: return distance(problem, 3, leg, p, off, curve);
    default: return distance(problem, (int)problem->d, leg, p, off, curve);
    }
}

double joint_vertex(const Problem *problem, int64_t leg, const double *p, double *off, double *curve) {
    const int d = (int)problem->d;
    const double *const origin = problem->vectors + leg * 4 * d;
    double vertex[MOST_AXES];
    for (int k = 0; k < d; k++) vertex[k] = origin[k] + origin[d + k];
    return from_point(d, p, vertex, off, curve);
}

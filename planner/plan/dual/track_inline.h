/* The path of a section as a lower bound sees it, one point at a time; see terms.py, and dual.h for the arrays. */
#ifndef PLANNER_PLAN_DUAL_TRACK_INLINE_H
#define PLANNER_PLAN_DUAL_TRACK_INLINE_H

#include "planner/geometry/curve_inline.h"
#include "planner/geometry/differential_inline.h"

#define MAX_MOTIONS 10 /* as many axes as have letters, and the tool tip */

/* Limits of a machine as a track needs them, and what is known at the ends; a NULL speed is none. */
typedef struct {
    double feed, rapid, chord_error, period;
    const double *velocity, *acceleration, *jerk, *axis_weight, *known[2];
} TrackLimits;

typedef struct {
    int64_t cells, motions;
    const double *sigma, *u;
    Pieces axes, tip; /* no pieces of the tip: it is the curve itself */
    int64_t stretches;
    const double *cap_edges, *cap_feed;
    TrackLimits limits;
    const double *way, *rise;
    const uint8_t *ramps, *near;
} Track;

/* Of one point: derivatives of the motions over u, or over sigma, and the cap of x. */
typedef struct {
    double first[MAX_MOTIONS], second[MAX_MOTIONS], cap;
} TrackPoint;

/* Pieces of the last point, tried first for the next. */
typedef struct {
    int64_t axes, tip;
} LastPieces;

/* Way in u from the left and to the right knot, u' and u''. */
typedef struct {
    double gone, left, u1, u2;
} Place;

/* A nan yields to a number, as numpy's fmin has it. */
static inline double number_smaller(double a, double b) { return b < a || isnan(a) ? b : a; }

/* Bernstein coefficients (5) of du/dr in a cell. */
static inline void slope_of_cell(const Track *t, int64_t k, double *slope)
{
    const double digits_lost = 32.0 * 2.220446049250313e-16; /* of u, that say nothing of a way between two knots */
    const double *u = t->u + k, *u1 = u + t->cells + 1, *u2 = u1 + t->cells + 1;
    const double h = t->sigma[k + 1] - t->sigma[k];
    const double s0 = u1[0] * h, s1 = u1[1] * h, b0 = u2[0] * (h * h), b1 = u2[1] * (h * h);
    double lacking = u[1] - u[0] - 0.5 * (s0 + s1) - (b0 - b1) / 12.0;
    if (fabs(lacking) <= digits_lost * larger(fabs(u[0]), fabs(u[1])))
        lacking = 0.0;
    slope[0] = s0;
    slope[1] = s0 + b0 / 4.0;
    slope[2] = 0.5 * (s0 + s1) + (b0 - b1) / 6.0 + 5.0 * lacking;
    slope[3] = s1 - b1 / 4.0;
    slope[4] = s1;
}

/* The quintic u(sigma) of cell k at r. */
static inline Place place_in_cell(const Track *t, int64_t k, double r)
{
    const double h = t->sigma[k + 1] - t->sigma[k], s = 1.0 - r;
    const double r2 = r * r, s2 = s * s, r3 = r2 * r, s3 = s2 * s, r4 = r2 * r2, s4 = s2 * s2;
    double c[5], sums[5], back[5];
    slope_of_cell(t, k, c);
    for (int i = 0; i < 5; i++) {
        sums[i] = (i ? sums[i - 1] : 0.0) + c[i];
        back[i] = (i ? back[i - 1] : 0.0) + c[4 - i];
    }
    Place at;
    at.u1 = s4 * c[0] + 4.0 * r * s3 * c[1] + 6.0 * r2 * s2 * c[2] + 4.0 * r3 * s * c[3] + r4 * c[4];
    at.u2 = s3 * (4.0 * (c[1] - c[0])) + 3.0 * r * s2 * (4.0 * (c[2] - c[1])) + 3.0 * r2 * s * (4.0 * (c[3] - c[2])) +
            r3 * (4.0 * (c[4] - c[3]));
    at.gone = r * (sums[0] * s4 + 2.0 * sums[1] * r * s3 + 2.0 * sums[2] * r2 * s2 + sums[3] * r3 * s +
                   0.2 * sums[4] * r4);
    at.left = s * (back[0] * r4 + 2.0 * back[1] * s * r3 + 2.0 * back[2] * s2 * r2 + back[3] * s3 * r +
                   0.2 * back[4] * s4);
    at.u1 /= h;
    at.u2 /= h * h;
    return at;
}

/* Feed commanded at a parameter, from the left where asked: of the curve's own caps, of rapids, or of the limits. */
static inline double commanded_at(const Track *t, double u, int left)
{
    if (t->stretches == 0)
        return t->limits.feed;
    const double cap = t->cap_feed[find_piece(t->stretches, t->cap_edges, u, left, -1)];
    return isinf(cap) ? t->limits.rapid : smaller(t->limits.feed, cap);
}

/* The path over u in cell k: derivatives of the motions, and the cap of u_dot^2 by feed, chord error and velocities. */
static inline void path_in_cell(const Track *t, int64_t k, double r, double gone, LastPieces *piece, TrackPoint *at)
{
    const int64_t dim = t->motions - 1;
    const double end = t->u[k + 1], u = r >= 1.0 ? end : smaller(t->u[k] + gone, end);
    const int left = u >= end && r > 0.0;
    double q[3 * MAX_MOTIONS];
    piece->axes = point_on_pieces(&t->axes, u, left, piece->axes, 2, MAX_MOTIONS, q);
    double squared = 0.0, along = 0.0, normal = 0.0, slowest = INFINITY;
    for (int64_t j = 0; j < dim; j++) {
        at->first[j] = q[MAX_MOTIONS + j];
        at->second[j] = q[2 * MAX_MOTIONS + j];
        slowest = number_smaller(slowest, t->limits.velocity[j] / fabs(at->first[j]));
    }
    const Pieces *path = t->tip.count > 0 ? &t->tip : &t->axes;
    if (t->tip.count > 0)
        piece->tip = point_on_pieces(path, u, left, piece->tip, 2, MAX_MOTIONS, q);
    const double *tangent = q + MAX_MOTIONS, *bend = tangent + MAX_MOTIONS;
    for (int64_t j = 0; j < path->dim; j++) {
        squared += tangent[j] * tangent[j];
        along += tangent[j] * bend[j];
    }
    const double speed = sqrt(squared), share = along / squared;
    for (int64_t j = 0; j < path->dim; j++)
        normal += square(bend[j] - share * tangent[j]);
    at->first[dim] = speed;
    at->second[dim] = speed > 0.0 ? along / speed : 0.0;
    double feed = commanded_at(t, u, 0);
    if (t->stretches > 0) /* where it changes within a cell, the larger */
        feed = larger(larger(feed, commanded_at(t, t->u[k], 0)), commanded_at(t, end, 1));
    const double curvature = sqrt(normal) / squared;
    if (!isinf(t->limits.chord_error) && curvature > 0.0)
        feed = smaller(feed, 2.0 / t->limits.period * half_chord(1.0 / curvature, t->limits.chord_error));
    const double rate = number_smaller(speed > 0.0 ? feed / speed : INFINITY, slowest);
    at->cap = rate * rate;
}

/* Largest u_dot^2 that the motions reach on their ways (motions) from an end. */
static inline double reached_from(const Track *t, int64_t k, int end, const double *first, const double *way)
{
    const double min_share = 0.05; /* a motion that hardly takes part says little, and its way may be all rounding */
    const int64_t dim = t->motions - 1;
    const uint8_t *ramps = t->ramps + end * t->motions * t->cells + k;
    double most = 0.0, reached = INFINITY;
    for (int64_t j = 0; j < dim; j++)
        most = larger(most, fabs(first[j]) * t->limits.axis_weight[j]);
    for (int64_t m = 0; m < t->motions; m++) {
        if (m < dim && fabs(first[m]) * t->limits.axis_weight[m] < min_share * most)
            continue;
        const double speed = t->limits.known[end][m], squared = first[m] * first[m];
        const double energy = speed * speed + 2.0 * t->limits.acceleration[m] * way[m];
        reached = number_smaller(reached, energy / squared);
        if (ramps[m * t->cells]) {
            const double root = cbrt(1.5 * sqrt(2.0 * t->limits.jerk[m]) * way[m]);
            reached = number_smaller(reached, square(root * root) / squared);
        }
    }
    return reached;
}

/* Ways (motions) of the motions from an end to a place in cell k, or more. */
static inline void ways_to(const Track *t, int64_t k, int end, double gone_or_left, double *way)
{
    const double *known = t->way + end * t->motions * (t->cells + 1) + k + end;
    for (int64_t m = 0; m < t->motions; m++) /* rounding next to an end may leave less than nothing */
        way[m] = larger(known[m * (t->cells + 1)] + t->rise[m * t->cells + k] * gone_or_left, 0.0);
}

/* The path over sigma in cell k at r, from inside the cell. */
static inline void point_on_track(const Track *t, int64_t k, double r, LastPieces *piece, TrackPoint *at)
{
    const double margin = 1.01; /* ways are sums of the largest values at a few samples of each cell */
    const Place place = place_in_cell(t, k, r);
    path_in_cell(t, k, r, place.gone, piece, at);
    const int open = !isfinite(at->cap);
    for (int end = 0; end < 2; end++) {
        if (!t->limits.known[end] || !(t->near[end * t->cells + k] || open))
            continue;
        double way[MAX_MOTIONS];
        ways_to(t, k, end, end == 0 ? place.gone : place.left, way);
        for (int64_t m = 0; m < t->motions; m++)
            way[m] *= margin;
        at->cap = smaller(at->cap, reached_from(t, k, end, at->first, way));
    }
    const double squared = place.u1 * place.u1;
    for (int64_t m = 0; m < t->motions; m++) {
        at->second[m] = at->second[m] * squared + at->first[m] * place.u2;
        at->first[m] *= place.u1;
    }
    at->cap /= squared;
}

/* The arguments that every function begins with, as a structure. */
static inline Track track_of(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces,
                             int64_t terms, const double *breaks, const double *coefficients, int64_t rational,
                             const uint8_t *resting, const double *origin, int64_t tip_pieces, int64_t tip_dim,
                             int64_t tip_terms, const double *tip_breaks, const double *tip_coefficients,
                             int64_t tip_rational, const uint8_t *tip_resting, const double *tip_origin,
                             int64_t stretches, const double *cap_edges, const double *cap_feed, const double *scalars,
                             const double *velocity, const double *acceleration, const double *jerk,
                             const double *axis_weight, const double *start_speed, const double *end_speed,
                             const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near)
{
    const Track track = {cells,
                         motions,
                         sigma,
                         u,
                         {pieces, motions - 1, terms, breaks, coefficients, origin, resting, rational != 0},
                         {tip_pieces, tip_dim, tip_terms, tip_breaks, tip_coefficients, tip_origin, tip_resting,
                          tip_rational != 0},
                         stretches,
                         cap_edges,
                         cap_feed,
                         {scalars[0], scalars[1], scalars[2], scalars[3], velocity, acceleration, jerk, axis_weight,
                          {start_speed, end_speed}},
                         way,
                         rise,
                         ramps,
                         near};
    return track;
}

#endif

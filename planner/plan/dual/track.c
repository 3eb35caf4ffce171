#include "planner/plan/dual/dual.h"

#include "planner/plan/dual/track_inline.h"

void track_points(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces, int64_t terms,
                  const double *breaks, const double *coefficients, int64_t rational, const uint8_t *resting,
                  const double *origin, int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms,
                  const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                  const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                  const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                  const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                  const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t n,
                  const int64_t *k, const double *r, double *first, double *second, double *cap)
{
    const Track track = track_of(cells, motions, sigma, u, pieces, terms, breaks, coefficients, rational,
                                 resting, origin, tip_pieces, tip_dim, tip_terms, tip_breaks, tip_coefficients,
                                 tip_rational, tip_resting, tip_origin, stretches, cap_edges, cap_feed, scalars,
                                 velocity, acceleration, jerk, axis_weight, start_speed, end_speed, way, rise, ramps,
                                 near);
    LastPieces piece = {0, 0};
    for (int64_t i = 0; i < n; i++) {
        TrackPoint at;
        point_on_track(&track, k[i], r[i], &piece, &at);
        for (int64_t m = 0; m < motions; m++) {
            first[m * n + i] = at.first[m];
            second[m * n + i] = at.second[m];
        }
        cap[i] = at.cap;
    }
}

void track_reach(int64_t cells, int64_t motions, const double *sigma, const double *u, int64_t pieces, int64_t terms,
                 const double *breaks, const double *coefficients, int64_t rational, const uint8_t *resting,
                 const double *origin, int64_t tip_pieces, int64_t tip_dim, int64_t tip_terms,
                 const double *tip_breaks, const double *tip_coefficients, int64_t tip_rational,
                 const uint8_t *tip_resting, const double *tip_origin, int64_t stretches, const double *cap_edges,
                 const double *cap_feed, const double *scalars, const double *velocity, const double *acceleration,
                 const double *jerk, const double *axis_weight, const double *start_speed, const double *end_speed,
                 const double *way, const double *rise, const uint8_t *ramps, const uint8_t *near, int64_t n,
                 const int64_t *k, const double *r, double *first, double *cap, double *reached)
{
    const Track track = track_of(cells, motions, sigma, u, pieces, terms, breaks, coefficients, rational,
                                 resting, origin, tip_pieces, tip_dim, tip_terms, tip_breaks, tip_coefficients,
                                 tip_rational, tip_resting, tip_origin, stretches, cap_edges, cap_feed, scalars,
                                 velocity, acceleration, jerk, axis_weight, start_speed, end_speed, way, rise, ramps,
                                 near);
    LastPieces piece = {0, 0};
    for (int64_t i = 0; i < n; i++) {
        TrackPoint at;
        const Place place = place_in_cell(&track, k[i], r[i]);
        path_in_cell(&track, k[i], r[i], place.gone, &piece, &at);
        for (int64_t m = 0; m < motions; m++)
            first[m * n + i] = at.first[m];
        cap[i] = at.cap;
        for (int end = 0; reached && end < 2; end++) {
            double ways[MAX_MOTIONS];
            ways_to(&track, k[i], end, end == 0 ? place.gone : place.left, ways);
            reached[end * n + i] = track.limits.known[end] ? reached_from(&track, k[i], end, at.first, ways) : INFINITY;
        }
    }
}

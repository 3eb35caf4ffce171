#include "planner/geometry/blend_inline.h"
#include "planner/geometry/geometry.h"

enum { LEG, BLEND, SPAN }; /* kinds of pieces */
enum { SPAN_TERMS = 5 };

/* Legs by rows: vectors (., 4, dim), rates (., 2), and ways (., 3) along the curves, or NULL. */
typedef struct {
    int64_t dim;
    const double *vectors, *rates, *ways;
    const Beziers *beziers;
} Legs;

static inline Leg leg_of(const Legs *legs, int64_t row)
{
    const double *way = legs->ways ? legs->ways + row * 3 : legs->ways;
    const Leg leg = {legs->dim, legs->vectors + row * 4 * legs->dim, legs->rates + row * 2, way, legs->beziers};
    return leg;
}

/* The blends of a chain, and the inverse of their arc length. */
typedef struct {
    const double *vertex;
    Legs before, after;
    const double *size, *length;
    const int64_t *shape, *first_panel;
    const double *edges, *series;
} Blends;

static inline void point_on_blend(const Blends *blends, int64_t row, double s, int64_t order, int64_t *guess,
                                  Derivatives out)
{
    const int64_t dim = blends->before.dim;
    const double length = blends->length[row];
    const Leg before = leg_of(&blends->before, row), after = leg_of(&blends->after, row);
    double tau = s <= 0.0 ? -1.0 : 1.0;
    if (0.0 < s && s < length)
        tau = tau_of_share(blends->first_panel, blends->edges, blends->series, blends->shape[row], s / length, guess);
    blend_at(blends->vertex + row * dim, &before, &after, blends->size[row], tau, out);
    if (order > 0)
        by_arc_length(dim, blends->before.beziers->weight, out);
}

/* Value and three derivatives of quartics with ascending powers (dim, 5) at w = x / width. */
static inline void point_on_span(const double *powers, int64_t dim, double w, double width, Derivatives out)
{
    for (int64_t j = 0; j < dim; j++, powers += SPAN_TERMS) {
        const double c1 = powers[1], c2 = powers[2], c3 = powers[3], c4 = powers[4];
        out[0][j] = powers[0] + w * (c1 + w * (c2 + w * (c3 + w * c4)));
        out[1][j] = (c1 + w * (2.0 * c2 + w * (3.0 * c3 + w * 4.0 * c4))) / width;
        out[2][j] = (2.0 * c2 + w * (6.0 * c3 + w * 12.0 * c4)) / (width * width);
        out[3][j] = (6.0 * c3 + w * 24.0 * c4) / (width * width * width);
    }
}

static inline void point_on_leg(const Leg *leg, double x, Derivatives out)
{
    leg_turning(leg, x, out);
    for (int64_t j = 0; j < leg->dim; j++)
        out[0][j] += leg->vectors[j];
}

void chain_evaluate(int64_t pieces, int64_t dim, const double *weight, const double *edges, const uint8_t *kind,
                    const int64_t *row, const double *offset, const double *legs, const double *leg_rates, const double *leg_ways,
                    const double *spans, int64_t terms, const double *powers, const double *curve_length,
                    const int64_t *first_curve_panel, const double *curve_edges, const double *curve_panels,
                    const double *vertex, const double *before, const double *before_rates, const double *before_ways,
                    const double *after, const double *after_rates, const double *after_ways, const double *size,
                    const double *length, const int64_t *shape, const int64_t *first_panel, const double *panel_edges,
                    const double *panels, int64_t n, const double *u, const uint8_t *left, const int64_t *piece,
                    int64_t order, double *out)
{
    const Beziers beziers = {dim, terms, powers, curve_length, first_curve_panel, curve_edges, curve_panels, weight};
    const Legs own = {dim, legs, leg_rates, leg_ways, &beziers};
    const Blends blends = {vertex,
                           {dim, before, before_rates, before_ways, &beziers},
                           {dim, after, after_rates, after_ways, &beziers},
                           size,
                           length,
                           shape,
                           first_panel,
                           panel_edges,
                           panels};
    int64_t at = 0, panel = 0;
    for (int64_t i = 0; i < n; i++) {
        at = piece ? piece[i] : find_piece(pieces, edges, u[i], left[i], at);
        const double x = piece ? u[i] : u[i] - edges[at];
        Derivatives d;
        if (kind[at] == LEG) {
            const Leg leg = leg_of(&own, row[at]);
            point_on_leg(&leg, offset[at] + x, d);
        } else if (kind[at] == BLEND) {
            point_on_blend(&blends, row[at], x, order, &panel, d);
        } else {
            const double width = edges[at + 1] - edges[at];
            point_on_span(spans + row[at] * SPAN_TERMS * dim, dim, x / width, width, d);
        }
        for (int64_t k = 0; k <= order; k++)
            for (int64_t j = 0; j < dim; j++)
                out[(k * n + i) * dim + j] = d[k][j];
    }
}

/* Curves, their arc length and the formulas that go with them, compiled. */
#ifndef PLANNER_GEOMETRY_GEOMETRY_H
#define PLANNER_GEOMETRY_GEOMETRY_H

#include <stdint.h>

/* Write the derivatives 0..order (at most 3) of a curve at u (n) into out (order + 1, n, dim), from the left where
 * left (n) says so.  Pieces: breaks (pieces + 1), coefficients (pieces, dim + 1, terms), resting and origin (pieces,
 * dim). */
void curve_evaluate(int64_t pieces, int64_t dim, int64_t terms, const double *breaks, const double *coefficients,
                    int64_t rational, const uint8_t *resting, const double *origin, int64_t n, const double *u,
                    const uint8_t *left, int64_t order, double *out);

/* Write the arc length at every u (n) into out (n).  Panels: edges and lengths (panels + 1), and the Chebyshev series
 * (panels, terms) of the length since a panel's left edge. */
void arclength_at(int64_t panels, int64_t terms, const double *edges, const double *lengths, const double *series,
                  int64_t n, const double *u, double *out);

/* Write the parameter at every arc length s (n) into out (n); where the curve rests the last (left: the first) that
 * has it. Panels as above, with the Chebyshev series of the speed (panels, speed_terms). */
void arclength_inverse(int64_t panels, int64_t terms, int64_t speed_terms, const double *edges, const double *lengths,
                       const double *series, const double *speeds, int64_t n, const double *s, int64_t left,
                       double *out);

/* Run the steps of a tape, code (steps, 4): what to do, the slots of two operands, that of the result, which is none of these.
 * Slots: the inputs, the constants, and what the steps make; row (rows): those of the results.  in (given, n, inputs): values and
 * derivatives with respect to a parameter, given = 4, of which only the values are read if order is 0; or values alone, given = 1,
 * of the parameter itself.  out (order + 1, n, rows).  work: 128 numbers for each slot. */
void tape_run(int64_t steps, const int32_t *code, int64_t inputs, int64_t constants, const double *constant,
              int64_t rows, const int32_t *row, int64_t n, int64_t order, int64_t given, const double *in, double *out,
              double *work);

/* Write the machine axes of a flank-milling path and their derivatives 0..order (at most 3) at u (n), from the left where left (n)
 * says so, into out (order + 1, n, 5); and where tip is no NULL those of the bottom spline, (order + 1, n, 3).  Bottom and top:
 * pieces as above, of three dimensions.  The map from both splines to the axes is a tape without its sizes: 6 inputs, 5 results.
 * The last axis is C: whole turns are added, so that it is next to the broken line through places and angles (m each, m > 1,
 * places increasing).  work: 128 numbers for each slot of the tape. */
void fiveaxis_evaluate(int64_t bottom_pieces, int64_t bottom_terms, const double *bottom_breaks,
                       const double *bottom_coefficients, int64_t bottom_rational, const uint8_t *bottom_resting,
                       const double *bottom_origin, int64_t top_pieces, int64_t top_terms, const double *top_breaks,
                       const double *top_coefficients, int64_t top_rational, const uint8_t *top_resting,
                       const double *top_origin, int64_t steps, const int32_t *code, int64_t constants,
                       const double *constant, const int32_t *row, int64_t m, const double *places, const double *angles,
                       int64_t n, const double *u, const uint8_t *left, int64_t order, double *out, double *tip,
                       double *work);

/* Tabulate the inverse of a blend's arc length: the Chebyshev series (panels, 12) of tau over the share of the length, on panels
 * between edges (panels + 1) within 0 .. 1, as narrow as it takes for rounding to be all that is left out.  Returns how many
 * panels there are; -1 if more than room.  lengths (terms) and speeds (speed_terms): Chebyshev series of the length, and of its
 * derivative, over x in [-1, 1], where tau = b sinh(x asinh(1/b)). */
int64_t blend_tabulate(int64_t terms, const double *lengths, int64_t speed_terms, const double *speeds, double b,
                       int64_t room, double *edges, double *series);

/* Write tau at shares (n) of the length of blends of a shape (n) each.  The panels of shape i are from first_panel[i] on, with one
 * edge more than panels for each shape. */
void blend_tau(int64_t n, const int64_t *shape, const double *share, const int64_t *first_panel, const double *edges,
               const double *series, double *tau);

/* Write the derivatives 0..order (at most 3) of a chain at u (n) into out (order + 1, n, dim), from the left where left (n) says
 * so; or where piece (n) is no NULL, at the distances u from the starts of those pieces.
 * dim columns; weight (dim) is what the square of each counts in the arc length of blends and curves.  Pieces: edges (pieces
 * + 1); kind (0 leg, 1 blend, 2 span), its row among those of its kind, and offset (pieces).  Legs: vectors (., 4, dim), rates (., 2), and where some are stretches of curves ways (., 3); spans: (., dim, 5).  Curves: as for bezier_at.
 * Blends: vertex (., dim), the legs before and after each, its size, length and shape; of each shape the panels from first_panel
 * on, as blend_tabulate makes them, each shape with one edge more. */
void chain_evaluate(int64_t pieces, int64_t dim, const double *weight, const double *edges, const uint8_t *kind,
                    const int64_t *row, const double *offset, const double *legs, const double *leg_rates, const double *leg_ways,
                    const double *spans, int64_t terms, const double *powers, const double *curve_length,
                    const int64_t *first_curve_panel, const double *curve_edges, const double *curve_panels,
                    const double *vertex, const double *before, const double *before_rates, const double *before_ways,
                    const double *after, const double *after_rates, const double *after_ways, const double *size,
                    const double *length, const int64_t *shape, const int64_t *first_panel, const double *panel_edges,
                    const double *panels, int64_t n, const double *u, const uint8_t *left, const int64_t *piece,
                    int64_t order, double *out);

/* Write the way from the start of curves row (n) to the distances s (n) along them, and three derivatives over s, into out (4, n,
 * dim).  Curves: powers (., dim + 1, terms) over w in [0, 1], the denominator last; the length of each; the panels of 2 w - 1 over
 * the share of the length from first_panel on, as blend_tabulate makes them, each curve with one edge more. */
void bezier_at(int64_t dim, int64_t terms, const double *powers, const double *length, const int64_t *first_panel,
               const double *edges, const double *series, int64_t n, const int64_t *row, const double *s, double *out);

/* Write position and three derivatives over w of each of n curves with powers (n, dim + 1, terms) at w (m) into out (n, m, 4, dim). */
void bezier_over(int64_t n, int64_t dim, int64_t terms, const double *powers, int64_t m, const double *w, double *out);

/* The formulas of differential_inline.h at n points, for their test.  Everywhere out (3, n): */

/* from derivatives q (3, n) and rates u (3, n); */
void differential_chain_rule(int64_t n, const double *q, const double *u, double *out);
/* from |C'|^2, C'.C'' and |C''|^2 + C'.C''' in products (3, n); */
void differential_speed_derivatives(int64_t n, const double *products, double *out);
/* from |C'| and its derivatives in speeds (3, n) and rates u (3, n); */
void differential_rates_along(int64_t n, const double *speeds, const double *u, double *out);
/* from speeds (3, n) and the rates s (3, n) of the arc length. */
void differential_rates_of_parameter(int64_t n, const double *speeds, const double *s, double *out);
/* Half the chord (n) that leaves a circle of each radius (n) by an error (n). */
void differential_half_chord(int64_t n, const double *radius, const double *error, double *out);

#endif

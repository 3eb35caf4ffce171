/* The dense passes of the independent check, compiled. */
#ifndef PLANNER_VERIFY_VERIFY_H
#define PLANNER_VERIFY_VERIFY_H

#include <stdint.h>

/* A time law is a table (intervals, 17), a row each: start and duration h; u, u' and u'' at both ends as tabulated; six
 * coefficients of the powers of x = (t - start) / h; what the rounding of the nodes can change in u', u'' and the third rate. */

/* Write the table of the quintics between nodes (nodes each), those of double nodes left out; returns how many there are. */
int64_t law_table(int64_t nodes, const double *t, const double *u, const double *u_rate, const double *u_acceleration,
                  double *table);

/* Write the interval that holds each time t (n), and the share x of it that has passed.  start: (intervals). */
void law_locate(int64_t intervals, const double *table, const double *start, int64_t n, const double *t,
                int64_t *interval, double *x);

/* Write u at each time t (n), held at the last node and within low .. high. */
void law_parameters(int64_t intervals, const double *table, const double *start, int64_t n, const double *t, double low,
                    double high, double *u);

/* Write u, and with rows = 4 its first three time derivatives, of quintics at k points each: out (rows, n, k) at x (n, k) of
 * interval (n). */
void law_values(const double *table, int64_t n, int64_t k, const int64_t *interval, const double *x, int64_t rows,
                double *out);

/* Write the place x in [0, 1] at which u passes each of u (n) on interval (n), by bisection. */
void law_crossings(const double *table, int64_t n, const int64_t *interval, const double *u, double *x);

/* Write k >= 2 equidistant x (n, k) on spans (n) from lower to upper, both ends included exactly. */
void motion_grid(int64_t n, int64_t k, const int64_t *span, const double *lower, const double *upper, double *x);

/* Write u on spans (n) at k points each, x and u (n, k), within the ends of each span, and whether a point is the last of its
 * span, so that the curve is taken from the left there; further the time derivatives rates (3, n, k) and their slack (n, 3),
 * where these are not NULL.  Of all spans: interval, upper (spans) and u_ends (2, spans). */
void motion_place(const double *table, int64_t spans, const int64_t *interval, const double *upper,
                  const double *u_ends, int64_t n, int64_t k, const int64_t *span, const double *x, double *u,
                  uint8_t *left, double *rates, double *slack);

/* Both for the spans of a window, its first and how many, at most room: x (room, k), u, left, rates (3, room, k) and slack. */
void motion_sweep(const double *table, int64_t spans, const int64_t *interval, const double *lower, const double *upper,
                  const double *u_ends, int64_t room, int64_t k, const int64_t *window, double *x, double *u, uint8_t *left,
                  double *rates, double *slack);

/* Write all quantities of quantities.py and their slack, (4 + 3 dim, n, k), on n spans at k points each, from the derivatives
 * d (4, n k, dim) of the machine axes and p (4, n k, tip) of the tool tip with respect to u (p NULL: the same), the time
 * derivatives of u, rates (3, n, k), and what rounding can change in these, slack (n, 3). */
void motion_measure(int64_t n, int64_t k, int64_t dim, int64_t tip, const double *d, const double *p,
                    const double *rates, const double *slack, double *values, double *granted);

/* Measure the spans of a window as motion_measure does, as motion_sweep has placed them, and keep of each of them, and of every quantity
 * among all spans, only the highest.
 * ends (2, 4 + 3 dim, spans): values at the first and the last point; best, best_span, best_x (4 + 3 dim, candidates): the highest
 * peaks of the sizes less their slack, kept (4 + 3 dim) of them, as peaks_keep has them; largest (4 + 3 dim) is raised to the largest
 * of these without the parabola; jerk (dim, spans): the peak of the axes' jerk less its slack; feed and feed_place (spans): the
 * highest feed at the points, and x there.
 * course (spans, 5 + 6 tip): of the tip the largest acceleration across and along its path, the fastest turning of its direction, and
 * the largest jerk along and across at the points; then place, velocity and direction at both ends.
 * mean and mean_slack (dim, spans): the size of the mean jerk of every axis over the interval that a span is, and what rounding can make
 * of it; 0 of others.  gap (spans): between the knots of the curve around it.
 * work: 31 k numbers.  d (4, room k, dim) and p (4, room k, tip) as in motion_measure. */
void scan_measure(const double *table, int64_t spans, const int64_t *interval, const double *lower, const double *upper,
                  const double *u_ends, const double *gap, int64_t room, int64_t k, const int64_t *window, const double *x,
                  const double *rates, const double *slack, int64_t dim, int64_t tip, double *ends, int64_t candidates,
                  int64_t *kept, double *best, int64_t *best_span, double *best_x, double *largest, double *jerk,
                  double *feed, double *feed_place, double *course, double *mean, double *mean_slack, double *work,
                  const double *d, const double *p);

/* Write the size less its slack of one quantity a span, row (n), at its points: used (n, k). */
void scan_used(int64_t n, int64_t k, int64_t dim, int64_t tip, const double *rates, const double *slack, const int64_t *row,
               double *used, const double *d, const double *p);

/* At n nodes, from the derivatives p (4, n, tip) of the tool tip and the time derivatives of u, rates (3, n): write the sizes of the terms
 * that feed, acceleration and jerk are sums of, terms (3, n), and the curvature, bend (n).  values (4 + 3 dim, n) are those of
 * motion_measure, whose rates along the path become 0 where the tip rests in the parameter. */
void columns_terms(int64_t n, int64_t tip, const double *p, const double *rates, double *values, double *terms, double *bend);

/* Write the difference of what is shown and expected over what is granted, used (n); infinite where it is no number. */
void columns_used(int64_t n, const double *shown, const double *expected, const double *granted, double *used);

/* Write how much is used of k limits, each on the quantity of a row, shares (k, n), and what rounding can change in that, slack (k, n):
 * 0 where it is no number.  rate (k, n) multiplies values and granted, (4 + 3 dim, n), where it is not NULL. */
void columns_shares(int64_t n, int64_t k, const int64_t *row, const double *allowed, const double *rate, const double *values,
                    const double *granted, double *shares, double *slack);

/* Write which nodes (n) name a limit of which less is used than of another of the k; returns how many.  named (n): -1 for none; granted
 * is the tolerance, and so many slacks of the limits that are used as much. */
int64_t columns_misnamed(int64_t n, int64_t k, const double *shares, const double *slack, const int64_t *named,
                         double tolerance, double slacks, uint8_t *wrong);

/* Write what no chord of a period within windows (n) of time, each from .. to, both ascending, can be left by: bound (n), further than
 * by rounding.  Of all spans: time (2, spans) their begin and end, course as scan_measure writes it with so many points.  turning: the
 * tip is made of the axes, so that it has a direction wherever the curve has one.  work: 5 numbers a
 * span, and 3; queue: 2 a span. */
void chord_bounds(int64_t spans, int64_t tip, int64_t points, int64_t turning, const double *time, const double *course,
                  double period, int64_t n, const double *from, const double *to, double *bound, double *work, int64_t *queue);

/* Write the largest distance from each chord to the path above it, and its point, of n groups of chords each.  Chord i of a group runs
 * from its point i stride to i stride + parts; points (n, (chords - 1) stride + parts + 1, dim); the distance is that to the segment.
 * height and top (n, chords).  work: dim numbers for each point of a group, and parts + 3 for each chord. */
void chord_heights(int64_t n, int64_t chords, int64_t dim, int64_t stride, int64_t parts, const double *points,
                   double *height, int64_t *top, double *work);

/* Write u, (n, m, m + 2), at trial chords of a period: of each of n chords all that begin at its start plus steps (m) times half a
 * width, at both ends and at its share plus steps times half a width of that: halves (2). */
void chord_trials(int64_t intervals, const double *table, const double *begin, double low, double high, double period, int64_t n,
                  int64_t m, const double *steps, const double *halves, const double *start, const double *share, double *u);

/* Move start and share (n) to the highest of the trials, at points (n, m, m + 2, dim), write how high it is, and narrow halves.  work: m
 * (dim + 2) numbers. */
void chord_choose(int64_t n, int64_t m, int64_t dim, const double *steps, double end, double *halves, double *start,
                  double *share, double *height, double *work, const double *points);

/* Take what is offered, height and x (rows, n) with index (n), among the highest of each row: best, best_index and best_x (rows,
 * room), highest first, of equal ones that of the least index; kept (rows) of them hold something. */
void peaks_keep(int64_t rows, int64_t n, const double *height, const int64_t *index, const double *x, int64_t room,
                int64_t *kept, double *best, int64_t *best_index, double *best_x);

/* Write trials (n, m): x plus steps (m) times a half width, each between its bounds. */
void peaks_trials(int64_t n, int64_t m, const double *steps, const double *x, const double *half, const double *lower,
                  const double *upper, double *trials);

/* Move each x to the highest of its trials, the first of equals, and narrow its half width. */
void peaks_choose(int64_t n, int64_t m, const double *trials, const double *heights, double shrink, double *x, double *half);

#endif

/* Adaptive feed with look-ahead, 2007: points at the feed that the curvature allows, braking, interpolation. */
#include "interp/literature/literature.h"

#include "interp/literature/chord_inline.h"

enum { AVERAGED, UNIFORM };

/* Indices into the limits. */
enum { COMMAND, NORMAL_ACCELERATION, CHORD_ERROR, CYCLE };

/* Curvature of the tool tip, |C'' - (|C'|'/|C'|) C'| / |C'|^2: the part of C'' along C' is taken off first. */
static double curvature(const double *piece, Shape shape, double u, Triple speeds)
{
    const Tip tip = tip_of(shape);
    const double speed = speeds.first, scale = 1.0 / piece[1], w = (u - piece[0]) * scale;
    Derivatives d = {1.0, 0.0, 0.0, 0.0};
    if (tip.rational)
        d = polynomial(piece + tip.last * shape.powers, shape.powers, w, scale, 2);
    double squared = 0.0;
    for (int64_t j = tip.first; j < tip.last; j++) {
        Derivatives c = polynomial(piece + j * shape.powers, shape.powers, w, scale, 2);
        if (tip.rational)
            c = quotient(c, d);
        const double normal = c.c2 - speeds.second / speed * c.c1;
        squared += normal * normal;
    }
    return sqrt(squared) / (speed * speed);
}

/* Feed within the command, the normal acceleration and the chord error. */
static double adaptive_feed(const double *limits, double curved)
{
    const double radius = 1.0 / curved, error = smaller(limits[CHORD_ERROR], radius);
    double v = smaller(limits[COMMAND], sqrt(limits[NORMAL_ACCELERATION] * radius));
    if (isfinite(limits[CHORD_ERROR]))
        v = smaller(v, 2.0 / limits[CYCLE] * sqrt(error * (2.0 * radius - error)));
    return v;
}

int64_t lookahead_points(const double *limits, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                         double u_end, int64_t count, double *u, double *feed, double *lengths)
{
    const Shape shape = {dim, rows, powers};
    int64_t owner = 0;
    for (int64_t i = 0; i < count; i++) {
        owner = piece_of(pieces, shape, u[i], owner);
        const double *piece = piece_at(pieces, shape, owner);
        const Triple speeds = tip_speed(piece, shape, u[i], 2);
        feed[i] = adaptive_feed(limits, curvature(piece, shape, u[i], speeds));
        if (u[i] >= u_end)
            return i + 1;
        const double following = smaller(u[i] + limits[CYCLE] * feed[i] / speeds.first, u_end);
        if (i + 1 == count)
            return -1;
        if (!(following > u[i]))
            return -2 - i;
        u[i + 1] = following;
        const double *far = piece_at(pieces, shape, piece_of(pieces, shape, following, owner));
        lengths[i] = chord_length(piece, u[i], far, following, shape);
    }
    return -1;
}

double lookahead_brake(double twice, int64_t count, const double *lengths, double *squares)
{
    double farthest = 0.0;
    for (int64_t j = 0; j < count; j++) {
        squares[j + 1] = smaller(squares[j + 1], squares[j] + twice * lengths[j]);
        double back = 0.0;
        for (int64_t i = j; i >= 0 && squares[i] > squares[i + 1] + twice * lengths[i]; i--) {
            squares[i] = squares[i + 1] + twice * lengths[i];
            back += lengths[i];
        }
        farthest = larger(farthest, back);
    }
    return farthest;
}

/* Distance covered in one period from u on, V^2 linear in the distance between the points; arrives: at the last of them. */
static double travel(int64_t count, const double *points, const double *squares, const double *lengths, int64_t i, double u,
                     double period, int *arrives)
{
    const double share = (u - points[i]) / (points[i + 1] - points[i]);
    double v = sqrt(larger(squares[i] + share * (squares[i + 1] - squares[i]), 0.0));
    double left = (1.0 - share) * lengths[i];
    double time = period, covered = 0.0;
    *arrives = 0;
    for (;;) {
        const double v1 = sqrt(squares[i + 1]);
        const double needed = left > 0.0 ? 2.0 * left / (v + v1) : 0.0;
        if (needed > time)
            return covered + time * (v + 0.25 * time * (v1 * v1 - v * v) / left);
        covered += left;
        time -= needed;
        i++;
        if (i + 1 >= count) {
            *arrives = 1;
            return covered;
        }
        v = v1;
        left = lengths[i];
    }
}

int64_t lookahead_run(int64_t rule, int64_t order, int64_t count, const double *points, const double *squares,
                      const double *lengths, const double *pieces, int64_t dim, int64_t rows, int64_t powers,
                      double period, double least, int64_t room, double *u, double *feed, double *positions)
{
    const Shape shape = {dim, rows, powers};
    const double end = points[count - 1];
    int64_t i = 0, owner = 0;
    double at = points[0], v = sqrt(squares[0]);
    for (int64_t k = 0; k < room; k++) {
        owner = piece_of(pieces, shape, at, owner);
        const double *piece = piece_at(pieces, shape, owner);
        u[k] = at;
        position(piece, shape, local(piece, at), positions + k * dim);
        if (at >= end) {
            feed[k] = sqrt(squares[count - 1]);
            return k + 1;
        }
        while (points[i + 1] <= at)
            i++;
        int arrives = 0;
        if (rule == UNIFORM)
            v = travel(count, points, squares, lengths, i, at, period, &arrives) / period;
        else if (k > 0)
            v = larger(0.5 * (v + sqrt(squares[i + 1])), least);
        feed[k] = v;
        const double step = taylor_series(order, period, tip_speed(piece, shape, at, order), v, 0.0, 0.0);
        at = arrives ? end : smaller(at + step, end);
    }
    return -1;
}

/* LinuxCNC's motion queue: every move as it is added to it, the corner before it, and the speeds at the ends.
 *
 * 1. A move that is added may change the end of the one before it: whoever comes last has no fixed length.
 * 2. Nearly tangent: what the axes must do at once at the joint, at the highest speed, is less than a share (0.1) of their
 *    acceleration; they keep the speed, and lose that share of acceleration on both sides.
 * 3. Otherwise the best of three: pass the kink at the speed at which that share is enough; an arc; or overlap the two
 *    moves (parabolic), for which both have half of their acceleration.
 * 4. A line of which an arc leaves less than four periods is taken up by it, as its lead.
 * 5. Speeds at ends: v^2 = w^2 + 2 a L backwards from the last move, at the middle of which the motion must be able to
 *    stop.
 */
#include "planner/controllers/controllers.h"

#include <string.h>

#include "planner/controllers/linuxcnc_inline.h"

#define MOST_MERGED 100     /* lines that become one, but for the last */
#define PEAKS 4             /* of the speed, behind which earlier ends are not looked at again */
#define FEWEST_PERIODS 1.02 /* of a segment */
#define NEAR_ANGLE 1e-6
#define SHORTEST_ROUNDING 1e-6 /* mm */
#define SHARPEST_BLEND 1e-3    /* rad, of the angle from straight on */
#define HALF_TURN 3.14159265358979323846
#define TURNS_BACK (2.0 * HALF_TURN / 180.0)
#define LEAST_HALF_ANGLE (HALF_TURN / 12.0) /* between two arcs */
#define STEEPEST_HELIX 1e-3            /* mm, of an arc that can be shortened */
#define KINK_OF_ROUNDING 0.25          /* of the acceleration across */

static const double ACROSS_SHARE = 0.86602540378443864676; /* sqrt(1 - ALONG_SHARE^2) */

typedef struct {
    double theta, turn, reach_in, reach_out, tolerance; /* half angle, change of direction, what may be taken of both */
    double in[3], out[3], tangent_in[3], tangent_out[3], corner[3], normal[3], binormal[3];
    double centre_in[3], centre_out[3], radius_in, radius_out, most_in, most_out; /* angles that may be taken of arcs */
    int convex_in, convex_out;
    double acceleration, speed, asked, radius, distance; /* of the rounding */
    double centre[3], trim_in, trim_out, lead;
    int consumes;
} Corner;

void linuxcnc_sizes(int64_t *out) {
    out[0] = (int64_t)(sizeof(Machine) / sizeof(double));
    out[1] = (int64_t)(sizeof(Move) / sizeof(double));
    out[2] = (int64_t)(sizeof(Segment) / sizeof(double));
}

/* Directions */

static void circle_tangent(const Segment *s, double angle, double *out) {
    double point[3], radial[3], turning[3];
    circle_point(s, angle, point);
    add3(point, -1.0, s->origin, radial);
    cross3(s->normal, radial, turning);
    add3(turning, 1.0 / s->angle, s->helix, turning);
    unit3(radial);
    add3(turning, s->spiral / s->angle, radial, out);
    unit3(out);
}

static void tangent_at(const Segment *s, int at_end, double *out) {
    if (s->kind == LINE) {
        memcpy(out, s->way, 3 * sizeof *out);
    } else {
        circle_tangent(s, at_end ? s->angle : 0.0, out);
    }
}

/* Direction in which a segment accelerates at its end or start, in a blend; the start of an arc counts its curvature. */
static void acceleration_at(const Segment *s, int at_end, double *out) {
    if (s->kind == LINE) {
        memcpy(out, s->way, 3 * sizeof *out);
        return;
    }
    double point[3], radial[3];
    circle_point(s, at_end ? s->angle : 0.0, point);
    add3(point, -1.0, s->origin, radial);
    cross3(s->normal, radial, out);
    unit3(out);
    if (at_end) return;
    unit3(radial);
    const double inwards = 0.25 * s->asked * s->asked / s->radius, along = whole_acceleration(s);
    for (int i = 0; i < 3; i++) out[i] = along * out[i] - inwards * radial[i];
    unit3(out);
}

/* Lengths */

/* Length of an arc: that of the circle or spiral in its plane, with the slopes at both ends right, and its helix. */
static double circle_length(const Segment *s) {
    const double slope = fabs(s->spiral / s->angle), least = fmin(s->radius, s->radius + s->spiral);
    const double first = hypot(least, slope), last = hypot(least + slope * s->angle, slope);
    const double helix = size3(s->helix), plane = 0.5 * (first + last) * s->angle;
    return sqrt(plane * plane + helix * helix);
}

/* Shorten an arc to an angle, at its start or its end; 0: it cannot be. */
static int shorten_circle(Segment *s, double angle, int at_start) {
    if (!(angle > 0.0) || dot3(s->helix, s->helix) > STEEPEST_HELIX * STEEPEST_HELIX) return 0;
    if (at_start) {
        double point[3];
        circle_point(s, s->angle - angle, point);
        add3(point, -1.0, s->origin, s->spoke);
        cross3(s->normal, s->spoke, s->across);
        s->radius = size3(s->spoke);
    }
    s->spiral *= angle / s->angle;
    s->angle = angle;
    s->length = circle_length(s);
    return 1;
}

/* Fix the length of a segment, and with it the speed and the acceleration along an arc. */
static void fix_length(const Machine *m, Segment *s) {
    if (s->fixed != 0.0) return;
    s->fixed = 1.0;
    s->cap = fmin(s->cap, s->length / m->period);
    if (s->kind != CIRCLE) return;
    const double all = whole_acceleration(s), slope = s->spiral / s->angle, inner = slope * slope + s->radius * s->radius;
    const double flat = inner * sqrt(inner) / (inner + slope * slope);
    const double radius = dot3(s->helix, s->helix) / flat + flat, needed = s->cap * s->cap / fmax(radius, 1e-6);
    if (needed > ACROSS_SHARE * all) {
        s->cap = sqrt(ACROSS_SHARE * all * radius);
        s->along = ALONG_SHARE;
    } else {
        s->along = sqrt(1.0 - (needed / all) * (needed / all));
    }
}

/* Joints */

/* Highest speed of a segment by itself, at the highest override. */
static double own_speed(const Machine *m, const Segment *s) { return fmin(s->asked * m->override, s->cap); }

static void no_kink(Segment *s, Segment *next) {
    s->kink_speed = -1.0;
    s->kink_out = 0.0;
    next->kink_in = 0.0;
}

static void end_as(Segment *s, Segment *next, int ending) {
    s->ending = ending;
    next->blends_in = ending == PARABOLIC;
}

double linuxcnc_blend_speeds(const Segment *s, const Segment *next, double most, double most_next, double *speed,
                             double *speed_next) {
    const double a = along_acceleration(s), b = along_acceleration(next);
    const double reach = fmin(sqrt(a * s->length * (s->fixed != 0.0 ? 1.0 : 0.5)), most);
    const double reach_next = fmin(sqrt(b * next->length * (next->fixed != 0.0 ? 1.0 : 0.5)), most_next);
    const double time = fmin(fmin(s->length / reach, next->length / reach_next), fmax(reach / a, reach_next / b));
    double in[3], out[3];
    acceleration_at(s, 1, in);
    acceleration_at(next, 0, out);
    const double theta = half_angle(in, out), cosine = cos(theta);
    *speed = fmin(reach, time * a);
    *speed_next = fmin(reach_next, time * b);
    if (s->tolerance > 0.0 && cosine > sin(SHARPEST_BLEND)) {
        const double kept = 2.0 * sqrt(a * s->tolerance / cosine);
        *speed = fmin(*speed, kept);
        *speed_next = fmin(*speed_next, kept);
    }
    return sin(theta) * (*speed + *speed_next) / 2.0;
}

/* Rule 3: whether the arc at this speed is best, 0 for none; else one of the others becomes the end of s. */
static int arc_is_best(const Machine *m, Segment *s, Segment *next, double arc_speed) {
    if (s->ending == EXACT || s->ending == STOPS) return 0;
    double one, two;
    const double overlap =
        0.5 * linuxcnc_blend_speeds(s, next, highest_speed(m, s), highest_speed(m, next), &one, &two);
    if (overlap >= s->kink_speed && overlap >= arc_speed) {
        no_kink(s, next);
        end_as(s, next, PARABOLIC);
        return 0;
    }
    if (s->kink_speed >= arc_speed) {
        end_as(s, next, TANGENT);
        return 0;
    }
    no_kink(s, next);
    return 1;
}

/* Rule 2: 1 tangent, 0 to be looked at further, -1 a stop. */
static int join_tangents(const Machine *m, Segment *s, Segment *next) {
    if (m->depth < 2.0 || s->ending == STOPS) return -1;
    double in[3], out[3], both[3], change[3];
    tangent_at(s, 1, in);
    tangent_at(next, 0, out);
    add3(in, 1.0, out, both);
    if (dot3(both, both) < TURNS_BACK * TURNS_BACK) {
        end_as(s, next, STOPS);
        return -1;
    }
    const double speed = fmin(own_speed(m, s), own_speed(m, next));
    add3(out, -1.0, in, change);
    double share = 0.0;
    for (int i = 0; i < 3; i++) {
        const double needed = fabs(change[i]) * (speed / m->period + next->acceleration);
        share = fmax(share, needed / m->acceleration[i]);
    }
    if (s->kind == CIRCLE || next->kind == CIRCLE) share /= ALONG_SHARE;
    const int tangent = share < m->kink_ratio;
    if (tangent) end_as(s, next, TANGENT);
    s->kink_speed = tangent ? speed : speed * m->kink_ratio / share;
    s->kink_out = fmax(s->kink_out, fmin(share, m->kink_ratio));
    next->kink_in = fmax(next->kink_in, fmin(share, m->kink_ratio));
    return tangent;
}

/* Arcs in corners */

/* Smallest extent of the box of half widths bounds in the plane across normal. */
static double extent_across(const double *normal, const double *bounds) {
    double least = INFINITY;
    for (int i = 0; i < 3; i++) {
        double shadow[3];
        for (int j = 0; j < 3; j++) shadow[j] = (i == j) - normal[i] * normal[j];
        shadow[i] = fmax(shadow[i], NEAR_POSITION);
        least = fmin(least, bounds[i] / size3(shadow));
    }
    return least;
}

/* Where a spiral counts as a circle: its centre, beside it, and radius. */
static void as_circle(const Segment *s, const double *tangent, const double *corner, double *centre, double *radius) {
    double spoke[3];
    add3(s->origin, s->spiral / s->angle, tangent, centre);
    add3(corner, -1.0, centre, spoke);
    *radius = size3(spoke);
}

/* An arc that comes into a corner or goes out of it, from the angle near to far: of a convex one its secant is the way.
 * Returns how much may be taken of it, mm. */
static double arc_reach(const Segment *s, const Corner *c, int convex, double radius, double most, double middle,
                        double sign, double *way) {
    if (!convex) return most * radius;
    double point[3];
    circle_point(s, middle, point);
    for (int i = 0; i < 3; i++) way[i] = sign * (point[i] - c->corner[i]);
    unit3(way);
    return sin(0.25 * most) * radius;
}

/* The angle and the room of a corner; 0 where there is no corner to round. */
static int measure_corner(const Segment *s, const Segment *next, Corner *c) {
    tangent_at(s, 1, c->tangent_in);
    tangent_at(next, 0, c->tangent_out);
    memcpy(c->in, c->tangent_in, sizeof c->in);
    memcpy(c->out, c->tangent_out, sizeof c->out);
    if (next->kind == LINE) {
        memcpy(c->corner, next->origin, sizeof c->corner);
    } else {
        circle_point(next, 0.0, c->corner);
    }
    const double theta = half_angle(c->in, c->out);
    if (HALF_TURN / 2.0 - theta < NEAR_ANGLE || theta < NEAR_ANGLE) return 0;
    cross3(c->in, c->out, c->binormal);
    unit3(c->binormal);
    add3(c->out, -1.0, c->in, c->normal);
    unit3(c->normal);
    double less_in = 0.0, less_out = 0.0, spoke[3];
    if (s->kind == LINE) {
        c->reach_in = fmin(s->length, 0.5 * s->nominal);
    } else {
        as_circle(s, c->tangent_in, c->corner, c->centre_in, &c->radius_in);
        add3(c->corner, -1.0, c->centre_in, spoke);
        c->convex_in = dot3(spoke, c->tangent_out) < 0.0;
        c->most_in = fmin(s->angle * 2.0 / 3.0, c->convex_in ? theta : HALF_TURN / 2.0);
        const double middle = s->angle - 0.5 * c->most_in;
        c->reach_in = arc_reach(s, c, c->convex_in, c->radius_in, c->most_in, middle, -1.0, c->in);
        less_in = c->convex_in ? 0.25 * c->most_in : 0.0;
    }
    if (next->kind == LINE) {
        c->reach_out = 0.5 * next->length;
    } else {
        as_circle(next, c->tangent_out, c->corner, c->centre_out, &c->radius_out);
        add3(c->corner, -1.0, c->centre_out, spoke);
        c->convex_out = dot3(spoke, c->tangent_in) >= 0.0;
        c->most_out = fmin(next->angle / 3.0, c->convex_out ? theta : HALF_TURN / 2.0);
        c->reach_out = arc_reach(next, c, c->convex_out, c->radius_out, c->most_out, 0.5 * c->most_out, 1.0, c->out);
        less_out = c->convex_out ? 0.25 * c->most_out : 0.0;
    }
    c->theta = theta - fmax(less_in, less_out);
    c->turn = HALF_TURN - 2.0 * c->theta;
    return !(s->kind == CIRCLE && next->kind == CIRCLE && c->theta < LEAST_HALF_ANGLE);
}

/* Highest speed on a rounding by the velocities of the axes and of both segments. */
static double speed_across(const Machine *m, const Segment *s, const Segment *next, const Corner *c) {
    const double plane = extent_across(c->binormal, m->velocity);
    if (s->kind != LINE || next->kind != LINE) return plane;
    const double cosine = cos(fmin(c->turn, 0.49 * HALF_TURN));
    const double one = fmin(s->cap, next->cap / cosine), two = fmin(next->cap, s->cap / cosine);
    double base[3];
    for (int i = 0; i < 3; i++) base[i] = two * c->out[i] - one * c->in[i];
    return fmax(one * two * sin(c->turn) / size3(base), plane);
}

/* Radius, speed and reach of the rounding; 0 where it would be too small. */
static int size_rounding(const Machine *m, const Segment *s, const Segment *next, Corner *c) {
    const double quarter_in = 0.25 * s->nominal, quarter_out = 0.25 * next->nominal;
    c->tolerance = fmin(fmin(s->tolerance > 0.0 ? s->tolerance : quarter_in,
                             next->tolerance > 0.0 ? next->tolerance : quarter_out),
                        fmin(quarter_in, quarter_out));
    c->acceleration = extent_across(c->binormal, m->acceleration);
    c->asked = fmax(fmin(s->asked, s->cap), fmin(next->asked, next->cap));
    const double goal = fmin(fmax(own_speed(m, s), own_speed(m, next)), speed_across(m, s, next, c));
    const double across = ACROSS_SHARE * c->acceleration, theta = c->theta;
    const double by_tolerance = cos(theta) * c->tolerance / (1.0 - sin(theta));
    const double distance = fmin(fmin(c->reach_in, c->reach_out), by_tolerance), widest = tan(theta) * distance;
    c->speed = fmin(sqrt(across * widest), goal);
    /* no wider than the overlap of the two moves at half the acceleration would be */
    const double half = 0.5 * c->acceleration, seconds = fmin(sqrt(2.0 * half * distance), c->speed) / half;
    const double overlap = fmin(seconds * c->speed / c->turn, widest);
    c->radius = fmax(c->speed * c->speed / across, overlap);
    c->distance = c->radius / tan(theta);
    return c->radius >= NEAR_POSITION && c->radius * c->turn >= SHORTEST_ROUNDING;
}

/* Distance from the corner along a line to where the rounding touches it, beside a circle; negative: nowhere. */
static double touches_line(const Corner *c, const double *way, const double *centre, double between, double sign,
                           double *found) {
    double across[3], to_centre[3];
    cross3(c->binormal, way, across);
    unit3(across);
    add3(centre, -1.0, c->corner, to_centre);
    const double u = dot3(to_centre, way), n = dot3(to_centre, across), rest = c->radius - n;
    const double inside = between * between - rest * rest;
    if (inside < 0.0) return -1.0;
    const double distance = fmin(fabs(-u + sqrt(inside)), fabs(-u - sqrt(inside)));
    add3(c->corner, sign * distance, way, found);
    add3(found, c->radius, across, found);
    return distance;
}

/* Centre of the rounding between two circles; 0 where there is none. */
static int touches_circles(const Corner *c, double near, double far, double *found) {
    double between[3], beside[3], one[3], two[3], to_one[3];
    add3(c->centre_out, -1.0, c->centre_in, between);
    const double apart = size3(between);
    if (!unit3(between)) return 0;
    const double along = (near * near - far * far + apart * apart) / (2.0 * apart);
    const double square = near * near - along * along;
    if (square < 0.0) return 0;
    cross3(c->binormal, between, beside);
    if (!unit3(beside)) return 0;
    add3(c->centre_in, along, between, to_one);
    add3(to_one, sqrt(square), beside, one);
    add3(to_one, -sqrt(square), beside, two);
    double from_one[3], from_two[3];
    add3(one, -1.0, c->corner, from_one);
    add3(two, -1.0, c->corner, from_two);
    memcpy(found, size3(from_two) < size3(from_one) ? two : one, 3 * sizeof *found);
    return 1;
}

/* Angle that a rounding takes of a circle. */
static double trimmed_angle(const Corner *c, const double *centre) {
    double to_corner[3], to_centre[3];
    add3(c->corner, -1.0, centre, to_corner);
    add3(c->centre, -1.0, centre, to_centre);
    unit3(to_corner);
    unit3(to_centre);
    return acos(within(dot3(to_corner, to_centre), -1.0, 1.0));
}

/* Where the rounding lies, and what it takes of both sides; 0 where it does not fit. */
static int place_rounding(const Segment *s, const Segment *next, Corner *c) {
    const double near = (c->convex_in ? -c->radius : c->radius) + c->radius_in;
    const double far = (c->convex_out ? -c->radius : c->radius) + c->radius_out;
    c->trim_in = c->trim_out = c->distance;
    if (s->kind == LINE && next->kind == LINE) {
        add3(c->corner, c->radius / sin(c->theta), c->normal, c->centre);
        return 1;
    }
    if (s->kind == LINE) {
        c->trim_in = touches_line(c, c->in, c->centre_out, far, -1.0, c->centre);
        if (c->trim_in < 0.0) return 0;
    } else if (next->kind == LINE) {
        c->trim_out = touches_line(c, c->out, c->centre_in, near, 1.0, c->centre);
        if (c->trim_out < 0.0) return 0;
    } else if (!touches_circles(c, near, far, c->centre)) {
        return 0;
    }
    double to_centre[3];
    add3(c->centre, -1.0, c->corner, to_centre);
    if (size3(to_centre) - c->radius > c->tolerance) return 0;
    if (s->kind == CIRCLE) {
        c->trim_in = trimmed_angle(c, c->centre_in);
        if (c->trim_in > c->most_in) return 0;
    }
    if (next->kind == CIRCLE) {
        c->trim_out = trimmed_angle(c, c->centre_out);
        if (c->trim_out > c->most_out) return 0;
    }
    return 1;
}

/* Shorten both sides in copies, and make the rounding between them; 0 where that cannot be. */
static int make_rounding(const Machine *m, const Corner *c, Segment *s, Segment *next, Segment *arc) {
    double from[3], to[3];
    if (s->kind == LINE) {
        add3(c->corner, -c->trim_in, s->way, from);
        s->length -= c->trim_in;
    } else {
        if (!shorten_circle(s, s->angle - c->trim_in, 0)) return 0;
        circle_point(s, s->angle, from);
    }
    if (next->kind == LINE) {
        add3(c->corner, c->trim_out, next->way, to);
        memcpy(next->origin, to, sizeof to);
        next->length -= c->trim_out;
    } else {
        if (!shorten_circle(next, next->angle - c->trim_out, 1)) return 0;
        circle_point(next, 0.0, to);
    }
    memset(arc, 0, sizeof *arc);
    double last[3];
    memcpy(arc->origin, c->centre, sizeof c->centre);
    add3(from, -1.0, c->centre, arc->spoke);
    add3(to, -1.0, c->centre, last);
    arc->radius = size3(arc->spoke);
    const double end = size3(last);
    if (arc->radius < NEAR_POSITION || end < NEAR_POSITION) return 0;
    arc->angle = acos(dot3(arc->spoke, last) / (arc->radius * end));
    if (!(arc->angle >= NEAR_ANGLE)) return 0;
    for (int i = 0; i < 3; i++) {
        arc->across[i] = (last[i] * arc->radius / end - arc->spoke[i] * cos(arc->angle)) / sin(arc->angle);
    }
    memcpy(arc->way, c->tangent_in, sizeof arc->way);
    memcpy(arc->normal, c->binormal, sizeof arc->normal);
    arc->spiral = end - arc->radius;
    arc->lead = c->lead;
    arc->length = arc->radius * arc->angle + c->lead;
    arc->kind = ROUNDING;
    arc->ending = TANGENT;
    arc->rapid = s->rapid;
    arc->nominal = arc->length;
    arc->move = s->move;
    arc->asked = c->asked;
    arc->acceleration = c->acceleration;
    arc->along = ALONG_SHARE;
    arc->kink_speed = -1.0;
    arc->period = m->period;
    arc->fixed = 1.0;
    arc->cap = fmin(c->speed, arc->length / m->period);
    return 1;
}

/* A circle and the rounding beside it must be tangent, nearly. */
static int is_smooth(const Machine *m, const Corner *c, const Segment *circle, const Segment *arc, int at_end) {
    double one[3], two[3], spoke[3], radial[3];
    circle_tangent(circle, at_end ? 0.0 : circle->angle, one);
    memcpy(spoke, arc->spoke, sizeof spoke);
    if (at_end) {
        for (int i = 0; i < 3; i++) {
            spoke[i] = arc->spoke[i] * cos(arc->angle) + arc->across[i] * sin(arc->angle);
            spoke[i] *= 1.0 + arc->spiral / arc->radius;
        }
    }
    cross3(arc->normal, spoke, two);
    memcpy(radial, spoke, sizeof radial);
    unit3(radial);
    add3(two, arc->spiral / arc->angle, radial, two);
    unit3(two);
    const double allowed = ACROSS_SHARE * KINK_OF_ROUNDING * c->acceleration * m->period / c->speed;
    return acos(within(dot3(one, two), -1.0, 1.0)) <= allowed;
}

/* Rule 3 with the arc: 1 where it is made, and s has the new end; 0 where another way, or none, was taken. */
static int round_corner(const Machine *m, Segment *s, Segment *next, Segment *arc, int *consumes) {
    if (s->ending != PARABOLIC || s->fixed != 0.0 || s->kind == ROUNDING) return 0;
    Corner c;
    memset(&c, 0, sizeof c);
    if (!measure_corner(s, next, &c)) return 0;
    for (int i = 0; i < 2; i++) {
        const Segment *side = i == 0 ? s : next;
        const double along = side->kind == CIRCLE ? fabs(dot3(c.binormal, side->normal)) : 1.0;
        if (2.0 * (1.0 - along) >= NEAR_ANGLE * NEAR_ANGLE) return 0;
    }
    if (!size_rounding(m, s, next, &c) || !place_rounding(s, next, &c)) return 0;
    if (s->kind == LINE) {
        const double left = s->length - c.trim_in;
        c.consumes = left / c.speed < m->gap_periods * m->period && s->blends_in == 0.0;
        c.lead = c.consumes ? left : 0.0;
    }
    Segment before = *s, after = *next;
    if (!make_rounding(m, &c, &before, &after, arc)) return 0;
    if (s->kind == CIRCLE && !is_smooth(m, &c, &before, arc, 0)) return 0;
    if (next->kind == CIRCLE && !is_smooth(m, &c, &after, arc, 1)) return 0;
    if (!arc_is_best(m, s, next, arc->cap)) return 0;
    after.kink_in = 0.0;
    before.kink_out = 0.0;
    before.kink_speed = -1.0;
    *s = before;
    *next = after;
    end_as(s, next, TANGENT);
    *consumes = c.consumes;
    return 1;
}

/* Speeds at the ends */

/* Rule 5, from the end of the queue, after a move was added. */
static void plan_ends(const Machine *m, int64_t count, Segment *queue) {
    int peaks = 0, passed_stop = 0;
    for (int64_t back = 1; (double)back < m->depth + 2.0 && back < count; back++) {
        Segment *s = &queue[count - back], *before = s - 1;
        if (before->ending != TANGENT) {
            if (passed_stop) return;
            passed_stop = 1;
            continue;
        }
        const double a = along_acceleration(s);
        if (s->fixed == 0.0) {
            before->out = fmin(before->cap, fmin(sqrt(a * s->length), highest_speed(m, s)));
            if (before->kink_speed >= 0.0) before->out = fmin(before->out, before->kink_speed);
            s->out = 0.0;
        } else {
            const double most = fmin(s->cap, before->kink_speed >= 0.0 ? fmin(before->cap, before->kink_speed) : before->cap);
            const double reach = sqrt(s->out * s->out + 2.0 * a * s->length);
            if (reach >= most) before->peak = 1.0;
            before->out = fmin(reach, most);
            s->cap = fmin(s->cap, s->length / (m->period * FEWEST_PERIODS));
        }
        peaks += s->peak != 0.0;
        if (peaks > PEAKS) return;
    }
}

/* Moves */

static int make_segment(const Machine *m, const Move *move, Segment *s) {
    memset(s, 0, sizeof *s);
    s->kind = move->kind == 0.0 ? LINE : CIRCLE;
    if (s->kind == LINE) {
        memcpy(s->origin, move->start, sizeof s->origin);
        add3(move->end, -1.0, move->start, s->way);
        s->length = size3(s->way);
        if (s->length < NEAR_POSITION) return 0;
        unit3(s->way);
    } else {
        double last[3], rise;
        add3(move->start, -1.0, move->centre, s->spoke);
        rise = dot3(s->spoke, move->normal);
        add3(move->centre, rise, move->normal, s->origin);
        add3(s->spoke, -rise, move->normal, s->spoke);
        add3(move->end, -1.0, s->origin, last);
        rise = dot3(last, move->normal);
        add3(last, -rise, move->normal, last);
        for (int i = 0; i < 3; i++) s->helix[i] = rise * move->normal[i];
        const double sense = move->turns < 0.0 ? -1.0 : 1.0;
        for (int i = 0; i < 3; i++) s->normal[i] = sense * move->normal[i];
        cross3(s->normal, s->spoke, s->across);
        s->radius = size3(s->spoke);
        s->spiral = size3(last) - s->radius;
        s->angle = fabs(move->turns);
        s->length = circle_length(s);
        if (s->length < NEAR_POSITION) return 0;
    }
    s->nominal = s->length;
    s->ending = move->ending;
    s->rapid = move->rapid;
    s->tolerance = move->tolerance;
    s->asked = move->asked;
    s->acceleration = move->acceleration;
    s->move = move->move;
    s->along = ALONG_SHARE;
    s->kink_speed = -1.0;
    s->period = m->period;
    s->cap = fmin(move->cap, s->length / m->period);
    return 1;
}

int64_t linuxcnc_queue(const double *machine, int64_t n, const double *moves, double *segments) {
    const Machine *m = (const Machine *)machine;
    const Move *move = (const Move *)moves;
    Segment *queue = (Segment *)segments, next, arc;
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        if (!make_segment(m, &move[i], &next)) continue;
        if (count > 0) {
            Segment *last = &queue[count - 1];
            int consumes = 0, rounded = 0;
            if (last->rapid != next.rapid) end_as(last, &next, STOPS);
            if (m->rounds != 0.0 && join_tangents(m, last, &next) == 0) {
                rounded = round_corner(m, last, &next, &arc, &consumes);
                if (!rounded) arc_is_best(m, last, &next, 0.0);
            }
            if (rounded && consumes) {
                *last = arc;
            } else if (rounded) {
                fix_length(m, last);
                queue[count++] = arc;
            } else {
                fix_length(m, last);
            }
        }
        queue[count++] = next;
        plan_ends(m, count, queue);
    }
    return count;
}

/* Merging of short lines, before the queue */

void linuxcnc_merge(int64_t n, const double *end, const double *start, const double *tolerance, const uint8_t *apart,
                    uint8_t *kept) {
    int64_t first = 0; /* of the lines that are one so far */
    const double *base = start;
    for (int64_t i = 0; i < n; i++) {
        const double *to = end + 3 * i;
        int goes_on = i > first && !apart[i] && tolerance[i] > 0.0 && i - first <= MOST_MERGED;
        double whole[3];
        add3(to, -1.0, base, whole);
        const double square = dot3(whole, whole);
        goes_on = goes_on && square > 0.0;
        for (int64_t k = first; goes_on && k < i; k++) {
            double from_base[3], off[3];
            add3(end + 3 * k, -1.0, base, from_base);
            add3(from_base, -within(dot3(whole, from_base) / square, 0.0, 1.0), whole, off);
            goes_on = size3(off) <= tolerance[i];
        }
        if (i > first && !goes_on) {
            kept[i - 1] = 1;
            base = end + 3 * (i - 1);
            first = i;
        }
    }
    if (n > 0) kept[n - 1] = 1;
}

/* A segment of LinuxCNC's motion queue, and what both of its readers ask of it: the queue that is made, and its run. */
#ifndef PLANNER_CONTROLLERS_LINUXCNC_INLINE_H
#define PLANNER_CONTROLLERS_LINUXCNC_INLINE_H

#include <math.h>
#include <stdint.h>

enum { LINE, CIRCLE, ROUNDING };               /* what a segment is; a rounding is an arc that was put into a corner */
enum { STOPS, EXACT, TANGENT, PARABOLIC };     /* how it ends */

#define NEAR_POSITION 1e-12 /* mm */
#define NEAR_SPEED 1e-8     /* mm/s */
#define NEAR_TIME 1e-12     /* s */
#define ALONG_SHARE 0.5     /* of the acceleration, along an arc */

/* Columns of the machine, in the order of the settings in linuxcnc.py. */
typedef struct {
    double velocity[3], acceleration[3];
    double period, path_velocity, override, depth, gap_periods, ramp_frequency, kink_ratio, rounds;
} Machine;

/* A move as the interpreter hands it over; linuxcnc_moves.py makes the rows. */
typedef struct {
    double start[3], end[3], centre[3], normal[3];
    double kind, turns, ending, rapid, tolerance, asked, cap, acceleration, move;
} Move;

/* Doubles only, so that an array of them is the memory.  A line begins at origin and goes along the way; a circle turns
 * about origin from the spoke towards across, and goes along helix in all; a rounding turns about origin likewise, after a
 * lead along the way. */
typedef struct {
    double origin[3], spoke[3], across[3], helix[3], way[3], normal[3];
    double radius, angle, spiral, lead, length, move;
    double kind, ending, rapid, nominal, tolerance, asked, cap, acceleration, along;
    double kink_speed, kink_out, kink_in, out, fixed, peak, blends_in;
    double x, speed, period, exit, splits, done, active, ramps, blends_out, slowing, blend_speed, capped;
} Segment;

static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline double size3(const double *a) { return sqrt(dot3(a, a)); }

static inline void add3(const double *a, double k, const double *b, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[i] + k * b[i];
}

static inline void cross3(const double *a, const double *b, double *out) {
    const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    for (int i = 0; i < 3; i++) out[i] = c[i];
}

static inline int unit3(double *a) {
    const double size = size3(a);
    if (!(size > 0.0)) return 0;
    for (int i = 0; i < 3; i++) a[i] /= size;
    return 1;
}

static inline double within(double x, double least, double most) { return fmin(fmax(x, least), most); }

/* Acceleration of a segment in all directions: less beside a kink, half beside a parabolic blend. */
static inline double whole_acceleration(const Segment *s) {
    const double beside_blend = s->blends_in != 0.0 || s->ending == PARABOLIC ? 0.5 : 1.0;
    return s->acceleration * (1.0 - fmax(s->kink_out, s->kink_in)) * beside_blend;
}

/* Acceleration along it. */
static inline double along_acceleration(const Segment *s) {
    return whole_acceleration(s) * (s->kind == LINE ? 1.0 : s->along);
}

/* Highest speed it may have at an override; no override speeds up what blends. */
static inline double highest_speed(const Machine *m, const Segment *s) {
    const double scale = s->capped != 0.0 ? fmin(m->override, 1.0) : m->override;
    return fmin(fmin(s->asked * scale, s->cap), m->path_velocity);
}

static inline double present_speed(const Machine *m, const Segment *s) { return fmin(s->asked, highest_speed(m, s)); }

/* Point of a circle at an angle from its start. */
static inline void circle_point(const Segment *s, double angle, double *out) {
    const double share = s->angle > 0.0 ? angle / s->angle : 0.0, grown = 1.0 + share * s->spiral / s->radius;
    add3(s->origin, grown * cos(angle), s->spoke, out);
    add3(out, grown * sin(angle), s->across, out);
    add3(out, share, s->helix, out);
}

/* Half the angle that two directions enclose where one is gone in and the other out: pi / 2 straight on. */
static inline double half_angle(const double *in, const double *out) {
    return 0.5 * acos(within(-dot3(in, out), -1.0, 1.0));
}

/* Speeds at which two segments begin to overlap in a parabolic blend; returns that of the corner, for comparison. */
double linuxcnc_blend_speeds(const Segment *s, const Segment *next, double most, double most_next, double *speed,
                             double *speed_next);

#endif

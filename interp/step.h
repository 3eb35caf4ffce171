/* The interpolator of a controller: a plan file in memory, one step a period, feed override and feed hold within limits.

   Freestanding C11: nothing but memcpy and sqrt is called, nothing is allocated, nothing recurs, there is no global state.
   Whoever calls owns the bytes of the file and both structs; a copy of a state is a snapshot that continues identically.
   The layout of the file is in docs/format-plan.md, the proof that limits hold under override in docs/override.md.

       feedplan_plan plan;
       feedplan_state state;
       if (feedplan_open(&plan, bytes, size) || feedplan_start(&plan, &state, 1e-3))
           refuse();
       while (!feedplan_step(&plan, &state, override, hold, position))
           send(position);

   Compile with -ffp-contract=off: the samples then have the bits of those that the check has seen. */
#ifndef FEEDPLAN_STEP_H
#define FEEDPLAN_STEP_H

#include <stddef.h>
#include <stdint.h>

enum { FEEDPLAN_MAX_AXES = 9, FEEDPLAN_VERSION = 1 };

/* What is wrong with a file or an argument; 0 is nothing. */
enum {
    FEEDPLAN_OK,
    FEEDPLAN_NOT_ALIGNED, /* the bytes do not begin at a multiple of 8 */
    FEEDPLAN_NOT_A_PLAN,  /* another kind of file, or a machine of the other byte order */
    FEEDPLAN_OTHER_VERSION,
    FEEDPLAN_SIZE,     /* the file is cut off, or its sizes contradict one another */
    FEEDPLAN_CHECKSUM, /* bytes were changed on the way */
    FEEDPLAN_NUMBER,   /* a number that is not finite, or not in its range */
    FEEDPLAN_ORDER,    /* times or parameters that fall back */
    FEEDPLAN_INDEX,    /* the number of a piece, or of a line, that there is not */
    FEEDPLAN_PERIOD,   /* not positive and finite, or 2^33 samples and more */
    FEEDPLAN_PLACE     /* a time, sample or rate outside the plan */
};

/* A plan that was opened.  Arrays stand in the bytes of the file. */
typedef struct {
    int64_t dim, rows, powers;         /* machine axes; rows and coefficients of a curve piece */
    int64_t pieces, segments, lines;   /* how many of each, without the closing row */
    int64_t governed;                  /* whether override and hold are obeyed: the plan was made with a reserve */
    double duration;                   /* s */
    double u_start, u_end;             /* curve parameter */
    double period;                     /* the plan was made for, s */
    double start_feed;                 /* mm/s; where it is not 0 the plan begins at rate 1 */
    double rate_jerk_high;             /* bound on |r''|, 1/s^2, at rates r above low_until */
    double rate_jerk_low;              /* bound on |r''| up to there */
    double low_until;
    double longest_period;             /* up to which rate_jerk_low may be used, s */
    const char *axes;                  /* dim times 8 bytes of a name and 8 of a unit, each closed by 0 */
    const double *velocity, *acceleration, *jerk; /* (dim): limits, inf where there is none */
    const double *start, *end;                    /* (dim): positions, mm or rad */
    const double *curve;                          /* (pieces + 1, rows, powers): see interp.h */
    const double *law;                            /* (segments + 1, 8) */
    const double *line_starts;                    /* (lines + 1, 2): time, s, and number of a program line */
} feedplan_plan;

/* What is remembered between two periods.  The plan time is sample T + behind: a product, never a sum of periods, and its
   error does not grow.  The plan runs at the rate r = d(plan time)/dt, 1 being the plan as it was made. */
typedef struct {
    double sample;           /* number of the sample of the plan at which the step is, or which it has not quite reached */
    double behind;           /* plan time less sample T, s, within (-T, 0] */
    double rate, rate_slope; /* r, and dr/dt, 1/s */
    double u;                /* curve parameter */
    double last;             /* number of the last sample at rate 1, ceil(duration / T) */
    double high, low;        /* leading 20 bits of the period T, s, and the rest */
    double jerk_high, jerk_low, low_until, fastest; /* bounds of r'' for this period, and of |dr/dt| */
    int64_t segment;
    int64_t begun; /* whether there was a step: before it the rate is the one first commanded */
} feedplan_state;

/* Open the bytes of a plan file: every number and index is checked once, so that no step need.  Returns 0, or what is wrong. */
int feedplan_open(feedplan_plan *plan, const void *bytes, size_t size);

/* Begin at the start of a plan, with a period in s.  Returns 0, or what is wrong. */
int feedplan_start(const feedplan_plan *plan, feedplan_state *state, double period);

/* Go to the next sample: position (dim), mm or rad.  override in [0, 1] is the rate that is asked for, what is outside counts
   as the nearer end and nan as 0; hold asks for 0.  The rate follows as fast as the limits allow.  Where the plan is not
   governed both are ignored.  Returns 1 once the end is reached, which is then held. */
int feedplan_step(const feedplan_plan *plan, feedplan_state *state, double override, int hold, double *position);

/* Write the position at which the state is, without a step. */
void feedplan_position(const feedplan_plan *plan, const feedplan_state *state, double *position);

/* Go to a plan time, s, or to a sample number of the plan.  rate is what the plan runs at there: 0 where the machine stands at
   that point, 1 where it comes along the plan; between them only if the plan is governed.  Returns 0, or what is wrong. */
int feedplan_seek(const feedplan_plan *plan, feedplan_state *state, double time, double rate);
int feedplan_seek_sample(const feedplan_plan *plan, feedplan_state *state, int64_t sample, double rate);

/* Plan time, s; share of the duration that is done, 0 to 1; whether the end is reached. */
double feedplan_time(const feedplan_plan *plan, const feedplan_state *state);
double feedplan_progress(const feedplan_plan *plan, const feedplan_state *state);
int feedplan_done(const feedplan_plan *plan, const feedplan_state *state);

/* Number of the program line that is being run; 0 where the plan is of no program. */
int64_t feedplan_line(const feedplan_plan *plan, const feedplan_state *state);

/* Name of an axis ("X") and its unit ("mm" or "rad"); "" for an axis that there is not. */
const char *feedplan_axis_name(const feedplan_plan *plan, int64_t axis);
const char *feedplan_axis_unit(const feedplan_plan *plan, int64_t axis);

/* A sentence for what feedplan_open, feedplan_start or feedplan_seek returns. */
const char *feedplan_error_text(int error);

#endif

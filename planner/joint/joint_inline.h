/* What the files of the joint solver share: the problem, its iterate, and the motion within a segment. */
#ifndef FEEDPLAN_JOINT_INLINE_H
#define FEEDPLAN_JOINT_INLINE_H

#include "planner/core.h"

#include <string.h>

#define INLINE static inline __attribute__((always_inline))

/* POINTS of a segment at which rows stand: its start, 1/3 and 2/3. */
enum { MOST_AXES = 9, POINTS = 3, MOST_STATES = 3 * MOST_AXES + 1, MOST_CONTROLS = MOST_AXES + 1 };
enum { MOST_ALL = MOST_STATES + MOST_CONTROLS, MOST_ROWS = 9 + 10 * MOST_AXES };
enum { POSITION, VELOCITY, ACCELERATION, JERK };

typedef struct {
    int64_t d, n;
    const uint8_t *begins;
    const double *share;
    const int64_t *leg;
    const double *vectors, *rates, *lengths;
    const double *near, *pace;
    const double *velocity, *acceleration, *jerk;
    double bend, shortest;
    const double *target;
} Problem;

/* Of every stage, the nodes with the segments after them. */
typedef struct {
    double *x, *u;         /* the iterate: states (n + 1) and controls (n) */
    double *dx, *du;       /* the step */
    double *prices;        /* (n + 1, states): multipliers of the dynamics, from the step before */
    double *defect;        /* (n, states): where the segment ends, less the next state */
    double *cost, *slope;  /* (n + 1): of the cost to go, Hessian and gradient */
    double *gain, *push;   /* (n): du = gain dx + push */
    double *value;         /* rows: g <= 0, */
    double *slack, *dual;  /* g + slack = 0, slack dual = mu */
    double *dslack;
    double *off, *curve;   /* (n, POINTS): half the gradient (d) and half the Hessian (d, d) of the squared distance */
    int64_t *rows;         /* (n): how many */
    double *price;         /* (3d): multipliers of the last state */
} Iterate;

INLINE int states_of(int d) { return 3 * d + 1; }
INLINE int most_rows_of(int d) { return 9 + 10 * d; }

/* Where the duration that a segment has stands: among the states, or among the controls where it begins a phase. */
INLINE int duration_at(int d, int begins) { return begins ? 4 * d + 1 : 3 * d; }
INLINE double duration_of(int d, int begins, const double *x, const double *u) { return begins ? u[d] : x[3 * d]; }

/* Where a segment ends. */
INLINE void joint_arrive(int d, int begins, double share, const double *restrict x, const double *restrict u,
                         double *restrict end) {
    const double duration = duration_of(d, begins, x, u), h = share * duration;
    for (int k = 0; k < d; k++) {
        const double v = x[d + k], a = x[2 * d + k], j = u[k];
        end[k] = x[k] + h * (v + h * (0.5 * a + h * (j / 6.0)));
        end[d + k] = v + h * (a + 0.5 * h * j);
        end[2 * d + k] = a + h * j;
    }
    end[3 * d] = duration;
}

/* Position and derivatives (4, d) at the time h after the start of a segment. */
INLINE void joint_at(int d, double h, const double *restrict x, const double *restrict u, double *restrict y) {
    for (int k = 0; k < d; k++) {
        const double v = x[d + k], a = x[2 * d + k], j = u[k];
        y[k] = x[k] + h * (v + h * (0.5 * a + h * (j / 6.0)));
        y[d + k] = v + h * (a + 0.5 * h * j);
        y[2 * d + k] = a + h * j;
        y[3 * d + k] = j;
    }
}

/* ---- joint_tube.c --------------------------------------------------------------------------------------------------- */

/* The squared distance of p from a leg; half its gradient (d) and half of a Hessian (d, d) that is positive semidefinite. */
double joint_distance(const Problem *problem, int64_t leg, const double *p, double *off, double *curve);

/* Half gradient and half Hessian of the squared distance of p from where a leg begins. */
double joint_vertex(const Problem *problem, int64_t leg, const double *p, double *off, double *curve);

/* ---- joint_rows.c --------------------------------------------------------------------------------------------------- */

/* The values of the rows of a stage, and what their derivatives need; returns how many there are. */
int64_t joint_values(const Problem *problem, int64_t i, const Iterate *it);

/* How much the rows of a stage change with the step, to first order. */
void joint_changes(const Problem *problem, int64_t i, const Iterate *it, double *changes);

/* Add the rows of a stage to the Hessian (all, all; the upper triangle) and the gradient (all) over state and controls, all =
 * 4d + 2; exact: share of the second derivatives by the duration that is taken. */
void joint_condense(const Problem *problem, int64_t i, const Iterate *it, double mu, double exact, double *hessian,
                    double *gradient);

/* ---- joint_sweep.c -------------------------------------------------------------------------------------------------- */

/* One Riccati sweep back; 0 where it is not positive definite.  weight: of the distance of the last state from the target. */
int joint_back(const Problem *problem, const Iterate *it, double mu, double weight, double exact);

/* The step, from the first state on. */
void joint_forth(const Problem *problem, const Iterate *it);

#endif

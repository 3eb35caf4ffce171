/* What the files of the joint solver share: the problem, its iterate, and the motion within a segment. */
#ifndef FEEDPLAN_JOINT_INLINE_H
#define FEEDPLAN_JOINT_INLINE_H

#include "planner/core.h"

#include <string.h>

#define INLINE static inline __attribute__((always_inline))

/* A segment is looked at in PARTS equal parts, by the control points of its Bezier curves: a curve is where they are, if that is
   convex.  Those between two parts lie between their neighbours.  PLACES: node and inner points of the position, the same of the
   velocity, the acceleration at the node, and the jerk. */
enum { PARTS = 2, POINTS = 1 + 2 * PARTS, PLACES = POINTS + 1 + PARTS + 2 };
enum { MOST_AXES = 9, MOST_STATES = 3 * MOST_AXES + 1, MOST_ALL = MOST_STATES + MOST_AXES };
enum { MOST_ROWS = (2 * PARTS + 6) * MOST_AXES + 3 * PARTS + 3 + 3 * POINTS };
enum { POSITION, VELOCITY, ACCELERATION, JERK };

typedef struct {
    int64_t d, n;
    const uint8_t *switches;
    const double *share, *scale;
    const int64_t *leg;
    const double *vectors, *rates, *lengths;
    const double *near, *pace, *walls;
    const double *velocity, *acceleration, *jerk;
    double least;
    const double *target;
} Problem;

/* Of every stage: */
typedef struct {
    double *x, *u;        /* the iterate: states (n + 1) and controls (n) */
    double *dx, *du;      /* the step */
    double *prices;       /* (n + 1, states): multipliers of the dynamics, from the step before; behind switches only */
    double *defect;       /* (n, states): where the stage ends, less the next state */
    double *hessian;      /* (n, all, all): of the rows, over state and control; the upper triangle over the state, the */
    double *gradient;     /* (n, all)       lower one over the control, and its rows over the state */
    double *cost, *slope; /* (n + 1): of the cost to go, Hessian and gradient; behind switches only */
    double *gain, *push;  /* (n): du = gain dx + push */
    double *root;         /* (n): of g = c / scale^3, where that is a segment's */
    double *value;        /* rows: g <= 0, */
    double *slack, *dual; /* g + slack = 0, slack dual = mu */
    double *dslack;
    double *off, *curve; /* (n, POINTS): half the gradient (d) and half the Hessian (d, d) of the squared distance */
    int64_t *rows;       /* (n): how many */
    double *price;       /* (3d): multipliers of the last state */
} Iterate;

/* What a Newton system is made for: products of slacks and multipliers, weight of the distance of the last state from the
   target, and of the relative changes of the durations. */
typedef struct {
    double mu, weight, hold;
} Aim;

INLINE int states_of(int d) { return 3 * d + 1; }
INLINE int all_of(int d) { return 4 * d + 1; }
INLINE int most_rows_of(int d) { return (2 * PARTS + 6) * d + 3 * PARTS + 3 + 3 * POINTS; }

/* Position and derivatives (4, d) in units of the phase, at the share w of it after the start of a segment; linear in x and u. */
INLINE void joint_at(int d, double w, const double *restrict x, const double *restrict u, double *restrict y) {
    for (int k = 0; k < d; k++) {
        const double v = x[d + k], a = x[2 * d + k], j = u[k];
        y[k] = x[k] + w * (v + w * (0.5 * a + w * (j / 6.0)));
        y[d + k] = v + w * (a + 0.5 * w * j);
        y[2 * d + k] = a + w * j;
        y[3 * d + k] = j;
    }
}

/* Where a stage ends. */
INLINE void joint_arrive(int d, int switches, double share, const double *restrict x, const double *restrict u,
                         double *restrict end) {
    if (switches) {
        const double r = cbrt(u[0] / x[3 * d]);
        for (int k = 0; k < d; k++) {
            end[k] = x[k];
            end[d + k] = r * x[d + k];
            end[2 * d + k] = r * r * x[2 * d + k];
        }
        end[3 * d] = u[0];
        return;
    }
    double y[4 * MOST_AXES];
    joint_at(d, share, x, u, y);
    memcpy(end, y, sizeof(double) * (size_t)(3 * d));
    end[3 * d] = x[3 * d];
}

/* ---- joint_tube.c --------------------------------------------------------------------------------------------------- */

/* The squared distance of p from a leg; half its gradient (d) and half of a Hessian (d, d) that is positive semidefinite. */
double joint_distance(const Problem *problem, int64_t leg, const double *p, double *off, double *curve);

/* The same from where a leg begins. */
double joint_vertex(const Problem *problem, int64_t leg, const double *p, double *off, double *curve);

/* ---- joint_rows.c --------------------------------------------------------------------------------------------------- */

/* The values of the rows of a stage, and what their derivatives need; returns how many there are. */
int64_t joint_values(const Problem *problem, int64_t i, const Iterate *it);

/* How much the rows of a stage change with the step, to first order. */
void joint_changes(const Problem *problem, int64_t i, const Iterate *it, double *changes);

/* The Hessian and the gradient of the rows of a stage. */
void joint_condense(const Problem *problem, int64_t i, const Iterate *it, double mu);

/* ---- joint_sweep.c -------------------------------------------------------------------------------------------------- */

/* One Riccati sweep back, from the rows as they are condensed; 0 where it is not positive definite. */
int joint_back(const Problem *problem, const Iterate *it, const Aim *aim);

/* The step, from the first state on. */
void joint_forth(const Problem *problem, const Iterate *it);

#endif

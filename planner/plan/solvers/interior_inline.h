/* What the files of the interior-point method share: the problem, its state, and what they know of a block of points. */
#ifndef FEEDPLAN_INTERIOR_INLINE_H
#define FEEDPLAN_INTERIOR_INLINE_H

#include "planner/core.h"

#include <stddef.h>

/* Before a loop no turn of which reads what another one writes: all arrays are apart. */
#if defined(__clang__)
#define APART _Pragma("clang loop vectorize(assume_safety)")
#pragma clang diagnostic ignored "-Wpass-failed" /* where it finds no gain in it, the loop stays one */
#elif defined(__GNUC__)
#define APART _Pragma("GCC ivdep")
#else
#define APART
#endif

/* HOT, and once more for AVX-512: its instructions on four numbers have twice as many registers, which the passes use. */
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && __GNUC__ >= 12 && !defined(__clang__) && \
    !defined(FEEDPLAN_ONE_TARGET)
#define HOTTEST __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#else
#define HOTTEST HOT
#endif

#define INLINE static inline __attribute__((always_inline))

/* Points a block: its scratch stays in the first-level cache.  A multiple of the points of an interval, 2 or 4. */
enum { BLOCK = 128, MOST_INTERVALS = BLOCK / 2 };

/* The constraints as rows.py builds them; points run along the last axis of every array. */
typedef struct {
    int64_t intervals, inner, points, blocks, sides;
    int64_t accelerations, rows;
    const double *h, *weight, *cap;
    const double *acceleration;   /* (accelerations, 2, points) */
    const double *jerk;           /* (rows - accelerations, 3, points) */
    const double *steady, *jerky; /* (points): by what accelerations and jerks are tightened, or NULL */
    const double *bounds;         /* (rows, 2): sizes of the upper and of the lower one */
    int64_t fixed;                /* how many of x, a, c are prescribed at the first knot */
    int64_t priced;               /* equations at the last: 0, 1 (x is prescribed) or 3 (its state is that of the first) */
} Problem;

/* x, a, c at the knots, or their changes. */
typedef struct {
    double *x, *a, *c;
} Knots;

typedef struct {
    Knots z, affine, step; /* the iterate; the affine step; the whole step */
    float *pairs;          /* (blocks, sides, 2, BLOCK): slack and multiplier of every side */
    double *gains;         /* (intervals, 4): of the next c on x, a and c, and the inverse of the pivot */
    double *forward;       /* (intervals,): the part of the next c that does not depend on the state */
    double *pulls;         /* (8, intervals + 1): gradients of the intervals, per unit of target and of corrector */
    Knots response[3];     /* of the Newton system to a unit price on each equation at the last knot */
    double *root;          /* (9,): Hessian and gradient of the affine step's cost to go at the first knot */
} State;

/* x, a, c and the pace x^(-1/2) at the points of a block, or their changes. */
typedef struct {
    double x[BLOCK], a[BLOCK], c[BLOCK], pace[BLOCK];
} Motion;

/* Sums at the points of a block: Hessian (xx, xa, xc, aa, ac, cc) and gradient over (x, a, c). */
typedef struct {
    double hessian[6][BLOCK], gradient[3][BLOCK];
} Condensed;

/* The same for whole intervals, over the state at the start and the next c, v: xx, xa, xc, xv, aa, ac, av, cc, cv, vv. */
typedef struct {
    double hessian[10][MOST_INTERVALS], gradient[4][MOST_INTERVALS];
} Gathered;

/* Gradients over (x, a, c) at the points of a block, per unit of the target and of the corrector. */
typedef struct {
    double target[3][BLOCK], corrector[3][BLOCK];
} Pulls;

/* The largest shares of the limits that a start uses: of speed and acceleration, and of the jerk; and its time. */
typedef struct {
    double steady, jerk, time;
} Used;

/* Of the affine step: least and largest relative change of a slack, sum(l ds), sum(ds dl), and the time it hopes to gain. */
typedef struct {
    double least, most, first, second, hope;
} Affine;

/* Largest relative decreases of a slack, of a multiplier and of x. */
typedef struct {
    double slack, dual, x;
} Decrease;

/* How a step is taken: what it aims at, and its lengths. */
typedef struct {
    double target, corrector, primal, dual;
} Stride;

/* sum(s l), the time, and the largest relative violation. */
typedef struct {
    double gap, time, residual;
} Totals;

/* Hessian and gradient of the cost to go. */
typedef struct {
    double h[6], g[3];
} CostToGo;

static inline int64_t first_interval(const Problem *problem, int64_t block) {
    return block * (BLOCK / (problem->inner + 1));
}

static inline int64_t points_in(const Problem *problem, int64_t block) {
    const int64_t left = problem->points - block * BLOCK;
    return left < BLOCK ? left : BLOCK;
}

static inline int64_t intervals_in(const Problem *problem, int64_t block) {
    return points_in(problem, block) / (problem->inner + 1);
}

/* ---- interior_start.c: states of motions, and the start, at the points of a block ---------------------------------- */

/* The pace of a motion. */
void interior_pace(Motion *z, int64_t count);

/* The end of a whole step, by the linear model: its pace changes by its slope. */
void interior_ahead(const Motion *z, const Motion *step, int64_t count, Motion *ahead);

/* The end of a step of this length. */
void interior_arrive(const Motion *z, const Motion *step, int64_t count, double length, Motion *arrived);

/* Add to the shares of the limits that a start uses, and to its time. */
void interior_used(const Problem *problem, int64_t block, const Motion *z, float *pairs, Used *used);

/* Slacks of at least ``least``, and multipliers: those given, or the product over the slack. */
void interior_place(const Problem *problem, int64_t block, const Motion *z, double least, double product,
                    const float *duals, float *pairs, Totals *totals);

/* ---- interior_points.c: what an iteration does at the points of a block -------------------------------------------- */

/* Measure the affine step that ends ``ahead``; the corrector's gradients. */
void interior_affine(const Problem *problem, int64_t block, const Motion *z, const Motion *ahead, const float *pairs,
                     Pulls *pulls, Affine *affine);

/* Measure the step that ends ``ahead``; the affine one ended ``hoped``. */
void interior_decrease(const Problem *problem, int64_t block, const Motion *z, const Motion *hoped,
                       const Motion *ahead, const float *pairs, const Stride *stride, Decrease *worst);

/* Take the step: slacks and multipliers; with ``sums`` also what interior_condense gives there. */
void interior_advance(const Problem *problem, int64_t block, const Motion *hoped, const Motion *ahead,
                      const Motion *arrived, const Stride *stride, float *pairs, Totals *totals, Condensed *sums);

/* Eliminate slacks and multipliers: Hessian and gradient of the affine step; ``clip`` drops negative curvature. */
void interior_condense(const Problem *problem, int64_t block, const Motion *z, int clip, float *pairs, Condensed *sums);

/* ---- interior_knots.c: between points and knots, and the Newton system over the knots ------------------------------- */

/* Points of a block from the knots, by the cubics of its intervals. */
void interior_between(const Problem *problem, int64_t block, const Knots *knots, Motion *out);

/* Sums at the points as sums over the state at the start of each interval and the next c. */
void interior_gather(const Problem *problem, int64_t block, const Condensed *sums, Gathered *out);
void interior_gather_pulls(const Problem *problem, int64_t block, const Pulls *pulls, double *out);

/* Backward Riccati recursion through a block; 0 where a pivot is not positive. */
int interior_factor(const Problem *problem, int64_t block, const Gathered *sums, State *state, CostToGo *cost);

/* The backward sweep for the gradient  target * pulls[0..3] - corrector * pulls[4..7]; the gradient at the first knot. */
void interior_back(const Problem *problem, State *state, double target, double corrector, double at_first[3]);

/* The backward sweep for a gradient at the last knot alone. */
void interior_back_from(const Problem *problem, State *state, const double last[3], double at_first[3]);

/* The forward sweep: the step that follows from the gradient of the cost to go at the first knot. */
void interior_forth(const Problem *problem, const State *state, const double at_first[3], Knots step);

#endif

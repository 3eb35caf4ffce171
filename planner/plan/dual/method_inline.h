/* What the files of the primal-dual method share: its structure and the layout of its arrays (see dual.h). */
#ifndef PLANNER_PLAN_DUAL_METHOD_INLINE_H
#define PLANNER_PLAN_DUAL_METHOD_INLINE_H

#include "planner/core.h"

#define RULE 4 /* points of a cell, whose numbers stand side by side: the loops over them become one instruction each */
#define EACH for (int i = 0; i < RULE; i++)

/* Rows of a block of points. */
enum { Y, X, T, V, MU, MOTIONS };        /* state and step; then three for each limit */
enum { MYY, MYX, MXX, DY0, DX0, STIFF }; /* reduced; then 1/k and d of each l, 1/k_u of each m */

typedef struct {
    int64_t cells, jerks, accelerations, width, local;
    const int64_t *place;
    const double *weight, *cap, *quadratic, *linear, *rows, *atom_rows, *atom_caps;
} Problem;

static inline Problem problem_of(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place,
                                 const double *weight, const double *cap, const double *quadratic,
                                 const double *linear, const double *rows, const double *atom_rows,
                                 const double *atom_caps)
{
    const int64_t width = jerks + accelerations;
    const Problem problem = {cells, jerks, accelerations, width, 2 * width + jerks, place, weight,
                             cap, quadratic, linear, rows, atom_rows, atom_caps};
    return problem;
}

/* Numbers of a block of points in an array of so many rows. */
static inline int64_t state_size(const Problem *p) { return (MOTIONS + 3 * p->width) * RULE; }
static inline int64_t reduced_size(const Problem *p) { return (STIFF + 2 * p->jerks + p->accelerations) * RULE; }

static inline double total_of(const double *sums) { return (sums[0] + sums[1]) + (sums[2] + sums[3]); }

#endif

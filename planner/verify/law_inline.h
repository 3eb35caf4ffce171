/* A time law between its nodes, for compiled code: rows of the table that law_table makes. */
#ifndef PLANNER_VERIFY_LAW_INLINE_H
#define PLANNER_VERIFY_LAW_INLINE_H

#include "planner/geometry/curve_inline.h"

/* A row of the table: a quintic between two nodes. */
typedef struct {
    double start, h;
    double ends[2][3]; /* u, u' and u'' at both ends, as tabulated */
    double c[6];       /* of the powers of x in [0, 1] */
    double slack[3];   /* what the rounding of the nodes can change in the first three time derivatives of u */
} Quintic;

static inline const Quintic *quintic_of(const double *table, int64_t i) { return (const Quintic *)table + i; }

static inline double quintic_value(const Quintic *law, double w)
{
    const double *c = law->c;
    const double u = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))));
    return w == 1.0 ? law->ends[1][0] : u;
}

/* The share that has passed of the interval that holds a time; the last one has no end. */
static inline double locate(const double *table, int64_t intervals, const double *start, double t, int64_t *interval)
{
    const int64_t last = intervals - 1;
    const int64_t i = *interval = t >= start[last] ? last : find_piece(last, start, t, 0, *interval);
    return smaller(larger((t - start[i]) / quintic_of(table, i)->h, 0.0), 1.0);
}

#endif

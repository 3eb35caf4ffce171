/* The mean jerk of an interval, for the pass over its points. */
#ifndef PLANNER_VERIFY_MEANJERK_INLINE_H
#define PLANNER_VERIFY_MEANJERK_INLINE_H

#include "planner/core.h"

static const double DIGITS = 16.0 * 2.220446049250313e-16; /* that derivatives, sums of a few products, may be off by */
static const double DIGIT = 2.220446049250313e-16;

/* One end of an interval: derivatives of an axis, 0..3, each so many numbers after the one before; and u, u' and u''. */
typedef struct {
    const double *q;
    int64_t apart;
    double u, u1, u2;
} Node;

static inline double node_acceleration(const Node *node, double gap, double *off)
{
    const double *q = node->q, squared = square(node->u1);
    const double first = q[node->apart], second = q[2 * node->apart], third = q[3 * node->apart];
    *off += DIGITS * (fabs(second) * squared + fabs(first * node->u2) + fabs(q[0]) * squared / square(gap));
    *off += DIGIT * fabs(node->u) * (fabs(third) * squared + fabs(second * node->u2));
    return second * squared + first * node->u2;
}

/* Size of the mean jerk from one node to the next, h after start, and what rounding can make of it. */
static inline double mean_jerk(const Node *begin, const Node *end, double gap, double start, double h, double *slack)
{
    double off = 0.0;
    const double before = node_acceleration(begin, gap, &off), after = node_acceleration(end, gap, &off);
    const double mean = fabs(after - before) / h;
    *slack = off / h + mean * (DIGIT * (start + h) / h);
    return mean;
}

#endif

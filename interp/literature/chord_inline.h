/* Length of the chord between two points of the tool tip. */
#ifndef FEEDPLAN_CHORD_INLINE_H
#define FEEDPLAN_CHORD_INLINE_H

#include "interp/taylor_inline.h"

/* The points are given by their pieces and parameters. */
static inline double chord_length(const double *near, double u, const double *far, double p, Shape shape)
{
    const Tip tip = tip_of(shape);
    const int64_t powers = shape.powers;
    const double w = local(near, u), x = local(far, p);
    double near_scale = 1.0, far_scale = 1.0;
    if (tip.rational) {
        near_scale = 1.0 / horner(near + tip.last * powers, powers, w);
        far_scale = 1.0 / horner(far + tip.last * powers, powers, x);
    }
    double squared = 0.0;
    for (int64_t j = tip.first; j < tip.last; j++) {
        const double apart =
            far_scale * horner(far + j * powers, powers, x) - near_scale * horner(near + j * powers, powers, w);
        squared += apart * apart;
    }
    return sqrt(squared);
}

#endif

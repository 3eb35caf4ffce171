/* Passes of the interior-point method over the points of a block; interior.py has the equations.

   A side of a row is  +-(r . z) <= bound, the bound a constant (acceleration) or a constant times the pace x^(-1/2) (jerk).
   Side 0 of a point is its speed, x / cap <= 1; then follow the upper and the lower side of every row.  The loops run over
   points and carry sums in arrays: so they become vector code without changing the order of any sum. */
#include "interior_rows_inline.h"

/* ---- the affine step ------------------------------------------------------------------------------------------------ */

/* Sums over the sides at every point of a block, for the affine step. */
typedef struct {
    double least[BLOCK], most[BLOCK], first[BLOCK], second[BLOCK];
} Changes;

INLINE void affine_row(int kind, int64_t count, const Row *row, const double *slope, const Motion *ahead, Pulls *pulls,
                       Changes *sum) {
    APART
    for (int64_t i = 0; i < count; i++) {
        const double value = value_of(kind, row, i, ahead), pace = pace_of(kind, i, ahead);
        const double s1 = row->s1[i], s2 = row->s2[i], l1 = row->l1[i], l2 = row->l2[i];
        const Inverses per_slack = inverses(s1, s2);
        const double v1 = per_slack.a, v2 = per_slack.b;
        const double ds1 = row->up * pace - value - s1, ds2 = row->down * pace + value - s2;
        const double change1 = ds1 * v1, change2 = ds2 * v2;
        const double first1 = ds1 * l1, first2 = ds2 * l2;
        /* dl = -l (1 + ds / s) */
        const double product1 = -first1 * (1.0 + change1), product2 = -first2 * (1.0 + change2);
        const double e1 = product1 * v1, e2 = product2 * v2;
        sum->least[i] = smaller(sum->least[i], smaller(change1, change2));
        sum->most[i] = larger(sum->most[i], larger(change1, change2));
        sum->first[i] += first1 + first2;
        sum->second[i] += product1 + product2;
        const double x1 = kind == JERK ? row->x[i] - row->up * slope[i] : row->x[i];
        const double x2 = kind == JERK ? row->x[i] + row->down * slope[i] : row->x[i];
        pulls->target[0][i] += v1 * x1 - v2 * x2;
        pulls->target[1][i] += (v1 - v2) * row->a[i];
        pulls->corrector[0][i] += e1 * x1 - e2 * x2;
        pulls->corrector[1][i] += (e1 - e2) * row->a[i];
        if (kind == JERK) {
            pulls->target[2][i] += (v1 - v2) * row->c[i];
            pulls->corrector[2][i] += (e1 - e2) * row->c[i];
        }
    }
}

HOTTEST void interior_affine(const Problem *problem, int64_t block, const Motion *z, const Motion *ahead, const float *pairs,
                         Pulls *pulls, Affine *affine) {
    const int64_t count = points_in(problem, block);
    const float *slack = pairs + 2 * BLOCK * block * problem->sides, *dual = slack + BLOCK;
    double slope[BLOCK];
    Changes sum;
    APART
    for (int64_t i = 0; i < count; i++) {
        const double s = slack[i], r = 1.0 / problem->cap[block * BLOCK + i], v = 1.0 / s;
        const double ds = 1.0 - r * ahead->x[i] - s, change = ds * v, first = ds * (double)dual[i];
        const double product = -first * (1.0 + change);
        slope[i] = pace_slope(z->pace[i]);
        sum.least[i] = sum.most[i] = change;
        sum.first[i] = first;
        sum.second[i] = product;
        pulls->target[0][i] = v * r;
        pulls->corrector[0][i] = product * v * r;
        pulls->target[1][i] = pulls->target[2][i] = pulls->corrector[1][i] = pulls->corrector[2][i] = 0.0;
    }
    Tightened tightened;
    for (int64_t r = 0; r < problem->rows; r++) {
        const Row row = row_of(problem, block, r, (float *)pairs, &tightened);
        if (r < problem->accelerations) affine_row(ACCELERATION, count, &row, slope, ahead, pulls, &sum);
        else affine_row(JERK, count, &row, slope, ahead, pulls, &sum);
    }
    APART
    for (int64_t i = 0; i < count; i++) {
        affine->least = smaller(affine->least, sum.least[i]);
        affine->most = larger(affine->most, sum.most[i]);
        affine->first += sum.first[i];
        affine->second += sum.second[i];
        affine->hope -= problem->weight[block * BLOCK + i] * (ahead->pace[i] - z->pace[i]);
    }
}

/* ---- the whole step ------------------------------------------------------------------------------------------------- */

/* Change of a slack, and what is left of complementarity, of one side.  ``hoped``, ``ahead``: the slack after the affine
   and after the whole step by the linear model. */
typedef struct {
    double ds, rest;
} Side;

INLINE Side side_of(double s, double l, double v, double hoped, double ahead, const Stride *stride) {
    const double affine = hoped - s, product = -affine * l * (1.0 + affine * v);
    return (Side){ahead - s, stride->target - stride->corrector * product};
}

INLINE void decrease_row(int kind, int64_t count, const Row *row, const Motion *hoped, const Motion *ahead,
                         const Stride *stride, double *worst_s, double *worst_l) {
    APART
    for (int64_t i = 0; i < count; i++) {
        const double value0 = value_of(kind, row, i, hoped), pace0 = pace_of(kind, i, hoped);
        const double value = value_of(kind, row, i, ahead), pace = pace_of(kind, i, ahead);
        const double s1 = row->s1[i], s2 = row->s2[i], l1 = row->l1[i], l2 = row->l2[i];
        const Inverses per_pair = inverses(s1 * l1, s2 * l2);
        const double both1 = per_pair.a, both2 = per_pair.b, v1 = l1 * both1, v2 = l2 * both2;
        const Side side1 = side_of(s1, l1, v1, row->up * pace0 - value0, row->up * pace - value, stride);
        const Side side2 = side_of(s2, l2, v2, row->down * pace0 + value0, row->down * pace + value, stride);
        const double fall1 = -side1.ds * v1, fall2 = -side2.ds * v2;
        worst_s[i] = larger(worst_s[i], larger(fall1, fall2));
        worst_l[i] = larger(worst_l[i], larger(1.0 - fall1 - side1.rest * both1, 1.0 - fall2 - side2.rest * both2));
    }
}

HOTTEST void interior_decrease(const Problem *problem, int64_t block, const Motion *z, const Motion *hoped,
                           const Motion *ahead, const float *pairs, const Stride *stride, Decrease *worst) {
    const int64_t count = points_in(problem, block);
    const float *slack = pairs + 2 * BLOCK * block * problem->sides, *dual = slack + BLOCK;
    double worst_s[BLOCK], worst_l[BLOCK], worst_x[BLOCK];
    APART
    for (int64_t i = 0; i < count; i++) {
        const double s = slack[i], l = dual[i], r = 1.0 / problem->cap[block * BLOCK + i], both = 1.0 / (s * l), v = l * both;
        const Side side = side_of(s, l, v, 1.0 - r * hoped->x[i], 1.0 - r * ahead->x[i], stride);
        worst_s[i] = -side.ds * v;
        worst_l[i] = 1.0 + side.ds * v - side.rest * both;
        worst_x[i] = 1.0 - ahead->x[i] / z->x[i];
    }
    Tightened tightened;
    for (int64_t r = 0; r < problem->rows; r++) {
        const Row row = row_of(problem, block, r, (float *)pairs, &tightened);
        if (r < problem->accelerations) decrease_row(ACCELERATION, count, &row, hoped, ahead, stride, worst_s, worst_l);
        else decrease_row(JERK, count, &row, hoped, ahead, stride, worst_s, worst_l);
    }
    APART
    for (int64_t i = 0; i < count; i++) {
        worst->slack = larger(worst->slack, worst_s[i]);
        worst->dual = larger(worst->dual, worst_l[i]);
        worst->x = larger(worst->x, worst_x[i]);
    }
}

/* ---- the step, and the next Newton system --------------------------------------------------------------------------- */

/* Sums over the sides at every point of a block, where a step has been taken, or will be. */
typedef struct {
    double gap[BLOCK], worst[BLOCK], worst_jerk[BLOCK], load[BLOCK], slope[BLOCK];
} Here;

/* One side after a step: ``v``: the inverse of its slack; ``ahead``: its slack after the whole step by the linear model;
   ``room``: its true one now. */
INLINE void take_side(double *slack, double *dual, double v, double hoped, double ahead, double room,
                      const Stride *stride) {
    const double s = *slack, l = *dual;
    const Side side = side_of(s, l, v, hoped, ahead, stride);
    *dual = l + stride->dual * ((side.rest - l * side.ds) * v - l);
    *slack = larger(s + stride->primal * side.ds, room);
}

INLINE void newton_row(int kind, int advance, int condense, int64_t count, const Row *row, const Motion *hoped,
                       const Motion *ahead, const Motion *z, const Stride *stride, Here *here, Condensed *sums) {
    APART
    for (int64_t i = 0; i < count; i++) {
        const double value = value_of(kind, row, i, z), pace = pace_of(kind, i, z);
        const double room1 = row->up * pace - value, room2 = row->down * pace + value;
        double s1 = row->s1[i], l1 = row->l1[i], s2 = row->s2[i], l2 = row->l2[i];
        if (advance) {
            const double value0 = value_of(kind, row, i, hoped), pace0 = pace_of(kind, i, hoped);
            const double value1 = value_of(kind, row, i, ahead), pace1 = pace_of(kind, i, ahead);
            const Inverses per_slack = inverses(s1, s2);
            take_side(&s1, &l1, per_slack.a, row->up * pace0 - value0, row->up * pace1 - value1, room1, stride);
            take_side(&s2, &l2, per_slack.b, row->down * pace0 + value0, row->down * pace1 + value1, room2, stride);
            s1 = keep_slack(row->s1 + i, s1);
            l1 = keep_dual(row->l1 + i, l1);
            s2 = keep_slack(row->s2 + i, s2);
            l2 = keep_dual(row->l2 + i, l2);
            here->gap[i] += s1 * l1 + s2 * l2;
            double *worst = kind == JERK ? here->worst_jerk : here->worst;
            worst[i] = larger(worst[i], larger((s1 - room1) * row->per_up, (s2 - room2) * row->per_down));
        }
        if (condense) {
            const Inverses per_slack = inverses(s1, s2);
            const double w1 = l1 * per_slack.a, w2 = l2 * per_slack.b;
            /* 0 where the slack is the true one */
            const double e1 = w1 * (s1 - room1), e2 = w2 * (s2 - room2);
            const double x1 = kind == JERK ? row->x[i] - row->up * here->slope[i] : row->x[i];
            const double x2 = kind == JERK ? row->x[i] + row->down * here->slope[i] : row->x[i];
            const double wx1 = w1 * x1, wx2 = w2 * x2, wx = wx1 + wx2, w = w1 + w2, e = e1 - e2;
            sums->hessian[0][i] += wx1 * x1 + wx2 * x2;
            sums->hessian[1][i] += wx * row->a[i];
            sums->hessian[3][i] += w * row->a[i] * row->a[i];
            sums->gradient[0][i] += e1 * x1 - e2 * x2;
            sums->gradient[1][i] += e * row->a[i];
            if (kind == JERK) {
                sums->hessian[2][i] += wx * row->c[i];
                sums->hessian[4][i] += w * row->a[i] * row->c[i];
                sums->hessian[5][i] += w * row->c[i] * row->c[i];
                sums->gradient[2][i] += e * row->c[i];
                here->load[i] += row->up * l1 + row->down * l2;
            }
        }
    }
}

/* Both of the functions below, with the parts that are asked for. */
INLINE void newton_block(int advance, int condense, int clip, const Problem *problem, int64_t block, const Motion *hoped,
                         const Motion *ahead, const Motion *z, const Stride *stride, float *pairs, Totals *totals,
                         Condensed *sums) {
    const int64_t count = points_in(problem, block), at = block * BLOCK;
    float *slack = pairs + 2 * BLOCK * block * problem->sides, *dual = slack + BLOCK;
    Here here;
    APART
    for (int64_t i = 0; i < count; i++) {
        const double r = 1.0 / problem->cap[at + i], room = 1.0 - r * z->x[i];
        double s = slack[i], l = dual[i];
        if (advance) {
            take_side(&s, &l, 1.0 / s, 1.0 - r * hoped->x[i], 1.0 - r * ahead->x[i], room, stride);
            s = keep_slack(slack + i, s);
            l = keep_dual(dual + i, l);
            here.gap[i] = s * l;
            here.worst[i] = s - room;
            here.worst_jerk[i] = 0.0;
        }
        if (condense) {
            const double w = l / s;
            here.slope[i] = pace_slope(z->pace[i]);
            here.load[i] = 0.0;
            sums->hessian[0][i] = w * r * r;
            sums->gradient[0][i] = w * (s - room) * r;
            for (int k = 1; k < 6; k++) sums->hessian[k][i] = 0.0;
            sums->gradient[1][i] = sums->gradient[2][i] = 0.0;
        }
    }
    Tightened tightened;
    for (int64_t r = 0; r < problem->rows; r++) {
        const Row row = row_of(problem, block, r, pairs, &tightened);
        if (r < problem->accelerations)
            newton_row(ACCELERATION, advance, condense, count, &row, hoped, ahead, z, stride, &here, sums);
        else
            newton_row(JERK, advance, condense, count, &row, hoped, ahead, z, stride, &here, sums);
    }
    if (condense)
        APART
        for (int64_t i = 0; i < count; i++) {
            const double weight = problem->weight[at + i], curvature = weight - here.load[i];
            sums->gradient[0][i] += weight * here.slope[i];
            sums->hessian[0][i] -= 1.5 * (clip ? larger(curvature, 0.0) : curvature) * here.slope[i] * (z->pace[i] * z->pace[i]);
        }
    if (advance)
        APART
        for (int64_t i = 0; i < count; i++) {
            totals->gap += here.gap[i];
            totals->time += problem->weight[at + i] * z->pace[i];
            totals->residual = larger(totals->residual, larger(0.5 * here.worst[i], here.worst_jerk[i] / (1.0 + z->pace[i])));
        }
}

HOTTEST void interior_advance(const Problem *problem, int64_t block, const Motion *hoped, const Motion *ahead,
                          const Motion *arrived, const Stride *stride, float *pairs, Totals *totals, Condensed *sums) {
    if (sums) newton_block(1, 1, 0, problem, block, hoped, ahead, arrived, stride, pairs, totals, sums);
    else newton_block(1, 0, 0, problem, block, hoped, ahead, arrived, stride, pairs, totals, sums);
}

HOTTEST void interior_condense(const Problem *problem, int64_t block, const Motion *z, int clip, float *pairs,
                           Condensed *sums) {
    newton_block(0, 1, clip, problem, block, z, z, z, NULL, pairs, NULL, sums);
}

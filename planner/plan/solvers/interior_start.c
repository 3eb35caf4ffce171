/* Passes of the interior-point method over the points of a block: states of motions, and the start. */
#include "interior_rows_inline.h"

HOTTEST void interior_pace(Motion *z, int64_t count) {
    APART
    for (int64_t i = 0; i < count; i++) z->pace[i] = 1.0 / sqrt(z->x[i]);
}

HOTTEST void interior_ahead(const Motion *z, const Motion *step, int64_t count, Motion *ahead) {
    APART
    for (int64_t i = 0; i < count; i++) {
        ahead->x[i] = z->x[i] + step->x[i];
        ahead->a[i] = z->a[i] + step->a[i];
        ahead->c[i] = z->c[i] + step->c[i];
        ahead->pace[i] = z->pace[i] + pace_slope(z->pace[i]) * step->x[i];
    }
}

HOTTEST void interior_arrive(const Motion *z, const Motion *step, int64_t count, double length, Motion *arrived) {
    APART
    for (int64_t i = 0; i < count; i++) {
        arrived->x[i] = z->x[i] + length * step->x[i];
        arrived->a[i] = z->a[i] + length * step->a[i];
        arrived->c[i] = z->c[i] + length * step->c[i];
        arrived->pace[i] = 1.0 / sqrt(arrived->x[i]);
    }
}

/* ---- the start ---------------------------------------------------------------------------------------------------- */

INLINE void use_row(int kind, int64_t count, const Row *row, const Motion *z, double *used) {
    const double per_up = 1.0 / row->up, per_down = 1.0 / row->down;
    APART
    for (int64_t i = 0; i < count; i++) {
        const double value = value_of(kind, row, i, z) * (kind == JERK ? z->x[i] * z->pace[i] : 1.0);
        used[i] = larger(used[i], larger(value * per_up, -value * per_down));
    }
}

HOTTEST void interior_used(const Problem *problem, int64_t block, const Motion *z, float *pairs, Used *used) {
    const int64_t count = points_in(problem, block);
    double steady[BLOCK], jerk[BLOCK];
    APART
    for (int64_t i = 0; i < count; i++) {
        steady[i] = z->x[i] / problem->cap[block * BLOCK + i];
        jerk[i] = 0.0;
    }
    Tightened tightened;
    for (int64_t r = 0; r < problem->rows; r++) {
        const Row row = row_of(problem, block, r, pairs, &tightened);
        if (r < problem->accelerations) use_row(ACCELERATION, count, &row, z, steady);
        else use_row(JERK, count, &row, z, jerk);
    }
    for (int64_t i = 0; i < count; i++) {
        used->steady = larger(used->steady, steady[i]);
        used->jerk = larger(used->jerk, jerk[i]);
        used->time += problem->weight[block * BLOCK + i] * z->pace[i];
    }
}

INLINE void place_row(int kind, int64_t count, const Row *row, const Motion *z, double least, double product,
                      double *gap, double *worst) {
    APART
    for (int64_t i = 0; i < count; i++) {
        const double value = value_of(kind, row, i, z), pace = pace_of(kind, i, z);
        const double room1 = row->up * pace - value, room2 = row->down * pace + value;
        const double s1 = keep_slack(row->s1 + i, larger(room1, least)), s2 = keep_slack(row->s2 + i, larger(room2, least));
        const Inverses per_slack = inverses(s1, s2);
        const double l1 = keep_dual(row->l1 + i, product * per_slack.a), l2 = keep_dual(row->l2 + i, product * per_slack.b);
        gap[i] += s1 * l1 + s2 * l2;
        worst[i] = larger(worst[i], larger((s1 - room1) * row->per_up, (s2 - room2) * row->per_down));
    }
}

/* Put multipliers that are given in place of those of a start. */
INLINE void place_duals(int64_t count, int64_t sides, const float *duals, float *pairs, double *gap) {
    for (int64_t side = 0; side < sides; side++) {
        const float *given = duals + BLOCK * side;
        float *s = pairs + 2 * BLOCK * side, *l = s + BLOCK;
        APART
        for (int64_t i = 0; i < count; i++) {
            l[i] = given[i];
            gap[i] += (double)s[i] * (double)l[i];
        }
    }
}

HOTTEST void interior_place(const Problem *problem, int64_t block, const Motion *z, double least, double product,
                        const float *duals, float *pairs, Totals *totals) {
    const int64_t count = points_in(problem, block), sides = problem->sides;
    float *slack = pairs + 2 * BLOCK * block * sides, *dual = slack + BLOCK;
    double worst[BLOCK], worst_jerk[BLOCK], gap[BLOCK];
    APART
    for (int64_t i = 0; i < count; i++) {
        const double room = 1.0 - z->x[i] / problem->cap[block * BLOCK + i];
        const double s = keep_slack(slack + i, larger(room, least)), l = keep_dual(dual + i, product / s);
        worst[i] = s - room;
        worst_jerk[i] = 0.0;
        gap[i] = s * l;
    }
    Tightened tightened;
    for (int64_t r = 0; r < problem->rows; r++) {
        const Row row = row_of(problem, block, r, pairs, &tightened);
        if (r < problem->accelerations) place_row(ACCELERATION, count, &row, z, least, product, gap, worst);
        else place_row(JERK, count, &row, z, least, product, gap, worst_jerk);
    }
    if (duals) {
        for (int64_t i = 0; i < count; i++) gap[i] = 0.0;
        place_duals(count, sides, duals + BLOCK * block * sides, slack, gap);
    }
    for (int64_t i = 0; i < count; i++) {
        totals->residual = larger(totals->residual, larger(0.5 * worst[i], worst_jerk[i] / (1.0 + z->pace[i])));
        totals->time += problem->weight[block * BLOCK + i] * z->pace[i];
        totals->gap += gap[i];
    }
}

#include "planner/plan/dual/dual.h"

#include <string.h>

#include "planner/plan/dual/method_inline.h"

/* Part of one cell: its points add to out (local); pushes (jerks, 4) is scratch. */
static inline void right_side_of_points(const Problem *p, int64_t block, const double *restrict state,
                                        const double *restrict step, double target, double corrector,
                                        double *restrict reduced, double *restrict out, double *restrict pushes)
{
    const int64_t jerks = p->jerks, width = p->width, local = p->local;
    const double *weight = p->weight + block * RULE, *cap = p->cap + block * RULE;
    const double *rows = p->rows + block * RULE * local;
    const double *quadratic = p->quadratic + block * 3 * RULE, *linear = p->linear + block * 2 * RULE;
    const double *y = state + Y * RULE, *x = state + X * RULE, *t = state + T * RULE, *v = state + V * RULE;
    const double *dy = step + Y * RULE, *dx = step + X * RULE, *dt = step + T * RULE, *dv = step + V * RULE;
    const double *dmu = step + MU * RULE;
    double ry[RULE], moved[RULE];
    double *dy0 = reduced + DY0 * RULE, *dx0 = reduced + DX0 * RULE;
    EACH {
        const double root = 1.0 / sqrt(x[i]), rho = 0.5 * root / x[i];
        const double pace = (target - corrector * dt[i] * dv[i]) / t[i] - v[i] / t[i] * (y[i] - root - t[i]);
        ry[i] = 1.0 - pace;
        dx0[i] = (target + corrector * dx[i] * dmu[i]) / (cap[i] - x[i]) - rho * pace;
    }
    for (int64_t j = 0; j < jerks; j++) {
        const double *e = state + (MOTIONS + 3 * j) * RULE, *de = step + (MOTIONS + 3 * j) * RULE;
        const double *lean = reduced + (STIFF + 2 * j + 1) * RULE;
        EACH {
            const double low = (target - corrector * (dy[i] - de[i]) * de[RULE + i]) / (y[i] - e[i]);
            const double high = (target - corrector * (dy[i] + de[i]) * de[2 * RULE + i]) / (y[i] + e[i]);
            pushes[j * RULE + i] = low - high;
            ry[i] += lean[i] * (low - high) - (low + high);
        }
    }
    const double *myy = reduced + MYY * RULE, *myx = reduced + MYX * RULE, *mxx = reduced + MXX * RULE;
    EACH {
        const double rx = dx0[i];
        dy0[i] = -(myy[i] * ry[i] + myx[i] * rx);
        dx0[i] = -(myx[i] * ry[i] + mxx[i] * rx);
    }
    for (int64_t j = 0; j < jerks; j++) {
        const double *e = state + (MOTIONS + 3 * j) * RULE;
        const double *inverse = reduced + (STIFF + 2 * j) * RULE, *lean = inverse + RULE;
        EACH moved[i] = weight[i] * (e[i] - pushes[j * RULE + i] * inverse[i] + lean[i] * dy0[i]);
        for (int64_t a = 0; a < 3; a++) {
            double part[RULE];
            EACH part[i] = quadratic[a * RULE + i] * moved[i];
            out[a * width + j] += total_of(part);
        }
    }
    for (int64_t m = 0; m < p->accelerations; m++) {
        const double *u = state + (MOTIONS + 3 * (jerks + m)) * RULE, *du = step + (MOTIONS + 3 * (jerks + m)) * RULE;
        const double *inverse = reduced + (STIFF + 2 * jerks + m) * RULE;
        EACH {
            const double low = (target + corrector * du[i] * du[RULE + i]) / (1.0 - u[i]);
            const double high = (target - corrector * du[i] * du[2 * RULE + i]) / (1.0 + u[i]);
            moved[i] = weight[i] * (u[i] - (low - high) * inverse[i]);
        }
        for (int64_t a = 0; a < 2; a++) {
            double part[RULE];
            EACH part[i] = linear[a * RULE + i] * moved[i];
            out[a * width + jerks + m] += total_of(part);
        }
    }
    EACH moved[i] = weight[i] * (x[i] + dx0[i]);
    for (int64_t q = 0; q < local; q++)
        out[q] += (rows[q] * moved[0] + rows[local + q] * moved[1]) +
                  (rows[2 * local + q] * moved[2] + rows[3 * local + q] * moved[3]);
}

HOT void method_right_side(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place,
                           const double *weight, const double *cap, const double *quadratic, const double *linear,
                           const double *rows, const double *atom_rows, const double *atom_caps, const double *state,
                           const double *atom_state, const double *step, const double *atom_step,
                           const double *control, int64_t unknowns, double *reduced, double *out, double *scratch)
{
    const Problem p = problem_of(cells, jerks, accelerations, place, weight, cap, quadratic, linear, rows, atom_rows,
                                 atom_caps);
    const double target = control[0], corrector = control[1];
    const int64_t local = p.local;
    memset(out, 0, (size_t)unknowns * sizeof *out);
    for (int64_t k = 0; k < cells; k++) {
        double *here = out + k * p.width;
        if (place[k] < 0) {
            const double *atom = atom_state + 3 * k, *last = atom_step + 3 * k;
            const double x = atom[0], room = atom_caps[k] - x;
            const double push = (target + corrector * last[0] * last[2]) / room -
                                (target - corrector * last[0] * last[1]) / x;
            const double moved = x - push / (atom[1] / x + atom[2] / room);
            for (int64_t q = 0; q < local; q++)
                here[q] += atom_rows[k * local + q] * moved;
        } else {
            const int64_t at = place[k] * state_size(&p);
            right_side_of_points(&p, place[k], state + at, step + at, target, corrector,
                                 reduced + place[k] * reduced_size(&p), here, scratch);
        }
    }
}

/* What the driver needs to know of the steps: each a number for every point of a cell. */
typedef struct {
    double slack[RULE], multiplier[RULE], x[RULE];         /* largest relative falls */
    double s_dl[RULE], ds_l[RULE], ds_dl[RULE], hope[RULE]; /* sums */
} Outlook;

/* Products of a cell's steps, before they are weighted. */
typedef struct {
    double s_dl[RULE], ds_l[RULE], ds_dl[RULE];
} Products;

/* Replace the steps of limited values z, |z| <= bound, and of their multipliers: rows z, low, high of the state and of
 * the steps.  dz = drift - (force + right sides over the slacks) / stiffness. */
static inline void replace_limited(double target, double corrector, const double *bound, const double *dbound_before,
                                   const double *dbound, const double *drift, const double *force,
                                   const double *inverse, const double *restrict z, double *restrict step,
                                   Outlook *restrict found, Products *restrict products)
{
    EACH {
        const double low = z[RULE + i], high = z[2 * RULE + i], s1 = bound[i] - z[i], s2 = bound[i] + z[i];
        const double t1 = target - corrector * (dbound_before[i] - step[i]) * step[RULE + i];
        const double t2 = target - corrector * (dbound_before[i] + step[i]) * step[2 * RULE + i];
        const double dz = drift[i] - (force[i] + t1 / s1 - t2 / s2) * inverse[i];
        const double ds1 = dbound[i] - dz, ds2 = dbound[i] + dz;
        const double dlow = (t1 - low * ds1) / s1 - low, dhigh = (t2 - high * ds2) / s2 - high;
        step[i] = dz;
        step[RULE + i] = dlow;
        step[2 * RULE + i] = dhigh;
        found->slack[i] = larger(larger(found->slack[i], -ds1 / s1), -ds2 / s2);
        found->multiplier[i] = larger(larger(found->multiplier[i], -dlow / low), -dhigh / high);
        products->s_dl[i] += s1 * dlow + s2 * dhigh;
        products->ds_l[i] += ds1 * low + ds2 * high;
        products->ds_dl[i] += ds1 * dlow + ds2 * dhigh;
    }
}

/* Replace the steps of y, x, t and their multipliers; keeps the old step of y. */
static inline void replace_pace(const Problem *p, int64_t block, const double *restrict state,
                                const double *restrict reduced, const double *load, const double *pull, double target,
                                double corrector, double *restrict step, double *restrict before,
                                Outlook *restrict found, Products *restrict products)
{
    const double *weight = p->weight + block * RULE, *cap = p->cap + block * RULE;
    EACH {
        const double y = state[Y * RULE + i], x = state[X * RULE + i], t = state[T * RULE + i];
        const double v = state[V * RULE + i], mu = state[MU * RULE + i], room = cap[i] - x;
        const double myx = reduced[MYX * RULE + i];
        const double dy = reduced[DY0 * RULE + i] - reduced[MYY * RULE + i] * load[i] - myx * pull[i];
        const double dx = reduced[DX0 * RULE + i] - myx * load[i] - reduced[MXX * RULE + i] * pull[i];
        const double root = 1.0 / sqrt(x), rho = 0.5 * root / x;
        const double t1 = target - corrector * step[T * RULE + i] * step[V * RULE + i];
        const double t2 = target + corrector * step[X * RULE + i] * step[MU * RULE + i];
        const double dt = y - root - t + dy + rho * dx;
        const double dv = (t1 - v * dt) / t - v, dmu = (t2 + mu * dx) / room - mu;
        before[i] = step[Y * RULE + i];
        step[Y * RULE + i] = dy;
        step[X * RULE + i] = dx;
        step[T * RULE + i] = dt;
        step[V * RULE + i] = dv;
        step[MU * RULE + i] = dmu;
        found->x[i] = larger(found->x[i], -dx / x);
        found->slack[i] = larger(larger(found->slack[i], -dt / t), dx / room);
        found->multiplier[i] = larger(larger(found->multiplier[i], -dv / v), -dmu / mu);
        found->hope[i] += weight[i] * dy;
        products->s_dl[i] = t * dv + room * dmu;
        products->ds_l[i] = dt * v - dx * mu;
        products->ds_dl[i] = dt * dv - dx * dmu;
    }
}

/* Value of a B-spline at the points of a cell: count control values, width apart, and the basis (count, 4). */
static inline void spline_at(int64_t count, int64_t width, const double *basis, const double *control, double *value)
{
    EACH value[i] = basis[i] * control[0];
    for (int64_t a = 1; a < count; a++)
        EACH value[i] += basis[a * RULE + i] * control[a * width];
}

/* Replace the steps of the points of a cell, given its theta. */
static inline void replace_steps(const Problem *p, int64_t block, const double *restrict state,
                                 const double *restrict reduced, const double *restrict theta, double target,
                                 double corrector, double *restrict step, Outlook *restrict found)
{
    static const double one[RULE] = {1.0, 1.0, 1.0, 1.0}, none[RULE] = {0.0, 0.0, 0.0, 0.0};
    const int64_t jerks = p->jerks, width = p->width, local = p->local;
    const double *weight = p->weight + block * RULE, *rows = p->rows + block * RULE * local;
    const double *quadratic = p->quadratic + block * 3 * RULE, *linear = p->linear + block * 2 * RULE;
    double pull[RULE] = {0.0}, load[RULE] = {0.0}, force[RULE], drift[RULE], before[RULE];
    Products products;
    for (int64_t q = 0; q < local; q++)
        EACH pull[i] += rows[i * local + q] * theta[q];
    for (int64_t j = 0; j < jerks; j++) {
        const double *lean = reduced + (STIFF + 2 * j + 1) * RULE;
        spline_at(3, width, quadratic, theta + j, force);
        EACH load[i] += lean[i] * force[i];
    }
    replace_pace(p, block, state, reduced, load, pull, target, corrector, step, before, found, &products);
    for (int64_t j = 0; j < jerks; j++) {
        const double *inverse = reduced + (STIFF + 2 * j) * RULE, *lean = inverse + RULE;
        spline_at(3, width, quadratic, theta + j, force);
        EACH drift[i] = lean[i] * step[Y * RULE + i];
        replace_limited(target, corrector, state + Y * RULE, before, step + Y * RULE, drift, force, inverse,
                        state + (MOTIONS + 3 * j) * RULE, step + (MOTIONS + 3 * j) * RULE, found, &products);
    }
    for (int64_t c = jerks; c < width; c++) {
        spline_at(2, width, linear, theta + c, force);
        replace_limited(target, corrector, one, none, none, none, force, reduced + (STIFF + jerks + c) * RULE,
                        state + (MOTIONS + 3 * c) * RULE, step + (MOTIONS + 3 * c) * RULE, found, &products);
    }
    EACH {
        found->s_dl[i] += weight[i] * products.s_dl[i];
        found->ds_l[i] += weight[i] * products.ds_l[i];
        found->ds_dl[i] += weight[i] * products.ds_dl[i];
    }
}

/* Replace the step of an atom, given G at the new theta. */
static inline void replace_atom(const double *restrict atom, double cap, double pull, double target, double corrector,
                                double *restrict step, Outlook *restrict found)
{
    const double x = atom[0], low = atom[1], high = atom[2], room = cap - x;
    const double t1 = target - corrector * step[0] * step[1], t2 = target + corrector * step[0] * step[2];
    const double dx = -(pull + t2 / room - t1 / x) / (low / x + high / room);
    const double dlow = (t1 - low * dx) / x - low, dhigh = (t2 + high * dx) / room - high;
    step[0] = dx;
    step[1] = dlow;
    step[2] = dhigh;
    found->slack[0] = larger(larger(found->slack[0], -dx / x), dx / room);
    found->multiplier[0] = larger(larger(found->multiplier[0], -dlow / low), -dhigh / high);
    found->s_dl[0] += x * dlow + room * dhigh;
    found->ds_l[0] += dx * low - dx * high;
    found->ds_dl[0] += dx * dlow - dx * dhigh;
}

static double largest_of(const double *values)
{
    return larger(larger(values[0], values[1]), larger(values[2], values[3]));
}

HOT void method_steps(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place, const double *weight,
                      const double *cap, const double *quadratic, const double *linear, const double *rows,
                      const double *atom_rows, const double *atom_caps, const double *state, const double *atom_state,
                      const double *theta, const double *control, const double *reduced, double *step,
                      double *atom_step, double *out)
{
    const Problem p = problem_of(cells, jerks, accelerations, place, weight, cap, quadratic, linear, rows, atom_rows,
                                 atom_caps);
    const double target = control[0], corrector = control[1];
    Outlook found = {{0.0}, {0.0}, {0.0}, {0.0}, {0.0}, {0.0}, {0.0}};
    for (int64_t k = 0; k < cells; k++) {
        const double *here = theta + k * p.width;
        if (place[k] < 0) {
            double pull = 0.0;
            for (int64_t q = 0; q < p.local; q++)
                pull += atom_rows[k * p.local + q] * here[q];
            replace_atom(atom_state + 3 * k, atom_caps[k], pull, target, corrector, atom_step + 3 * k, &found);
        } else {
            const int64_t at = place[k] * state_size(&p);
            replace_steps(&p, place[k], state + at, reduced + place[k] * reduced_size(&p), here, target, corrector,
                          step + at, &found);
        }
    }
    out[0] = largest_of(found.slack);
    out[1] = largest_of(found.multiplier);
    out[2] = largest_of(found.x);
    out[3] = total_of(found.s_dl);
    out[4] = total_of(found.ds_l);
    out[5] = total_of(found.ds_dl);
    out[6] = total_of(found.hope);
}

/* Take the step at the points of a cell; adds to their gap and time. */
static inline void move_points(const Problem *p, int64_t block, double primal, double dual,
                               const double *restrict step, double *restrict state, double *restrict gap,
                               double *restrict time)
{
    const double *weight = p->weight + block * RULE, *cap = p->cap + block * RULE;
    double total[RULE];
    EACH {
        const double y = state[Y * RULE + i] + primal * step[Y * RULE + i];
        const double x = state[X * RULE + i] + primal * step[X * RULE + i];
        /* a slack becomes the larger of its linear prediction and its true value */
        const double t = larger(state[T * RULE + i] + primal * step[T * RULE + i], y - 1.0 / sqrt(x));
        const double v = state[V * RULE + i] + dual * step[V * RULE + i];
        const double mu = state[MU * RULE + i] + dual * step[MU * RULE + i];
        state[Y * RULE + i] = y;
        state[X * RULE + i] = x;
        state[T * RULE + i] = t;
        state[V * RULE + i] = v;
        state[MU * RULE + i] = mu;
        total[i] = t * v + (cap[i] - x) * mu;
        time[i] += weight[i] * y;
    }
    for (int64_t c = 0; c < p->width; c++) {
        double *z = state + (MOTIONS + 3 * c) * RULE;
        const double *dz = step + (MOTIONS + 3 * c) * RULE;
        const int is_jerk = c < p->jerks;
        EACH {
            const double bound = is_jerk ? state[Y * RULE + i] : 1.0;
            z[i] += primal * dz[i];
            z[RULE + i] += dual * dz[RULE + i];
            z[2 * RULE + i] += dual * dz[2 * RULE + i];
            total[i] += (bound - z[i]) * z[RULE + i] + (bound + z[i]) * z[2 * RULE + i];
        }
    }
    EACH gap[i] += weight[i] * total[i];
}

HOT void method_take_step(int64_t cells, int64_t jerks, int64_t accelerations, const int64_t *place,
                          const double *weight, const double *cap, const double *quadratic, const double *linear,
                          const double *rows, const double *atom_rows, const double *atom_caps, const double *control,
                          const double *step, const double *atom_step, double *state, double *atom_state, double *out)
{
    const Problem p = problem_of(cells, jerks, accelerations, place, weight, cap, quadratic, linear, rows, atom_rows,
                                 atom_caps);
    const double primal = control[2], dual = control[3];
    double gap[RULE] = {0.0}, time[RULE] = {0.0};
    for (int64_t k = 0; k < cells; k++) {
        if (place[k] < 0) {
            double *atom = atom_state + 3 * k;
            const double *change = atom_step + 3 * k;
            atom[0] += primal * change[0];
            atom[1] += dual * change[1];
            atom[2] += dual * change[2];
            gap[0] += atom[0] * atom[1] + (atom_caps[k] - atom[0]) * atom[2];
        } else {
            const int64_t at = place[k] * state_size(&p);
            move_points(&p, place[k], primal, dual, step + at, state + at, gap, time);
        }
    }
    out[0] = total_of(gap);
    out[1] = total_of(time);
}

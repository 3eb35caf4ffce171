/* The Newton system of the joint problem, solved by a Riccati sweep: back over the stages the least cost to go

       V_i(dx) = dx^T P_i dx / 2 + p_i^T dx,    V_n = weight |x_n + dx - target|^2 / 2 + price^T (x_n + dx - target),

   forth the step itself.  Within a phase the dynamics are those of three integrators an axis, with constant coefficients, whose
   products with P need no matrix.  A switch from c to n multiplies V by r = (n / c)^(1/3) and A by r^2; it alone is not linear. */
#include "joint_inline.h"

static const double LEAST_PIVOT = 1e-13; /* of the diagonal */

static const double FIRMNESS = 0.3;       /* least curvature over a duration, of that by which it is held */

/* A stage: Hessian (its upper triangle, and all of the controls) and gradient over state and controls. */
typedef struct {
    double hessian[MOST_ALL * MOST_ALL], gradient[MOST_ALL];
} Stage;

/* Rows (rows, states) times the Jacobian of a segment, into out (rows, all). */
INLINE void times_segment(int d, int rows, double w, const double *restrict from, double *restrict out) {
    const int nx = states_of(d), all = all_of(d);
    const double half = 0.5 * w * w, sixth = w * w * w / 6.0;
    for (int r = 0; r < rows; r++) {
        const double *const p = from + r * nx, *const v = p + d, *const a = v + d;
        double *const to = out + r * all;
        for (int k = 0; k < d; k++) {
            to[k] = p[k];
            to[d + k] = w * p[k] + v[k];
            to[2 * d + k] = half * p[k] + w * v[k] + a[k];
            to[nx + k] = sixth * p[k] + half * v[k] + w * a[k];
        }
        to[3 * d] = p[3 * d];
    }
}

/* A switch: r, and how V and A after it change with c before, n after. */
typedef struct {
    double r, before[2 * MOST_AXES], after[2 * MOST_AXES];
} Switch;

INLINE Switch switch_of(int d, const double *x, const double *u) {
    Switch it = {.r = cbrt(u[0] / x[3 * d])};
    for (int k = 0; k < 2 * d; k++) {
        const double moved = x[d + k] * (k < d ? it.r : 2.0 * it.r * it.r) / 3.0;
        it.before[k] = -moved / x[3 * d];
        it.after[k] = moved / u[0];
    }
    return it;
}

/* Rows (rows, states) times the Jacobian of a switch, into out (rows, all). */
INLINE void times_switch(int d, int rows, const Switch *by, const double *restrict from, double *restrict out) {
    const int nx = states_of(d), all = all_of(d);
    for (int r = 0; r < rows; r++) {
        const double *const p = from + r * nx;
        double *const to = out + r * all;
        double before = 0.0, after = p[3 * d];
        for (int k = 0; k < d; k++) {
            to[k] = p[k];
            to[d + k] = by->r * p[d + k];
            to[2 * d + k] = by->r * by->r * p[2 * d + k];
        }
        for (int k = 0; k < 2 * d; k++) {
            before += by->before[k] * p[d + k];
            after += by->after[k] * p[d + k];
        }
        to[3 * d] = before;
        to[nx] = after;
    }
}

/* Second derivatives of a switch, times the prices of the state that it leads to. */
INLINE void add_bend(int d, const double *x, const double *u, double r, const double *prices, double *restrict hessian) {
    const int all = all_of(d), c = 3 * d, n = 3 * d + 1;
    double v = 0.0, a = 0.0;
    for (int k = 0; k < d; k++) {
        const double pv = prices[d + k] * r, pa = prices[2 * d + k] * r * r;
        hessian[(d + k) * all + c] -= pv / (3.0 * x[c]);
        hessian[(d + k) * all + n] += pv / (3.0 * u[0]);
        hessian[(2 * d + k) * all + c] -= 2.0 * pa / (3.0 * x[c]);
        hessian[(2 * d + k) * all + n] += 2.0 * pa / (3.0 * u[0]);
        v += pv * x[d + k];
        a += pa * x[2 * d + k];
    }
    hessian[c * all + c] += (4.0 * v + 10.0 * a) / (9.0 * x[c] * x[c]);
    hessian[c * all + n] -= (v + 4.0 * a) / (9.0 * x[c] * u[0]);
    hessian[n * all + n] -= 2.0 * (v + a) / (9.0 * u[0] * u[0]);
}

/* The duration that a switch begins, and the weight of its relative change. */
INLINE void add_time(int d, double n, double hold, Stage *stage) {
    const int all = all_of(d), at = 3 * d + 1;
    const double duration = cbrt(n);
    stage->gradient[at] += duration / (3.0 * n);
    stage->hessian[at * (all + 1)] += (hold - 2.0 * duration) / (9.0 * n * n);
}

/* The Newton system of a stage, given the cost to go after it. */
INLINE void assemble(const Problem *problem, int d, int64_t i, const Iterate *it, const Aim *aim, Stage *stage) {
    const int nx = states_of(d), all = all_of(d), switches = problem->switches[i], used = nx + (switches ? 1 : d);
    const double *const x = it->x + i * nx, *const u = it->u + i * d;
    const double *const after = it->cost + (i + 1) * nx * nx, *const defect = it->defect + i * nx;
    double right[MOST_STATES * MOST_ALL], turned[MOST_ALL * MOST_STATES], both[MOST_ALL * MOST_ALL];
    double pulled[MOST_STATES], gradient[MOST_ALL];
    memset(stage->hessian, 0, sizeof(double) * (size_t)(all * all));
    memset(stage->gradient, 0, sizeof(double) * (size_t)all);
    joint_condense(problem, i, it, aim->mu, stage->hessian, stage->gradient);
    for (int r = 0; r < nx; r++) {
        pulled[r] = it->slope[(i + 1) * nx + r];
        for (int k = 0; k < nx; k++) pulled[r] += after[r * nx + k] * defect[k];
    }
    const Switch by = switches ? switch_of(d, x, u) : (Switch){0};
    if (switches) {
        add_time(d, u[0], aim->hold, stage);
        add_bend(d, x, u, by.r, it->prices + (i + 1) * nx, stage->hessian);
        times_switch(d, nx, &by, after, right);
        times_switch(d, 1, &by, pulled, gradient);
    } else {
        times_segment(d, nx, problem->share[i], after, right);
        times_segment(d, 1, problem->share[i], pulled, gradient);
    }
    for (int c = 0; c < used; c++)
        for (int r = 0; r < nx; r++) turned[c * nx + r] = right[r * all + c];
    if (switches)
        times_switch(d, used, &by, turned, both);
    else
        times_segment(d, used, problem->share[i], turned, both);
    for (int r = 0; r < used; r++) {
        for (int c = r; c < used; c++) stage->hessian[r * all + c] += both[r * all + c];
        stage->gradient[r] += gradient[r];
    }
    for (int r = nx; r < used; r++)
        for (int c = nx; c < r; c++) stage->hessian[r * all + c] = stage->hessian[c * all + r];
}

/* Cholesky factor of the Hessian over the controls, in place of its lower triangle; 0 where it has none. */
INLINE int factor(int n, int stride, double *restrict a) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i * stride + j];
            for (int k = 0; k < j; k++) sum -= a[i * stride + k] * a[j * stride + k];
            if (i > j)
                a[i * stride + j] = sum / a[j * stride + j];
            else if (sum > LEAST_PIVOT * fabs(a[i * stride + i]))
                a[i * stride + i] = sqrt(sum);
            else
                return 0;
        }
    return 1;
}

/* gain = -H_uu^-1 H_ux and push = -H_uu^-1 g_u, H_uu given by its factor. */
INLINE void solve_controls(int d, int controls, const Stage *stage, double *restrict gain, double *restrict push) {
    const int nx = states_of(d), all = all_of(d);
    const double *const factored = stage->hessian + nx * (all + 1);
    for (int c = 0; c <= nx; c++) {
        double y[MOST_AXES];
        for (int a = 0; a < controls; a++) {
            double sum = -(c < nx ? stage->hessian[c * all + nx + a] : stage->gradient[nx + a]);
            for (int b = 0; b < a; b++) sum -= factored[a * all + b] * y[b];
            y[a] = sum / factored[a * (all + 1)];
        }
        for (int a = controls - 1; a >= 0; a--) {
            for (int b = a + 1; b < controls; b++) y[a] -= factored[b * all + a] * y[b];
            y[a] /= factored[a * (all + 1)];
        }
        for (int a = 0; a < controls; a++) *(c < nx ? gain + a * nx + c : push + a) = y[a];
    }
}

/* The cost to go from this stage on, given gain and push. */
INLINE void cost_of(int d, int controls, const Stage *stage, const double *restrict gain, const double *restrict push,
                    double *restrict cost, double *restrict slope) {
    const int nx = states_of(d), all = all_of(d);
    for (int a = 0; a < nx; a++) {
        const double *const row = stage->hessian + a * all;
        double sum = stage->gradient[a];
        for (int k = 0; k < controls; k++) sum += row[nx + k] * push[k];
        slope[a] = sum;
        for (int b = a; b < nx; b++) cost[a * nx + b] = row[b];
        for (int k = 0; k < controls; k++)
            for (int b = a; b < nx; b++) cost[a * nx + b] += row[nx + k] * gain[k * nx + b];
        for (int b = a + 1; b < nx; b++) cost[b * nx + a] = cost[a * nx + b];
    }
}

/* Go back over a stage; 0 where its Hessian over the controls is not positive definite. */
INLINE int step_back(const Problem *problem, int d, int64_t i, const Iterate *it, const Aim *aim) {
    const int nx = states_of(d), all = all_of(d), controls = problem->switches[i] ? 1 : d;
    Stage stage;
    assemble(problem, d, i, it, aim, &stage);
    if (problem->switches[i]) {
        const double held = aim->hold / (9.0 * square(it->u[i * d]));
        if (!(stage.hessian[nx * (all + 1)] > FIRMNESS * held)) return 0;
    }
    if (!factor(controls, all, stage.hessian + nx * (all + 1))) return 0;
    double *const gain = it->gain + i * d * nx, *const push = it->push + i * d;
    solve_controls(d, controls, &stage, gain, push);
    cost_of(d, controls, &stage, gain, push, it->cost + i * nx * nx, it->slope + i * nx);
    return 1;
}

HOT static int stage_back(const Problem *problem, int64_t i, const Iterate *it, const Aim *aim) {
    switch (problem->d) {
    case 2: return step_back(problem, 2, i, it, aim);
    case 3: return step_back(problem, 3, i, it, aim);
    default: return step_back(problem, (int)problem->d, i, it, aim);
    }
}

int joint_back(const Problem *problem, const Iterate *it, const Aim *aim) {
    const int64_t d = problem->d, nx = 3 * d + 1, n = problem->n;
    double *const cost = it->cost + n * nx * nx, *const slope = it->slope + n * nx;
    memset(cost, 0, sizeof(double) * (size_t)(nx * nx));
    slope[3 * d] = 0.0;
    for (int64_t k = 0; k < 3 * d; k++) {
        cost[k * (nx + 1)] = aim->weight;
        slope[k] = it->price[k] + aim->weight * (it->x[n * nx + k] - problem->target[k]);
    }
    for (int64_t i = n - 1; i >= 0; i--)
        if (!stage_back(problem, i, it, aim)) return 0;
    return 1;
}

void joint_forth(const Problem *problem, const Iterate *it) {
    const int d = (int)problem->d, nx = states_of(d);
    memset(it->dx, 0, sizeof(double) * (size_t)nx);
    for (int64_t i = 0; i < problem->n; i++) {
        const int switches = problem->switches[i];
        const double *const dx = it->dx + i * nx, *const gain = it->gain + i * d * nx;
        double *const du = it->du + i * d, *const next = it->dx + (i + 1) * nx;
        memset(du, 0, sizeof(double) * (size_t)d);
        for (int a = 0; a < (switches ? 1 : d); a++) {
            du[a] = it->push[i * d + a];
            for (int b = 0; b < nx; b++) du[a] += gain[a * nx + b] * dx[b];
        }
        if (switches) {
            const Switch by = switch_of(d, it->x + i * nx, it->u + i * d);
            memcpy(next, dx, sizeof(double) * (size_t)d);
            for (int k = 0; k < 2 * d; k++)
                next[d + k] = (k < d ? by.r : by.r * by.r) * dx[d + k] + by.before[k] * dx[3 * d] + by.after[k] * du[0];
            next[3 * d] = du[0];
        } else
            joint_arrive(d, 0, problem->share[i], dx, du, next);
        for (int k = 0; k < nx; k++) next[k] += it->defect[i * nx + k];
    }
}

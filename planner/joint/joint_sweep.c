/* The Newton system of the joint problem, solved by a Riccati sweep: back over the stages the least cost to go

       V_i(dx) = dx^T P_i dx / 2 + p_i^T dx,    V_n = weight |x_n + dx - target|^2 / 2 + price^T (x_n + dx - target),

   forth the step itself.  Within a phase the dynamics are those of three integrators an axis, with constant coefficients, whose
   products with P need no matrix.  A switch from c to n multiplies V by r = (n / c)^(1/3) and A by r^2; it alone is not linear. */
#include "joint_inline.h"

static const double LEAST_PIVOT = 1e-13; /* of the diagonal */

static const double FIRMNESS = 0.3;       /* least curvature over a duration, of that by which it is held */

/* A stage: Hessian (of it what joint_inline.h says) and gradient over state and controls, with the cost to go. */
typedef struct {
    double hessian[MOST_ALL * MOST_ALL], gradient[MOST_ALL];
} Stage;

/* The cost to go, Hessian and gradient. */
typedef struct {
    double cost[MOST_STATES * MOST_STATES], slope[MOST_STATES];
} Ahead;

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

/* The transpose of the Jacobian of a segment times a matrix (states, all), added to the Hessian. */
INLINE void add_segment(int d, double w, const double *restrict from, double *restrict hessian) {
    const int nx = states_of(d), all = all_of(d);
    const double half = 0.5 * w * w, sixth = w * w * w / 6.0;
    for (int k = 0; k < d; k++) {
        const double *const p = from + k * all, *const v = p + d * all, *const a = v + d * all;
        double *const to_p = hessian + k * all, *const to_v = to_p + d * all, *const to_a = to_v + d * all;
        double *const to_u = hessian + (nx + k) * all;
        for (int c = 0; c < nx; c++) to_p[c] += p[c];
        for (int c = d; c < nx; c++) to_v[c] += w * p[c] + v[c];
        for (int c = 2 * d; c < nx; c++) to_a[c] += half * p[c] + w * v[c] + a[c];
        for (int c = 0; c < all; c++) to_u[c] += sixth * p[c] + half * v[c] + w * a[c];
    }
    hessian[3 * d * (all + 1)] += from[3 * d * (all + 1)];
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
        hessian[n * all + d + k] += pv / (3.0 * u[0]);
        hessian[(2 * d + k) * all + c] -= 2.0 * pa / (3.0 * x[c]);
        hessian[n * all + 2 * d + k] += 2.0 * pa / (3.0 * u[0]);
        v += pv * x[d + k];
        a += pa * x[2 * d + k];
    }
    hessian[c * all + c] += (4.0 * v + 10.0 * a) / (9.0 * x[c] * x[c]);
    hessian[n * all + c] -= (v + 4.0 * a) / (9.0 * x[c] * u[0]);
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
INLINE void assemble(const Problem *problem, int d, int switches, int64_t i, const Iterate *it, const Aim *aim,
                     const Ahead *ahead, Stage *stage) {
    const int nx = states_of(d), all = all_of(d), used = nx + (switches ? 1 : d);
    const double *const x = it->x + i * nx, *const u = it->u + i * d, *const defect = it->defect + i * nx;
    double right[MOST_STATES * MOST_ALL], pulled[MOST_STATES], gradient[MOST_ALL];
    memcpy(stage->hessian, it->hessian + i * all * all, sizeof(double) * (size_t)(all * all));
    for (int r = 0; r < nx; r++) {
        double sum = ahead->slope[r];
        for (int k = 0; k < nx; k++) sum += ahead->cost[r * nx + k] * defect[k];
        pulled[r] = sum;
    }
    if (switches) {
        double turned[MOST_ALL * MOST_STATES], both[MOST_ALL * MOST_ALL];
        const Switch by = switch_of(d, x, u);
        add_bend(d, x, u, by.r, it->prices + (i + 1) * nx, stage->hessian);
        times_switch(d, nx, &by, ahead->cost, right);
        times_switch(d, 1, &by, pulled, gradient);
        for (int c = 0; c < used; c++)
            for (int r = 0; r < nx; r++) turned[c * nx + r] = right[r * all + c];
        times_switch(d, used, &by, turned, both);
        for (int r = 0; r < nx; r++)
            for (int c = r; c < nx; c++) stage->hessian[r * all + c] += both[r * all + c];
        for (int c = 0; c < used; c++) stage->hessian[nx * all + c] += both[nx * all + c];
    } else {
        times_segment(d, nx, problem->share[i], ahead->cost, right);
        times_segment(d, 1, problem->share[i], pulled, gradient);
        add_segment(d, problem->share[i], right, stage->hessian);
    }
    for (int r = 0; r < used; r++) stage->gradient[r] = it->gradient[i * all + r] + gradient[r];
    if (switches) add_time(d, u[0], aim->hold, stage);
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
    const double *const coupled = stage->hessian + nx * all, *const factored = coupled + nx;
    for (int a = 0; a < controls; a++) {
        const double per = 1.0 / factored[a * (all + 1)];
        double *const row = gain + a * nx;
        for (int c = 0; c < nx; c++) row[c] = -coupled[a * all + c];
        push[a] = -stage->gradient[nx + a];
        for (int b = 0; b < a; b++) {
            for (int c = 0; c < nx; c++) row[c] -= factored[a * all + b] * gain[b * nx + c];
            push[a] -= factored[a * all + b] * push[b];
        }
        for (int c = 0; c < nx; c++) row[c] *= per;
        push[a] *= per;
    }
    for (int a = controls - 1; a >= 0; a--) {
        const double per = 1.0 / factored[a * (all + 1)];
        double *const row = gain + a * nx;
        for (int b = a + 1; b < controls; b++) {
            for (int c = 0; c < nx; c++) row[c] -= factored[b * all + a] * gain[b * nx + c];
            push[a] -= factored[b * all + a] * push[b];
        }
        for (int c = 0; c < nx; c++) row[c] *= per;
        push[a] *= per;
    }
}

/* The cost to go from this stage on, given gain and push. */
INLINE void cost_of(int d, int controls, const Stage *stage, const double *restrict gain, const double *restrict push,
                    Ahead *ahead) {
    const int nx = states_of(d), all = all_of(d);
    double *const cost = ahead->cost;
    for (int a = 0; a < nx; a++) {
        double sum = stage->gradient[a];
        for (int b = a; b < nx; b++) cost[a * nx + b] = stage->hessian[a * all + b];
        for (int k = 0; k < controls; k++) {
            const double coupled = stage->hessian[(nx + k) * all + a];
            sum += coupled * push[k];
            for (int b = a; b < nx; b++) cost[a * nx + b] += coupled * gain[k * nx + b];
        }
        ahead->slope[a] = sum;
    }
    for (int a = 1; a < nx; a++)
        for (int b = 0; b < a; b++) cost[a * nx + b] = cost[b * nx + a];
}

/* Go back over a stage; 0 where its Hessian over the controls is not positive definite. */
INLINE int step_back(const Problem *problem, int d, int switches, int64_t i, const Iterate *it, const Aim *aim,
                     Ahead *ahead) {
    const int nx = states_of(d), all = all_of(d), controls = switches ? 1 : d;
    Stage stage;
    assemble(problem, d, switches, i, it, aim, ahead, &stage);
    if (switches) {
        const double held = aim->hold / (9.0 * square(it->u[i * d]));
        if (!(stage.hessian[nx * (all + 1)] > FIRMNESS * held)) return 0;
    }
    if (!factor(controls, all, stage.hessian + nx * (all + 1))) return 0;
    double *const gain = it->gain + i * d * nx, *const push = it->push + i * d;
    solve_controls(d, controls, &stage, gain, push);
    cost_of(d, controls, &stage, gain, push, ahead);
    return 1;
}

INLINE int back(const Problem *problem, int d, const Iterate *it, const Aim *aim) {
    const int64_t nx = states_of(d), n = problem->n;
    Ahead ahead;
    memset(ahead.cost, 0, sizeof(double) * (size_t)(nx * nx));
    ahead.slope[3 * d] = 0.0;
    for (int k = 0; k < 3 * d; k++) {
        ahead.cost[k * (nx + 1)] = aim->weight;
        ahead.slope[k] = it->price[k] + aim->weight * (it->x[n * nx + k] - problem->target[k]);
    }
    for (int64_t i = n - 1; i >= 0; i--) {
        if (problem->switches[i]) {
            memcpy(it->cost + (i + 1) * nx * nx, ahead.cost, sizeof(double) * (size_t)(nx * nx));
            memcpy(it->slope + (i + 1) * nx, ahead.slope, sizeof(double) * (size_t)nx);
            if (!step_back(problem, d, 1, i, it, aim, &ahead)) return 0;
        } else if (!step_back(problem, d, 0, i, it, aim, &ahead))
            return 0;
    }
    return 1;
}

HOT int joint_back(const Problem *problem, const Iterate *it, const Aim *aim) {
    switch (problem->d) {
    case 2: return back(problem, 2, it, aim);
    case 3: return back(problem, 3, it, aim);
    default: return back(problem, (int)problem->d, it, aim);
    }
}

INLINE void forth(const Problem *problem, int d, const Iterate *it) {
    const int nx = states_of(d);
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

HOT void joint_forth(const Problem *problem, const Iterate *it) {
    switch (problem->d) {
    case 2: forth(problem, 2, it); break;
    case 3: forth(problem, 3, it); break;
    default: forth(problem, (int)problem->d, it);
    }
}

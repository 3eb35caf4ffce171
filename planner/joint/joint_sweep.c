/* The Newton system of the joint problem, solved by a Riccati sweep: back over the stages the least cost to go

       V_i(dx) = dx^T P_i dx / 2 + p_i^T dx,    V_n = weight |x_n + dx - target|^2 / 2 + price^T (x_n + dx - target),

   forth the step itself.  The dynamics are those of three integrators an axis, whose products with P need no matrix. */
#include "joint_inline.h"

/* A stage: Hessian and gradient over state and controls, the second over the first `all` rows. */
typedef struct {
    double hessian[MOST_ALL * MOST_ALL], gradient[MOST_ALL];
} Stage;

/* Columns of a row-major matrix (rows, states) times the Jacobian of the dynamics, into out (rows, all). */
INLINE void times_dynamics(int d, int rows, double h, int duration, const double *restrict slope,
                           const double *restrict from, double *restrict out) {
    const int nx = states_of(d), all = 4 * d + 2;
    const double half = 0.5 * h * h, sixth = h * h * h / 6.0;
    for (int r = 0; r < rows; r++) {
        const double *const p = from + r * nx, *const v = p + d, *const a = v + d;
        double *const to = out + r * all;
        double sum = p[3 * d];
        for (int k = 0; k < d; k++) {
            to[k] = p[k];
            to[d + k] = h * p[k] + v[k];
            to[2 * d + k] = half * p[k] + h * v[k] + a[k];
            to[nx + k] = sixth * p[k] + half * v[k] + h * a[k];
            sum += slope[k] * p[k] + slope[d + k] * v[k] + slope[2 * d + k] * a[k];
        }
        to[3 * d] = to[4 * d + 1] = 0.0;
        to[duration] = sum;
    }
}

/* How the end of a segment changes with the duration. */
INLINE void slope_of(int d, double share, double h, const double *restrict x, const double *restrict u,
                     double *restrict slope) {
    for (int k = 0; k < d; k++) {
        const double a = x[2 * d + k], j = u[k];
        slope[k] = share * (x[d + k] + h * (a + 0.5 * h * j));
        slope[d + k] = share * (a + h * j);
        slope[2 * d + k] = share * j;
    }
}

/* Second derivatives of the dynamics, times the prices of the state that it leads to. */
INLINE void add_bend(int d, double share, double h, int duration, const double *x, const double *u,
                     const double *prices, double exact, double *restrict hessian) {
    const int all = 4 * d + 2;
    double twice = 0.0;
    for (int k = 0; k < d; k++) {
        const double p = prices[k], v = prices[d + k], a = prices[2 * d + k], by = exact * share;
        hessian[(d + k) * all + duration] += by * p;
        hessian[(2 * d + k) * all + duration] += by * (h * p + v);
        const int jerk = 3 * d + 1 + k;
        hessian[jerk < duration ? jerk * all + duration : duration * all + jerk] += by * (0.5 * h * h * p + h * v + a);
        twice += p * (x[2 * d + k] + h * u[k]) + v * u[k];
    }
    hessian[duration * (all + 1)] += exact * share * share * twice;
}

/* Cholesky factor of the Hessian over the controls, in place of its lower triangle; 0 where it has none. */
INLINE int factor(int n, double shift, int stride, double *restrict a) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i * stride + j] + (i == j ? shift : 0.0);
            for (int k = 0; k < j; k++) sum -= a[i * stride + k] * a[j * stride + k];
            if (i > j)
                a[i * stride + j] = sum / a[j * stride + j];
            else if (sum > 1e-12)
                a[i * stride + i] = sqrt(sum);
            else
                return 0;
        }
    return 1;
}

/* gain = -H_uu^-1 H_ux and push = -H_uu^-1 g_u, H_uu given by its factor. */
INLINE void solve_controls(int d, int controls, const Stage *stage, double *restrict gain, double *restrict push) {
    const int nx = states_of(d), all = 4 * d + 2;
    const double *const factored = stage->hessian + nx * (all + 1);
    for (int c = 0; c <= nx; c++) {
        double y[MOST_CONTROLS];
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
    const int nx = states_of(d), all = 4 * d + 2;
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

/* The Newton system of a stage, given the cost to go after it. */
INLINE void assemble(const Problem *problem, int d, int64_t i, const Iterate *it, double mu, double exact,
                     Stage *stage) {
    const int nx = states_of(d), all = 4 * d + 2, begins = problem->begins[i], duration = duration_at(d, begins);
    const double *const x = it->x + i * nx, *const u = it->u + i * (d + 1);
    const double share = problem->share[i], h = share * duration_of(d, begins, x, u);
    const double *const after = it->cost + (i + 1) * nx * nx, *const defect = it->defect + i * nx;
    double slope[3 * MOST_AXES], right[MOST_STATES * MOST_ALL], turned[MOST_ALL * MOST_STATES], pulled[MOST_STATES];
    memset(stage->hessian, 0, sizeof(double) * (size_t)(all * all));
    memset(stage->gradient, 0, sizeof(double) * (size_t)all);
    joint_condense(problem, i, it, mu, exact, stage->hessian, stage->gradient);
    if (begins) stage->gradient[duration] += 1.0;
    if (exact > 0.0) add_bend(d, share, h, duration, x, u, it->prices + (i + 1) * nx, exact, stage->hessian);
    slope_of(d, share, h, x, u, slope);
    times_dynamics(d, nx, h, duration, slope, after, right);
    for (int r = 0; r < nx; r++)
        for (int c = 0; c < all; c++) turned[c * nx + r] = right[r * all + c];
    double product[MOST_ALL * MOST_ALL], gradient[MOST_ALL];
    times_dynamics(d, all, h, duration, slope, turned, product);
    for (int r = 0; r < all; r++)
        for (int c = r; c < all; c++) stage->hessian[r * all + c] += product[r * all + c];
    for (int r = 0; r < nx; r++) {
        pulled[r] = it->slope[(i + 1) * nx + r];
        for (int k = 0; k < nx; k++) pulled[r] += after[r * nx + k] * defect[k];
    }
    times_dynamics(d, 1, h, duration, slope, pulled, gradient);
    for (int r = 0; r < all; r++) stage->gradient[r] += gradient[r];
    for (int r = nx; r < all; r++)
        for (int c = nx; c < r; c++) stage->hessian[r * all + c] = stage->hessian[c * all + r];
}

/* Go back over a stage; 0 where its Hessian over the controls is not positive definite. */
INLINE int step_back(const Problem *problem, int d, int64_t i, const Iterate *it, double mu, double exact,
                     double shift) {
    const int nx = states_of(d), all = 4 * d + 2, controls = d + problem->begins[i];
    Stage stage;
    assemble(problem, d, i, it, mu, exact, &stage);
    if (!factor(controls, shift, all, stage.hessian + nx * (all + 1))) return 0;
    double *const gain = it->gain + i * (d + 1) * nx, *const push = it->push + i * (d + 1);
    solve_controls(d, controls, &stage, gain, push);
    cost_of(d, controls, &stage, gain, push, it->cost + i * nx * nx, it->slope + i * nx);
    return 1;
}

HOT static int stage_back(const Problem *problem, int64_t i, const Iterate *it, double mu, double exact, double shift) {
    switch (problem->d) {
    case 2: return step_back(problem, 2, i, it, mu, exact, shift);
    case 3: return step_back(problem, 3, i, it, mu, exact, shift);
    default: return step_back(problem, (int)problem->d, i, it, mu, exact, shift);
    }
}

/* The cost of the last state. */
static void end_cost(const Problem *problem, const Iterate *it, double weight) {
    const int64_t d = problem->d, nx = 3 * d + 1, n = problem->n;
    double *const cost = it->cost + n * nx * nx, *const slope = it->slope + n * nx;
    memset(cost, 0, sizeof(double) * (size_t)(nx * nx));
    slope[3 * d] = 0.0;
    for (int64_t k = 0; k < 3 * d; k++) {
        cost[k * (nx + 1)] = weight;
        slope[k] = it->price[k] + weight * (it->x[n * nx + k] - problem->target[k]);
    }
}

/* A stage whose Hessian is not positive definite: less of the second derivatives, then none, then a shift. */
static int back_somehow(const Problem *problem, int64_t i, const Iterate *it, double mu, double exact) {
    const double shares[3] = {exact, 0.3 * exact, 0.0};
    for (int k = exact > 0.0 ? 0 : 2; k < 3; k++)
        if (stage_back(problem, i, it, mu, shares[k], 0.0)) return 1;
    double shift = 1e-3;
    for (int k = 0; k < (exact > 0.0 ? 1 : 13); k++, shift *= 10.0)
        if (stage_back(problem, i, it, mu, 0.0, shift)) return 1;
    return 0;
}

int joint_back(const Problem *problem, const Iterate *it, double mu, double weight, double exact) {
    end_cost(problem, it, weight);
    for (int64_t i = problem->n - 1; i >= 0; i--)
        if (!back_somehow(problem, i, it, mu, exact)) return 0;
    return 1;
}

void joint_forth(const Problem *problem, const Iterate *it) {
    const int d = (int)problem->d, nx = states_of(d), nu = d + 1;
    memset(it->dx, 0, sizeof(double) * (size_t)nx);
    for (int64_t i = 0; i < problem->n; i++) {
        const int begins = problem->begins[i], controls = d + begins;
        const double *const x = it->x + i * nx, *const u = it->u + i * nu, *const dx = it->dx + i * nx;
        const double *const gain = it->gain + i * nu * nx, *const push = it->push + i * nu;
        double *const du = it->du + i * nu, *const next = it->dx + (i + 1) * nx, slope[3 * MOST_AXES];
        du[d] = 0.0;
        for (int a = 0; a < controls; a++) {
            du[a] = push[a];
            for (int b = 0; b < nx; b++) du[a] += gain[a * nx + b] * dx[b];
        }
        const double dduration = duration_of(d, begins, dx, du), h = problem->share[i] * duration_of(d, begins, x, u);
        double moved[4 * MOST_AXES];
        joint_at(d, h, dx, du, moved);
        slope_of(d, problem->share[i], h, x, u, slope);
        for (int k = 0; k < 3 * d; k++) next[k] = it->defect[i * nx + k] + moved[k] + slope[k] * dduration;
        next[3 * d] = it->defect[i * nx + 3 * d] + dduration;
    }
}

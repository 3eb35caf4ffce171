/* The joint problem's interior-point method: one Newton step an iteration; solve.py has the rules. */
#include "joint.h"
#include "joint_inline.h"

static const double END_WEIGHT = 1e3;        /* of the squared distance from the target, beside its multipliers */
static const double FRACTION = 0.98;         /* of the way to the boundary */
static const double LARGEST_CHANGE = 0.2;    /* of a duration, in a step */
static const double GROWTH = 1.5, OPEN = 0.05; /* a step may let the defects grow to this share of what they were, or to that */
static const double LEAST_SLACK = 0.05;      /* at the start */
static const double CLOSED = 1e-8, REACHED = 1e-7; /* defects; distance from the target */
enum { HALVINGS = 12 };
enum { CONVERGED, RUNNING, SINGULAR, STUCK };

static Problem problem_of(const int64_t *sizes, const uint8_t *begins, const double *share, const int64_t *leg,
                          const double *vectors, const double *rates, const double *lengths, const double *near,
                          const double *pace, const double *axes, const double *scalars, const double *target) {
    const int64_t d = sizes[0];
    return (Problem){
        .d = d,
        .n = sizes[1],
        .begins = begins,
        .share = share,
        .leg = leg,
        .vectors = vectors,
        .rates = rates,
        .lengths = lengths,
        .near = near,
        .pace = pace,
        .velocity = axes,
        .acceleration = axes + d,
        .jerk = axes + 2 * d,
        .bend = scalars[0],
        .shortest = scalars[1],
        .target = target,
    };
}

/* Numbers of work a stage, beside the last one. */
static int64_t a_stage(int64_t d) {
    const int64_t nx = 3 * d + 1, nu = d + 1, rows = 9 + 10 * d;
    return 4 * nx + nu + nx * nx + nu * nx + nu + 4 * rows + POINTS * d * (d + 1) + 1;
}

int64_t joint_work(const int64_t *sizes) { return (sizes[1] + 1) * a_stage(sizes[0]) + 3 * sizes[0]; }

static double *taken(double **work, int64_t count) {
    double *const part = *work;
    *work += count;
    return part;
}

static Iterate iterate_of(const Problem *problem, double *x, double *u, double *work) {
    const int64_t d = problem->d, n = problem->n + 1, nx = 3 * d + 1, nu = d + 1, rows = 9 + 10 * d;
    return (Iterate){
        .x = x,
        .u = u,
        .dx = taken(&work, n * nx),
        .du = taken(&work, n * nu),
        .prices = taken(&work, n * nx),
        .defect = taken(&work, n * nx),
        .slope = taken(&work, n * nx),
        .cost = taken(&work, n * nx * nx),
        .gain = taken(&work, n * nu * nx),
        .push = taken(&work, n * nu),
        .value = taken(&work, n * rows),
        .slack = taken(&work, n * rows),
        .dual = taken(&work, n * rows),
        .dslack = taken(&work, n * rows),
        .off = taken(&work, n * POINTS * d),
        .curve = taken(&work, n * POINTS * d * d),
        .rows = (int64_t *)(void *)taken(&work, n),
        .price = taken(&work, 3 * d),
    };
}

/* Where the iterate stands. */
typedef struct {
    double time, defect, products, violation, end;
    int64_t rows;
} Standing;

static void set_out(const Problem *problem, const Iterate *it, double start) {
    const int64_t d = problem->d, nx = 3 * d + 1, rows = 9 + 10 * d;
    memset(it->prices, 0, sizeof(double) * (size_t)((problem->n + 1) * nx));
    memset(it->price, 0, sizeof(double) * (size_t)(3 * d));
    for (int64_t i = 0; i < problem->n; i++) {
        it->rows[i] = joint_values(problem, i, it);
        for (int64_t r = i * rows; r < i * rows + it->rows[i]; r++) {
            it->slack[r] = larger(-it->value[r], LEAST_SLACK);
            it->dual[r] = start / it->slack[r];
        }
    }
}

static Standing stand(const Problem *problem, const Iterate *it) {
    const int d = (int)problem->d, nx = states_of(d), nu = d + 1, rows = most_rows_of(d);
    Standing now = {0.0, 0.0, 0.0, 0.0, 0.0, 0};
    for (int64_t i = 0; i < problem->n; i++) {
        double *const defect = it->defect + i * nx;
        joint_arrive(d, problem->begins[i], problem->share[i], it->x + i * nx, it->u + i * nu, defect);
        for (int k = 0; k < nx; k++) {
            defect[k] -= it->x[(i + 1) * nx + k];
            now.defect = larger(now.defect, fabs(defect[k]));
        }
        if (problem->begins[i]) now.time += it->u[i * nu + d];
        for (int64_t r = i * rows; r < i * rows + it->rows[i]; r++) {
            now.products += it->slack[r] * it->dual[r];
            now.violation = larger(now.violation, it->value[r]);
        }
        now.rows += it->rows[i];
    }
    for (int k = 0; k < 3 * d; k++)
        now.end = larger(now.end, fabs(it->x[problem->n * nx + k] - problem->target[k]));
    return now;
}

/* How far a step may go: so that slacks and multipliers stay positive, and durations change little. */
static void lengths_of(const Problem *problem, const Iterate *it, double mu, double *primal, double *dual) {
    const int64_t d = problem->d, rows = 9 + 10 * d;
    double change = 0.0;
    *primal = *dual = 1.0;
    for (int64_t i = 0; i < problem->n; i++) {
        double *const dslack = it->dslack + i * rows;
        joint_changes(problem, i, it, dslack);
        for (int64_t r = 0; r < it->rows[i]; r++) {
            const double s = it->slack[i * rows + r], z = it->dual[i * rows + r];
            dslack[r] = -(it->value[i * rows + r] + s) - dslack[r];
            const double dz = (mu - z * dslack[r]) / s - z;
            if (dslack[r] < 0.0) *primal = smaller(*primal, -FRACTION * s / dslack[r]);
            if (dz < 0.0) *dual = smaller(*dual, -FRACTION * z / dz);
        }
        if (problem->begins[i])
            change = larger(change, fabs(it->du[i * (d + 1) + d]) / it->u[i * (d + 1) + d]);
    }
    if (change * *primal > LARGEST_CHANGE) *primal = LARGEST_CHANGE / change;
}

/* Largest defect after a step of this length. */
static double defect_after(const Problem *problem, const Iterate *it, double length) {
    const int d = (int)problem->d, nx = states_of(d), nu = d + 1;
    double most = 0.0;
    for (int64_t i = 0; i < problem->n; i++) {
        double x[MOST_STATES], u[MOST_CONTROLS], end[MOST_STATES];
        for (int k = 0; k < nx; k++) x[k] = it->x[i * nx + k] + length * it->dx[i * nx + k];
        for (int k = 0; k < nu; k++) u[k] = it->u[i * nu + k] + length * it->du[i * nu + k];
        joint_arrive(d, problem->begins[i], problem->share[i], x, u, end);
        for (int k = 0; k < nx; k++) {
            const int64_t next = (i + 1) * nx + k;
            most = larger(most, fabs(end[k] - it->x[next] - length * it->dx[next]));
        }
    }
    return most;
}

static void advance(const Problem *problem, const Iterate *it, double mu, double primal, double dual) {
    const int d = (int)problem->d, nx = states_of(d), nu = d + 1, rows = most_rows_of(d);
    for (int64_t i = 0; i <= problem->n; i++)
        for (int k = 0; k < nx; k++) {
            const double *const row = it->cost + (i * nx + k) * nx, *const dx = it->dx + i * nx;
            double sum = it->slope[i * nx + k];
            for (int m = 0; m < nx; m++) sum += row[m] * dx[m];
            it->prices[i * nx + k] = sum;
        }
    for (int64_t i = 0; i < (problem->n + 1) * nx; i++) it->x[i] += primal * it->dx[i];
    for (int64_t i = 0; i < problem->n * nu; i++) it->u[i] += primal * it->du[i];
    for (int64_t i = 0; i < problem->n; i++) {
        joint_values(problem, i, it);
        for (int64_t r = i * rows; r < i * rows + it->rows[i]; r++) {
            const double s = it->slack[r], z = it->dual[r];
            it->dual[r] += dual * ((mu - z * it->dslack[r]) / s - z);
            it->slack[r] = larger(s + primal * it->dslack[r], -it->value[r]);
        }
    }
    for (int k = 0; k < 3 * d; k++)
        it->price[k] += END_WEIGHT * (it->x[problem->n * nx + k] - problem->target[k]);
}

/* Newton's step with less and less of the second derivatives; 0 where none is found. */
static int sweep_back(const Problem *problem, const Iterate *it, double mu) {
    const double shares[4] = {1.0, 0.3, 0.09, 0.0};
    for (int k = 0; k < 4; k++)
        if (joint_back(problem, it, mu, END_WEIGHT, shares[k])) return 1;
    return 0;
}

int64_t joint_solve(const int64_t *sizes, const uint8_t *begins, const double *share, const int64_t *leg,
                    const double *vectors, const double *rates, const double *lengths, const double *near,
                    const double *pace, const double *axes, const double *scalars, const double *target, double gap,
                    double start, int64_t most, double *x, double *u, double *work, double *found) {
    const Problem problem = problem_of(sizes, begins, share, leg, vectors, rates, lengths, near, pace, axes, scalars,
                                       target);
    const Iterate it = iterate_of(&problem, x, u, work);
    set_out(&problem, &it, start);
    double length = 1.0;
    int64_t status = RUNNING, count = 0;
    Standing now = stand(&problem, &it);
    for (; count < most; count++) {
        if (count && now.products < gap * now.time && now.defect < CLOSED && now.end < REACHED && now.violation < REACHED)
            status = CONVERGED;
        if (status != RUNNING) break;
        const double sigma = count == 0 ? 1.0 : length > 0.9 ? 0.1 : length > 0.5 ? 0.25 : 0.6;
        const double mu = larger(sigma * now.products, 0.1 * gap * now.time) / (double)now.rows;
        if (!sweep_back(&problem, &it, mu)) {
            status = SINGULAR;
            break;
        }
        joint_forth(&problem, &it);
        double dual;
        lengths_of(&problem, &it, mu, &length, &dual);
        const double allowed = larger(GROWTH * now.defect, OPEN);
        for (int k = 0; k < HALVINGS && !(defect_after(&problem, &it, length) <= allowed); k++) length *= 0.5;
        advance(&problem, &it, mu, length, smaller(length, dual));
        now = stand(&problem, &it);
    }
    const double out[6] = {now.time, now.defect, now.products, now.violation, now.end, (double)count};
    memcpy(found, out, sizeof out);
    return status;
}

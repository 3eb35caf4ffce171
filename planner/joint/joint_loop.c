/* The joint problem's interior-point method: one Newton step an iteration; solve.py has the rules. */
#include "joint.h"
#include "joint_inline.h"

static const double FRACTION = 0.995;      /* of the way to the boundary */
static const double LARGEST_CHANGE = 0.5;  /* of the cube of a duration, in a step */
static const double MOST_CHANGE = 2.0;     /* before the step is cut */
static const double GROWTH = 1.5;          /* of the largest defect, in a step */
static const double LEAST_SLACK = 0.01;    /* at the start */
static const double WEIGHT = 1e3, HEAVY = 1e6; /* of the squared distance from the target, beside its multipliers */
static const double FIRM = 1e4;           /* hold at the end */
static const double HOLD = 1e-2, LEAST_HOLD = 1e-6;
static const double CLOSED = 3e-9, REACHED = 1e-7; /* at the end: defects, distance from the target and violations */
enum { HALVINGS = 12, MOST_SWEEPS = 20, MOST_TRIALS = 12 };
enum { CONVERGED, RUNNING, SINGULAR };

/* Numbers of work a stage. */
static int64_t a_stage(int64_t d) {
    const int64_t nx = 3 * d + 1, rows = most_rows_of((int)d);
    const int64_t all = nx + d;
    return 5 * nx + 3 * d + all * (all + 1) + nx * nx + d * nx + 4 * rows + POINTS * d * (d + 1) + 2;
}

int64_t joint_work(const int64_t *sizes) { return (sizes[1] + 1) * a_stage(sizes[0]) + 3 * sizes[0]; }

static double *taken(double **work, int64_t count) {
    double *const part = *work;
    *work += count;
    return part;
}

static Iterate iterate_of(const Problem *problem, double *x, double *u, double *work) {
    const int64_t d = problem->d, n = problem->n + 1, nx = 3 * d + 1, rows = most_rows_of((int)d);
    Iterate it = {.x = x, .u = u};
    it.dx = taken(&work, n * nx);
    it.du = taken(&work, n * d);
    it.prices = taken(&work, n * nx);
    it.defect = taken(&work, n * nx);
    it.hessian = taken(&work, n * (nx + d) * (nx + d));
    it.gradient = taken(&work, n * (nx + d));
    it.slope = taken(&work, n * nx);
    it.cost = taken(&work, n * nx * nx);
    it.gain = taken(&work, n * d * nx);
    it.push = taken(&work, n * d);
    it.root = taken(&work, n);
    it.value = taken(&work, n * rows);
    it.slack = taken(&work, n * rows);
    it.dual = taken(&work, n * rows);
    it.dslack = taken(&work, n * rows);
    it.off = taken(&work, n * POINTS * d);
    it.curve = taken(&work, n * POINTS * d * d);
    it.rows = (int64_t *)(void *)taken(&work, n);
    it.price = taken(&work, 3 * d);
    return it;
}

/* Where the iterate stands. */
typedef struct {
    double time, defect, products, violation, end;
    int64_t rows;
} Standing;

static void set_out(const Problem *problem, const Iterate *it, double start) {
    const int64_t d = problem->d, nx = 3 * d + 1, rows = most_rows_of((int)d);
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

INLINE Standing standing(const Problem *problem, int d, const Iterate *it) {
    const int nx = states_of(d), rows = most_rows_of(d);
    Standing now = {0.0, 0.0, 0.0, 0.0, 0.0, 0};
    for (int64_t i = 0; i < problem->n; i++) {
        double *const defect = it->defect + i * nx;
        joint_arrive(d, problem->switches[i], problem->share[i], it->x + i * nx, it->u + i * d, defect);
        for (int k = 0; k < nx; k++) {
            defect[k] -= it->x[(i + 1) * nx + k];
            now.defect = larger(now.defect, fabs(defect[k]));
        }
        if (problem->switches[i]) now.time += cbrt(it->u[i * d]);
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

HOT static Standing stand(const Problem *problem, const Iterate *it) {
    switch (problem->d) {
    case 2: return standing(problem, 2, it);
    case 3: return standing(problem, 3, it);
    default: return standing(problem, (int)problem->d, it);
    }
}

/* A step: its lengths, how the cubes of durations change at most, and how the time does. */
typedef struct {
    double primal, dual, change, gained, moved;
} Stride;

/* How far a step may go: so that slacks and multipliers stay positive, and durations change little. */
static Stride stride_of(const Problem *problem, const Iterate *it, double mu) {
    const int64_t d = problem->d, rows = most_rows_of((int)d);
    Stride step = {1.0, 1.0, 0.0, 0.0, 0.0};
    for (int64_t i = 0; i < problem->n; i++) {
        double *const dslack = it->dslack + i * rows;
        joint_changes(problem, i, it, dslack);
        for (int64_t r = 0; r < it->rows[i]; r++) {
            const double s = it->slack[i * rows + r], z = it->dual[i * rows + r];
            dslack[r] = -(it->value[i * rows + r] + s) - dslack[r];
            const double dz = (mu - z * dslack[r]) / s - z;
            if (dslack[r] < 0.0) step.primal = smaller(step.primal, -FRACTION * s / dslack[r]);
            if (dz < 0.0) step.dual = smaller(step.dual, -FRACTION * z / dz);
        }
        if (!problem->switches[i]) continue;
        const double change = it->du[i * d] / it->u[i * d];
        step.change = larger(step.change, fabs(change));
        step.moved += fabs(change) / 3.0;
        step.gained += cbrt(it->u[i * d]) * change / 3.0;
    }
    if (step.change * step.primal > LARGEST_CHANGE) step.primal = LARGEST_CHANGE / step.change;
    return step;
}

/* Largest defect after a step of this length; within a phase it is linear. */
static double defect_after(const Problem *problem, const Iterate *it, double length) {
    const int d = (int)problem->d, nx = states_of(d);
    double most = 0.0;
    for (int64_t i = 0; i < problem->n; i++) {
        if (!problem->switches[i]) continue;
        double x[MOST_STATES], u[1], end[MOST_STATES];
        for (int k = 0; k < nx; k++) x[k] = it->x[i * nx + k] + length * it->dx[i * nx + k];
        u[0] = it->u[i * d] + length * it->du[i * d];
        joint_arrive(d, 1, 0.0, x, u, end);
        for (int k = 0; k < nx; k++) {
            const int64_t next = (i + 1) * nx + k;
            most = larger(most, fabs(end[k] - it->x[next] - length * it->dx[next]));
        }
    }
    return most;
}

INLINE void move(const Problem *problem, int d, const Iterate *it, const Aim *aim, const Stride *step) {
    const int nx = states_of(d), rows = most_rows_of(d);
    const double dual = smaller(step->primal, step->dual);
    for (int64_t i = 1; i <= problem->n; i++)
        for (int k = 0; problem->switches[i - 1] && k < nx; k++) {
            const double *const row = it->cost + (i * nx + k) * nx, *const dx = it->dx + i * nx;
            double sum = it->slope[i * nx + k];
            for (int m = 0; m < nx; m++) sum += row[m] * dx[m];
            it->prices[i * nx + k] = sum;
        }
    for (int64_t i = 0; i < (problem->n + 1) * nx; i++) it->x[i] += step->primal * it->dx[i];
    for (int64_t i = 0; i < problem->n; i++) {
        for (int k = 0; k < (problem->switches[i] ? 1 : d); k++) it->u[i * d + k] += step->primal * it->du[i * d + k];
        joint_values(problem, i, it);
        for (int64_t r = i * rows; r < i * rows + it->rows[i]; r++) {
            const double s = it->slack[r], z = it->dual[r];
            it->dual[r] += dual * ((aim->mu - z * it->dslack[r]) / s - z);
            it->slack[r] = larger(s + step->primal * it->dslack[r], -it->value[r]);
        }
    }
    for (int k = 0; k < 3 * d; k++)
        it->price[k] += aim->weight * (it->x[problem->n * nx + k] - problem->target[k]);
}

HOT static void advance(const Problem *problem, const Iterate *it, const Aim *aim, const Stride *step) {
    switch (problem->d) {
    case 2: move(problem, 2, it, aim, step); break;
    case 3: move(problem, 3, it, aim, step); break;
    default: move(problem, (int)problem->d, it, aim, step);
    }
}

/* The step.  Where the system is not positive definite, or durations change much, they are held faster and all is tried again: with
   all of them held the problem is convex. */
static int find_step(const Problem *problem, const Iterate *it, Aim *aim, Stride *step) {
    for (int64_t i = 0; i < problem->n; i++) joint_condense(problem, i, it, aim->mu);
    for (int k = 0; k < MOST_SWEEPS; k++) {
        if (!joint_back(problem, it, aim)) {
            aim->hold = larger((k < 3 ? 4.0 : 10.0) * aim->hold, LEAST_HOLD);
            continue;
        }
        joint_forth(problem, it);
        *step = stride_of(problem, it, aim->mu);
        if (step->change <= MOST_CHANGE || k >= MOST_TRIALS) return 1;
        aim->hold = larger(aim->hold, LEAST_HOLD) * smaller(larger(step->change / MOST_CHANGE, 2.0), 16.0);
    }
    return 0;
}

int64_t joint_solve(const int64_t *sizes, const uint8_t *switches, const double *share, const double *scale,
                    const int64_t *leg, const double *vectors, const double *rates, const double *lengths,
                    const double *near, const double *pace, const double *walls, const double *axes, double least,
                    const double *target, double gap, double start, double open, int64_t most, double *x, double *u,
                    double *work, double *found) {
    const Problem problem = {sizes[0], sizes[1], switches, share, scale, leg, vectors, rates, lengths, near, pace,
                             walls, axes, axes + sizes[0], axes + 2 * sizes[0], least, target};
    const Iterate it = iterate_of(&problem, x, u, work);
    set_out(&problem, &it, start);
    Standing now = stand(&problem, &it);
    Stride step = {1.0, 1.0, 0.0, 0.0, 0.0};
    double hold = HOLD, left = 0.0;
    int64_t status = RUNNING, count = 0;
    int closing = 0;
    for (; count < most && status == RUNNING; count++) {
        const double floor = larger(0.1 * gap * now.time, closing ? 0.0 : 0.3 * smaller(left, now.time));
        const double sigma = count == 0 || closing ? 1.0 : step.primal > 0.9 ? 0.1 : step.primal > 0.5 ? 0.25 : 0.6;
        Aim aim = {larger(sigma * now.products, floor) / (double)now.rows, closing ? HEAVY : WEIGHT, FIRM * pow(2.0, closing / 3)};
        if (!closing) aim.hold = larger(0.15 * hold, 30.0 * aim.mu);
        if (!find_step(&problem, &it, &aim, &step)) {
            status = SINGULAR;
            break;
        }
        if (!closing) hold = step.change > 1.0 ? 4.0 * larger(aim.hold, 1e-5) : aim.hold;
        const double allowed = larger(GROWTH * now.defect, open);
        for (int k = 0; k < HALVINGS && !(defect_after(&problem, &it, step.primal) <= allowed); k++) step.primal *= 0.5;
        left = closing ? 0.0 : aim.hold * step.moved + (1.0 - step.primal) * fabs(step.gained);
        advance(&problem, &it, &aim, &step);
        now = stand(&problem, &it);
        closing += closing > 0;
        if (now.products >= (closing ? 2.0 : 1.0) * gap * now.time) continue;
        if (!closing)
            closing = left < 3.0 * gap * now.time && now.defect < 3e-4 * open;
        else if (now.defect < CLOSED && now.end < REACHED && now.violation < REACHED)
            status = CONVERGED;
    }
    const double out[6] = {now.time, now.defect, now.products, now.violation, now.end, (double)count};
    memcpy(found, out, sizeof out);
    return status;
}

int64_t joint_newton(const int64_t *sizes, const uint8_t *switches, const double *share, const double *scale,
                     const int64_t *leg, const double *vectors, const double *rates, const double *lengths,
                     const double *near, const double *pace, const double *walls, const double *axes, double least,
                     const double *target, double start, const double *aim, double *x, double *u, double *work,
                     const double *prices, const double *price, double *dx, double *du) {
    const Problem problem = {sizes[0], sizes[1], switches, share, scale, leg, vectors, rates, lengths, near, pace,
                             walls, axes, axes + sizes[0], axes + 2 * sizes[0], least, target};
    const Iterate it = iterate_of(&problem, x, u, work);
    const int64_t d = sizes[0], n = sizes[1], nx = 3 * d + 1;
    const Aim wanted = {aim[0], aim[1], aim[2]};
    set_out(&problem, &it, start);
    stand(&problem, &it);
    memcpy(it.prices, prices, sizeof(double) * (size_t)((n + 1) * nx));
    memcpy(it.price, price, sizeof(double) * (size_t)(3 * d));
    for (int64_t i = 0; i < n; i++) joint_condense(&problem, i, &it, wanted.mu);
    if (!joint_back(&problem, &it, &wanted)) return 0;
    joint_forth(&problem, &it);
    memcpy(dx, it.dx, sizeof(double) * (size_t)((n + 1) * nx));
    memcpy(du, it.du, sizeof(double) * (size_t)(n * d));
    return 1;
}

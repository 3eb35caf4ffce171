/* The interior-point method: start, and iterations; interior.py has the problem, the equations and the rules.

   An iteration goes through all points three times: forward to measure the affine step, forward to measure the corrected
   one, and backward to take it, which at once builds and factors the next Newton system. */
#include "interior_inline.h"
#include "solvers.h"

static const double LEAST_CENTRING = 1e-4;
static const double NEAR = 1e-2, NEAR_HOPE = 0.125; /* gap below which the hoped-for gain has only this share of its weight */
static const double LEAST_FRACTION = 0.9, MOST_FRACTION = 0.995; /* of the way to the boundary */
static const double MOST_FALL = 0.9;                             /* of x, in a step */
static const double NO_STEP = 1e-10;

enum { RUNNING, DONE, SINGULAR, STUCK };

static Problem problem_of(const double *h, int64_t intervals, int64_t inner, const double *cap, const double *weight,
                          int64_t accelerations, const double *acceleration, const double *steady, int64_t rows,
                          const double *jerk, const double *jerky, const double *bounds) {
    const int64_t points = (inner + 1) * intervals + 1;
    return (Problem){
        .intervals = intervals,
        .inner = inner,
        .points = points,
        .blocks = (points + BLOCK - 1) / BLOCK,
        .sides = 2 * rows + 1,
        .accelerations = accelerations,
        .rows = rows,
        .h = h,
        .weight = weight,
        .cap = cap,
        .acceleration = acceleration,
        .steady = steady,
        .jerk = jerk,
        .jerky = jerky,
        .bounds = bounds,
    };
}

static Knots knots_of(double *rows, int64_t intervals) {
    return (Knots){rows, rows + intervals + 1, rows + 2 * (intervals + 1)};
}

static void motion_of(const Problem *problem, int64_t block, const Knots *knots, Motion *z) {
    interior_between(problem, block, knots, z);
    interior_pace(z, points_in(problem, block));
}

/* ---- the start ---------------------------------------------------------------------------------------------------- */

void interior_begin(const double *h, int64_t intervals, int64_t inner, const double *cap, const double *weight,
                    int64_t accelerations, const double *acceleration, const double *steady, int64_t rows,
                    const double *jerk, const double *jerky, const double *bounds, double inside, double least,
                    double centring, const float *duals, double *z, float *pairs, double *totals) {
    const Problem problem = problem_of(h, intervals, inner, cap, weight, accelerations, acceleration, steady, rows, jerk,
                                       jerky, bounds);
    const Knots knots = knots_of(z, intervals);
    Used used = {0.0, 0.0, 0.0};
    Motion motion;
    for (int64_t block = 0; block < problem.blocks; block++) {
        motion_of(&problem, block, &knots, &motion);
        interior_used(&problem, block, &motion, pairs, &used);
    }
    /* x, a and c times k: accelerations grow with k, jerks with k^(3/2) */
    const double scale = inside > 0.0 ? inside / larger(used.steady, pow(used.jerk, 2.0 / 3.0)) : 1.0;
    for (int64_t i = 0; i < 3 * (intervals + 1); i++) z[i] *= scale;
    const double time = used.time / sqrt(scale);
    const double product = centring * time / (double)(problem.sides * problem.points);
    Totals total = {0.0, 0.0, 0.0};
    for (int64_t block = 0; block < problem.blocks; block++) {
        motion_of(&problem, block, &knots, &motion);
        interior_place(&problem, block, &motion, least, product, duals, pairs, &total);
    }
    totals[0] = total.gap;
    totals[1] = total.time;
    totals[2] = total.residual;
    totals[3] = 0.0;
}

/* ---- the ends ------------------------------------------------------------------------------------------------------- */

/* What the equations at the last knot are off by, if the state changes by this step. */
static void off(const Problem *problem, const Knots *step, double out[3]) {
    const int64_t n = problem->intervals;
    out[0] = step->x[n];
    if (problem->priced == 3) {
        out[0] -= step->x[0];
        out[1] = step->a[n] - step->a[0];
        out[2] = step->c[n] - step->c[0];
    }
}

/* Responses of the Newton system to a unit price on each equation. */
static void respond(const Problem *problem, State *state) {
    for (int64_t k = 0; k < problem->priced; k++) {
        double last[3] = {0.0, 0.0, 0.0}, first[3];
        last[k] = 1.0;
        interior_back_from(problem, state, last, first);
        if (problem->priced == 3) first[k] -= 1.0;
        interior_forth(problem, state, first, state->response[k]);
    }
}

/* Solve a system of at most three equations, columns and right side given, by elimination with the largest pivot. */
static void solve_small(int64_t n, double columns[3][3], double right[3]) {
    for (int64_t k = 0; k < n; k++) {
        int64_t best = k;
        for (int64_t i = k + 1; i < n; i++)
            if (fabs(columns[k][i]) > fabs(columns[k][best])) best = i;
        for (int64_t j = 0; j < n; j++) {
            const double swapped = columns[j][k];
            columns[j][k] = columns[j][best];
            columns[j][best] = swapped;
        }
        const double swapped = right[k];
        right[k] = right[best];
        right[best] = swapped;
        for (int64_t i = k + 1; i < n; i++) {
            const double factor = columns[k][i] / columns[k][k];
            for (int64_t j = k; j < n; j++) columns[j][i] -= factor * columns[j][k];
            right[i] -= factor * right[k];
        }
    }
    for (int64_t k = n - 1; k >= 0; k--) {
        for (int64_t j = k + 1; j < n; j++) right[k] -= columns[j][k] * right[j];
        right[k] /= columns[k][k];
    }
}

/* Price the equations at the last knot so that a step keeps them. */
static void keep_ends(const Problem *problem, const State *state, Knots step) {
    const int64_t priced = problem->priced, size = problem->intervals + 1;
    if (!priced) return;
    double columns[3][3], price[3];
    for (int64_t k = 0; k < priced; k++) off(problem, &state->response[k], columns[k]);
    off(problem, &step, price);
    solve_small(priced, columns, price);
    for (int64_t k = 0; k < priced; k++) {
        const Knots response = state->response[k];
        for (int64_t i = 0; i < size; i++) {
            step.x[i] -= price[k] * response.x[i];
            step.a[i] -= price[k] * response.a[i];
            step.c[i] -= price[k] * response.c[i];
        }
    }
}

/* ---- one iteration -------------------------------------------------------------------------------------------------- */

/* Measure the affine step, and gather the gradients of the corrector. */
static Affine measure_affine(const Problem *problem, State *state) {
    Affine affine = {INFINITY, -INFINITY, 0.0, 0.0, 0.0};
    Motion z, step, ahead;
    Pulls pulls;
    for (int64_t block = 0; block < problem->blocks; block++) {
        motion_of(problem, block, &state->z, &z);
        interior_between(problem, block, &state->affine, &step);
        interior_ahead(&z, &step, points_in(problem, block), &ahead);
        interior_affine(problem, block, &z, &ahead, state->pairs, &pulls, &affine);
        interior_gather_pulls(problem, block, &pulls, state->pulls);
    }
    return affine;
}

static Decrease measure_step(const Problem *problem, const State *state, const Stride *stride) {
    Decrease worst = {0.0, 0.0, 0.0};
    Motion z, step, hoped, ahead;
    for (int64_t block = 0; block < problem->blocks; block++) {
        const int64_t count = points_in(problem, block);
        motion_of(problem, block, &state->z, &z);
        interior_between(problem, block, &state->affine, &step);
        interior_ahead(&z, &step, count, &hoped);
        interior_between(problem, block, &state->step, &step);
        interior_ahead(&z, &step, count, &ahead);
        interior_decrease(problem, block, &z, &hoped, &ahead, state->pairs, stride, &worst);
    }
    return worst;
}

/* Take the step at the knots of a block. */
static void move_knots(const Problem *problem, int64_t block, State *state, double length) {
    const int64_t first = first_interval(problem, block);
    const int64_t end = block + 1 < problem->blocks ? first_interval(problem, block + 1) : problem->intervals + 1;
    for (int64_t k = first; k < end; k++) {
        state->z.x[k] += length * state->step.x[k];
        state->z.a[k] += length * state->step.a[k];
        state->z.c[k] += length * state->step.c[k];
    }
}

/* Add a block to the Newton system; 0 where a pivot is not positive. */
static int factor_block(const Problem *problem, int64_t block, const Condensed *sums, State *state, CostToGo *cost) {
    Gathered gathered;
    if (block == problem->blocks - 1) {
        const int64_t last = points_in(problem, block) - 1;
        for (int k = 0; k < 6; k++) cost->h[k] = sums->hessian[k][last];
        for (int k = 0; k < 3; k++) cost->g[k] = sums->gradient[k][last];
    }
    interior_gather(problem, block, sums, &gathered);
    return interior_factor(problem, block, &gathered, state, cost);
}

static void keep_root(State *state, const CostToGo *cost) {
    for (int k = 0; k < 6; k++) state->root[k] = cost->h[k];
    for (int k = 0; k < 3; k++) state->root[6 + k] = cost->g[k];
}

/* Build and factor the Newton system; 0 where it is not positive definite. */
static int factor(const Problem *problem, State *state, int clip) {
    Motion z;
    Condensed sums;
    CostToGo cost;
    for (int64_t block = problem->blocks - 1; block >= 0; block--) {
        motion_of(problem, block, &state->z, &z);
        interior_condense(problem, block, &z, clip, state->pairs, &sums);
        if (!factor_block(problem, block, &sums, state, &cost)) return 0;
    }
    keep_root(state, &cost);
    return 1;
}

/* Take a step; with ``and_factor`` also build and factor the next Newton system.  Whether that has succeeded. */
static int advance(const Problem *problem, State *state, const Stride *stride, int and_factor, Totals *totals) {
    Motion z, step, hoped, ahead, arrived;
    Condensed sums;
    CostToGo cost;
    int factored = and_factor;
    for (int64_t block = problem->blocks - 1; block >= 0; block--) {
        const int64_t count = points_in(problem, block);
        motion_of(problem, block, &state->z, &z);
        interior_between(problem, block, &state->affine, &step);
        interior_ahead(&z, &step, count, &hoped);
        interior_between(problem, block, &state->step, &step);
        interior_ahead(&z, &step, count, &ahead);
        interior_arrive(&z, &step, count, stride->primal, &arrived);
        /* the block after, whose first knot this one still had to see as it was */
        if (block + 1 < problem->blocks) move_knots(problem, block + 1, state, stride->primal);
        interior_advance(problem, block, &hoped, &ahead, &arrived, stride, state->pairs, totals, factored ? &sums : NULL);
        factored = factored && factor_block(problem, block, &sums, state, &cost);
    }
    move_knots(problem, 0, state, stride->primal);
    if (factored) keep_root(state, &cost);
    return factored;
}

/* Step length at which the given largest relative decrease becomes ``fraction``, 1 at most. */
static double length_of(double decrease, double fraction) { return decrease > fraction ? fraction / decrease : 1.0; }

/* The affine step, and by it what the corrected one aims at. */
static Stride predict(const Problem *problem, State *state, const Totals *totals, double hope) {
    interior_forth(problem, state, state->root + 6, state->affine);
    respond(problem, state);
    keep_ends(problem, state, state->affine);
    const Affine affine = measure_affine(problem, state);
    const double primal = length_of(-affine.least, 1.0), dual = length_of(1.0 + affine.most, 1.0);
    /* s dl = -l (s + ds) */
    const double gap = totals->gap + primal * affine.first - dual * (totals->gap + affine.first) + primal * dual * affine.second;
    const double share = gap / totals->gap;
    hope *= totals->gap < NEAR * totals->time ? NEAR_HOPE : 1.0;
    const double centring = larger(larger(share * share * share, hope * affine.hope / totals->gap), LEAST_CENTRING);
    return (Stride){.target = smaller(centring, 1.0) * totals->gap / (double)(problem->sides * problem->points),
                    .corrector = sqrt(primal * dual)};
}

/* The corrected step, and how far it may go. */
static void correct(const Problem *problem, State *state, const Totals *totals, Stride *stride) {
    double first[3];
    interior_back(problem, state, stride->target, stride->corrector, first);
    interior_forth(problem, state, first, state->step);
    keep_ends(problem, state, state->step);
    for (int64_t k = 0; k <= problem->intervals; k++) {
        state->step.x[k] += state->affine.x[k];
        state->step.a[k] += state->affine.a[k];
        state->step.c[k] += state->affine.c[k];
    }
    const Decrease worst = measure_step(problem, state, stride);
    const double fraction = smaller(larger(1.0 - totals->gap / totals->time, LEAST_FRACTION), MOST_FRACTION);
    stride->primal = smaller(length_of(worst.slack, fraction), length_of(worst.x, MOST_FALL));
    stride->dual = length_of(worst.dual, fraction);
}

/* What is not finite at one knot reaches the last one. */
static int is_finite(const Problem *problem, const State *state, const Stride *stride) {
    const int64_t n = problem->intervals;
    return isfinite(state->step.x[n]) && isfinite(state->step.a[n]) && isfinite(state->step.c[n]) &&
           isfinite(stride->target) && isfinite(stride->dual);
}

int64_t interior_work(int64_t intervals, int64_t priced) {
    return 5 * intervals + (11 + 3 * priced) * (intervals + 1) + 9;
}

static State state_of(const Problem *problem, double *z, float *pairs, double *work) {
    const int64_t n = problem->intervals, row = 3 * (n + 1);
    State state = {.z = knots_of(z, n), .pairs = pairs, .gains = work, .forward = work + 4 * n};
    work += 5 * n;
    state.affine = knots_of(work, n);
    state.pulls = work + row;
    state.step = knots_of(state.pulls, n); /* the gradients have served when the step is made of them */
    work += 11 * (n + 1);
    for (int64_t k = 0; k < problem->priced; k++, work += row) state.response[k] = knots_of(work, n);
    state.root = work;
    return state;
}

int64_t interior_run(const double *h, int64_t intervals, int64_t inner, const double *cap, const double *weight,
                     int64_t accelerations, const double *acceleration, const double *steady, int64_t rows,
                     const double *jerk, const double *jerky, const double *bounds, int64_t fixed, int64_t priced,
                     double hope, double tolerance, double feasible, int64_t most, double *z, float *pairs, double *work,
                     double *totals, int64_t *count) {
    Problem problem = problem_of(h, intervals, inner, cap, weight, accelerations, acceleration, steady, rows, jerk, jerky,
                                 bounds);
    problem.fixed = fixed;
    problem.priced = priced;
    State state = state_of(&problem, z, pairs, work);
    Totals total = {totals[0], totals[1], totals[2]};
    int factored = totals[3] > 0.0;
    int64_t status = RUNNING;
    for (int64_t i = 0; i < most && status == RUNNING; i++, (*count)++) {
        if (!factored && !factor(&problem, &state, 0) && !factor(&problem, &state, 1)) {
            status = SINGULAR;
            break;
        }
        Stride stride = predict(&problem, &state, &total, hope);
        correct(&problem, &state, &total, &stride);
        factored = 1;
        if (!is_finite(&problem, &state, &stride) || !(stride.primal > NO_STEP)) {
            status = STUCK;
            break;
        }
        /* after what is likely the last step there is no next system */
        const int last = stride.target * (double)(problem.sides * problem.points) < tolerance * total.time;
        total = (Totals){0.0, 0.0, 0.0};
        factored = advance(&problem, &state, &stride, !last, &total);
        if (total.gap < tolerance * total.time && total.residual < feasible) status = DONE;
    }
    totals[0] = total.gap;
    totals[1] = total.time;
    totals[2] = total.residual;
    totals[3] = (double)factored;
    return status;
}

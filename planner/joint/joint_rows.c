/* The inequalities g <= 0 of a stage: values, change with a step, and their part of the Newton system.

   A row is about one derivative (its order) of the position at one of the points of a segment, and the duration T of its phase,
   c = T^3, g = c / scale^3:
       distance   near |p - foot|^2 - 1,   or near |p - vertex|^2 - 1 where a leg ends
       feed       pace |V|^2 / scale^2 - g^(2/3)
       axes       +-V_k / (V_k max scale) - g^(1/3),  +-A_k / (A_k max scale^2) - g^(2/3),  +-U_k / (J_k max scale^3) - g
       bend       |A|^2 / (bend^2 scale^4 g) - g^(1/3)
   All are convex.  Accelerations are linear on a segment, so that their rows stand at nodes alone.  The row of a switch keeps the
   next duration from 0. */
#include "joint_inline.h"

/* Gradient: scale times the vector (scale in the axis, if it is not -1), and by_c.  Hessian: hessian times curve (the identity, if
   NULL), mixed times the vector with c, and bend_c. */
typedef struct {
    int point, order, axis;
    double scale, value, by_c;
    const double *vector;
    double hessian;
    const double *curve;
    double mixed, bend_c;
} Row;

/* What the rows of a segment are made from: the motion at its points, g and its roots, and the rows. */
typedef struct {
    double scale, cube, g, root;
    double w[POINTS];
    double y[POINTS][4 * MOST_AXES];
    int64_t count;
    Row rows[MOST_ROWS];
} Rows;

INLINE double squared(int d, const double *a) {
    double sum = 0.0;
    for (int k = 0; k < d; k++) sum += a[k] * a[k];
    return sum;
}

/* g to the power order / 3, and two derivatives by c. */
typedef struct {
    double value, once, twice;
} Power;

INLINE Power power_of(const Rows *rows, int order) {
    const double e = order / 3.0, value = order == 1 ? rows->root : order == 2 ? square(rows->root) : rows->g;
    const double per_c = 1.0 / (rows->g * rows->cube);
    return (Power){value, e * value * per_c, e * (e - 1.0) * value * per_c * per_c};
}

INLINE void add_axes(int d, int point, int order, const double *limits, Rows *rows) {
    const double *const y = rows->y[point] + order * d;
    const Power power = power_of(rows, order);
    const double unit = order == 1 ? rows->scale : order == 2 ? square(rows->scale) : rows->cube;
    for (int k = 0; k < d; k++) {
        if (!(limits[k] > 0.0)) continue;
        for (int sign = 1; sign >= -1; sign -= 2) {
            const double by = sign * limits[k] / unit;
            rows->rows[rows->count++] = (Row){.point = point,
                                              .order = order,
                                              .axis = k,
                                              .scale = by,
                                              .value = by * y[k] - power.value,
                                              .by_c = -power.once,
                                              .bend_c = -power.twice};
        }
    }
}

INLINE void add_feed(int d, int point, double pace, Rows *rows) {
    if (!(pace > 0.0)) return;
    const double *const y = rows->y[point] + d;
    const Power power = power_of(rows, 2);
    const double by = pace / square(rows->scale);
    rows->rows[rows->count++] = (Row){.point = point,
                                      .order = VELOCITY,
                                      .axis = -1,
                                      .scale = 2.0 * by,
                                      .value = by * squared(d, y) - power.value,
                                      .by_c = -power.once,
                                      .vector = y,
                                      .hessian = 2.0 * by,
                                      .bend_c = -power.twice};
}

INLINE void add_bend(int d, double bend, Rows *rows) {
    if (!(bend > 0.0)) return;
    const double *const y = rows->y[0] + 2 * d;
    const Power power = power_of(rows, 1);
    const double by = bend / (square(square(rows->scale)) * rows->g), per_c = 1.0 / (rows->g * rows->cube);
    const double value = by * squared(d, y);
    rows->rows[rows->count++] = (Row){.point = 0,
                                      .order = ACCELERATION,
                                      .axis = -1,
                                      .scale = 2.0 * by,
                                      .value = value - power.value,
                                      .by_c = -value * per_c - power.once,
                                      .vector = y,
                                      .hessian = 2.0 * by,
                                      .mixed = -2.0 * by * per_c,
                                      .bend_c = 2.0 * value * per_c * per_c - power.twice};
}

/* Rows of a segment; those about distances have no value yet. */
INLINE void list_rows(const Problem *problem, int d, int64_t i, const Iterate *it, Rows *rows) {
    const double *const x = it->x + i * states_of(d), *const u = it->u + i * d;
    rows->scale = problem->scale[i];
    rows->cube = rows->scale * square(rows->scale);
    rows->g = x[3 * d] / rows->cube;
    rows->root = cbrt(rows->g);
    rows->count = 0;
    const int first = i < 2 && problem->switches[0]; /* its start is given */
    for (int q = 0; q < POINTS; q++) {
        rows->w[q] = problem->share[i] * (q / 3.0);
        joint_at(d, rows->w[q], x, u, rows->y[q]);
        if (first && q == 0) continue;
        const int64_t at = i * POINTS + q;
        const double near = 2.0 * problem->near[at];
        rows->rows[rows->count++] = (Row){.point = q,
                                          .order = POSITION,
                                          .axis = -1,
                                          .scale = near,
                                          .vector = it->off + at * d,
                                          .hessian = near,
                                          .curve = it->curve + at * d * d};
        add_feed(d, q, problem->pace[at], rows);
        add_axes(d, q, VELOCITY, problem->velocity, rows);
    }
    if (!first) {
        add_axes(d, 0, ACCELERATION, problem->acceleration, rows);
        add_bend(d, problem->bend, rows);
    }
    add_axes(d, 0, JERK, problem->jerk, rows);
}

INLINE int64_t values(const Problem *problem, int d, int64_t i, const Iterate *it) {
    double *const value = it->value + i * most_rows_of(d);
    if (problem->switches[i]) {
        const double scale = problem->scale[i];
        value[0] = (problem->least - it->u[i * d]) / (scale * scale * scale);
        return 1;
    }
    Rows rows;
    list_rows(problem, d, i, it, &rows);
    const int64_t leg = problem->leg[i], before = i < 2 ? leg : problem->leg[i - 2];
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        value[r] = row->value;
        if (row->order != POSITION) continue;
        const int64_t at = i * POINTS + row->point;
        const double *const p = rows.y[row->point];
        const int vertex = row->point == 0 && problem->switches[i - 1] && before != leg;
        value[r] = problem->near[at] * (vertex ? joint_vertex : joint_distance)(problem, leg, p, it->off + at * d,
                                                                               it->curve + at * d * d) -
                   1.0;
    }
    return rows.count;
}

INLINE void changes(const Problem *problem, int d, int64_t i, const Iterate *it, double *change) {
    const double *const dx = it->dx + i * states_of(d), *const du = it->du + i * d;
    if (problem->switches[i]) {
        const double scale = problem->scale[i];
        change[0] = -du[0] / (scale * scale * scale);
        return;
    }
    Rows rows;
    list_rows(problem, d, i, it, &rows);
    double dy[POINTS][4 * MOST_AXES];
    for (int q = 0; q < POINTS; q++) joint_at(d, rows.w[q], dx, du, dy[q]);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double *const moved = dy[row->point] + row->order * d;
        double sum = 0.0;
        if (row->axis >= 0)
            sum = moved[row->axis];
        else
            for (int k = 0; k < d; k++) sum += row->vector[k] * moved[k];
        change[r] = row->scale * sum + row->by_c * dx[3 * d];
    }
}

/* Sums over the rows about one derivative at one point: gradient and Hessian over it, and with c. */
typedef struct {
    double hessian[MOST_AXES * MOST_AXES], gradient[MOST_AXES], mixed[MOST_AXES];
} Sums;

INLINE void add_row(int d, const Row *row, double weight, double push, double dual, Sums *sums) {
    double *restrict const h = sums->hessian;
    const double mixed = weight * row->by_c * row->scale + dual * row->mixed;
    if (row->axis >= 0) {
        const int k = row->axis;
        h[k * d + k] += weight * row->scale * row->scale;
        sums->gradient[k] += push * row->scale;
        sums->mixed[k] += mixed;
        return;
    }
    const double both = weight * row->scale * row->scale, bent = dual * row->hessian;
    for (int k = 0; k < d; k++) {
        const double g = row->vector[k];
        sums->gradient[k] += push * row->scale * g;
        sums->mixed[k] += mixed * g;
        for (int m = 0; m < d; m++) h[k * d + m] += both * g * row->vector[m];
        if (row->curve)
            for (int m = 0; m < d; m++) h[k * d + m] += bent * row->curve[k * d + m];
        else
            h[k * d + k] += bent;
    }
}

/* Carry sums about the derivative ``order`` at the share w over to state and control: it is c_0 y_order + c_1 y_order+1 + .. of
   the start, c_m = w^m / m!, and itself alone at w = 0. */
INLINE void carry(int d, int order, double w, int most, const Sums *sums, double *restrict hessian,
                  double *restrict gradient) {
    const int all = all_of(d), begin[4] = {0, d, 2 * d, 3 * d + 1}, c = 3 * d;
    const double share[4] = {1.0, w, 0.5 * w * w, w * w * w / 6.0};
    for (int m = order; m <= most; m++) {
        for (int n = m; n <= most; n++) {
            const double both = share[m - order] * share[n - order];
            for (int k = 0; k < d; k++)
                for (int l = 0; l < d; l++) hessian[(begin[m] + k) * all + begin[n] + l] += both * sums->hessian[k * d + l];
        }
        for (int k = 0; k < d; k++) {
            const int at = begin[m] + k;
            gradient[at] += share[m - order] * sums->gradient[k];
            if (order > POSITION) hessian[at < c ? at * all + c : c * all + at] += share[m - order] * sums->mixed[k];
        }
    }
}

INLINE void condense(const Problem *problem, int d, int64_t i, const Iterate *it, double mu, double *restrict hessian,
                     double *restrict gradient) {
    const int64_t first = i * most_rows_of(d);
    const double *const slack = it->slack + first, *const dual = it->dual + first, *const value = it->value + first;
    const int all = all_of(d), c = 3 * d;
    if (problem->switches[i]) {
        const double by = -1.0 / (problem->scale[i] * square(problem->scale[i]));
        hessian[(c + 1) * (all + 1)] += dual[0] / slack[0] * by * by;
        gradient[c + 1] += by * (mu + dual[0] * (value[0] + slack[0])) / slack[0];
        return;
    }
    Rows rows;
    Sums sums[POINTS + 2][2];
    list_rows(problem, d, i, it, &rows);
    memset(sums, 0, sizeof sums);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double weight = dual[r] / slack[r], push = (mu + dual[r] * (value[r] + slack[r])) / slack[r];
        Sums *const to = row->order < ACCELERATION ? &sums[row->point][row->order] : &sums[POINTS][row->order - 2];
        add_row(d, row, weight, push, dual[r], to);
        gradient[c] += push * row->by_c;
        hessian[c * (all + 1)] += weight * row->by_c * row->by_c + dual[r] * row->bend_c;
    }
    for (int q = 0; q < POINTS; q++)
        for (int order = POSITION; order <= VELOCITY; order++)
            carry(d, order, rows.w[q], q ? JERK : order, &sums[q][order], hessian, gradient);
    carry(d, ACCELERATION, 0.0, ACCELERATION, &sums[POINTS][0], hessian, gradient);
    carry(d, JERK, 0.0, JERK, &sums[POINTS][1], hessian, gradient);
}

HOT int64_t joint_values(const Problem *problem, int64_t i, const Iterate *it) {
    switch (problem->d) {
    case 2: return values(problem, 2, i, it);
    case 3: return values(problem, 3, i, it);
    default: return values(problem, (int)problem->d, i, it);
    }
}

HOT void joint_changes(const Problem *problem, int64_t i, const Iterate *it, double *change) {
    switch (problem->d) {
    case 2: changes(problem, 2, i, it, change); break;
    case 3: changes(problem, 3, i, it, change); break;
    default: changes(problem, (int)problem->d, i, it, change);
    }
}

HOT void joint_condense(const Problem *problem, int64_t i, const Iterate *it, double mu, double *hessian, double *gradient) {
    switch (problem->d) {
    case 2: condense(problem, 2, i, it, mu, hessian, gradient); break;
    case 3: condense(problem, 3, i, it, mu, hessian, gradient); break;
    default: condense(problem, (int)problem->d, i, it, mu, hessian, gradient);
    }
}

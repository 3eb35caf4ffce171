/* The inequalities g <= 0 of a stage: values, change with a step, and their part of the Newton system.

   A row is about one derivative (its order) of the position at one of the points of a segment:
       distance   near |p - foot|^2 - 1,   or near |p - vertex|^2 - 1 where a leg ends
       feed       pace |v|^2 - 1            bend   |a|^2 / bend^2 - 1
       axes       +-v_k / V_k - 1,  +-a_k / A_k - 1 (at nodes: the acceleration is linear between),  +-j_k / J_k - 1
   and one row more keeps the duration of a phase from 0. */
#include "joint_inline.h"

typedef struct {
    int point, order, axis; /* axis -1: along the vector */
    double scale, value;    /* gradient: scale times the vector, or scale in the axis */
    const double *vector;
    double hessian; /* times the identity, or times curve */
    const double *curve;
} Row;

/* What the rows of a stage are made from: the motion at its points, and the rows. */
typedef struct {
    int duration; /* where it stands */
    double rate[POINTS], length[POINTS];
    double y[POINTS][4 * MOST_AXES];
    int64_t count;
    Row rows[MOST_ROWS];
} Rows;

INLINE double squared(int d, const double *a) {
    double sum = 0.0;
    for (int k = 0; k < d; k++) sum += a[k] * a[k];
    return sum;
}

INLINE void add_axes(int d, int point, int order, const double *limits, Rows *rows) {
    const double *const y = rows->y[point] + order * d;
    for (int k = 0; k < d; k++)
        if (limits[k] > 0.0)
            for (int sign = 1; sign >= -1; sign -= 2)
                rows->rows[rows->count++] =
                    (Row){point, order, k, sign * limits[k], sign * limits[k] * y[k] - 1.0, NULL, 0.0, NULL};
}

INLINE void add_squares(int d, int point, int order, double scale, Rows *rows) {
    const double *const y = rows->y[point] + order * d;
    if (scale > 0.0)
        rows->rows[rows->count++] =
            (Row){point, order, -1, 2.0 * scale, scale * squared(d, y) - 1.0, y, 2.0 * scale, NULL};
}

INLINE void add_distance(int point, double scale, const double *off, const double *curve, Rows *rows) {
    rows->rows[rows->count++] = (Row){point, POSITION, -1, 2.0 * scale, 0.0, off, 2.0 * scale, curve};
}

INLINE void list_rows(const Problem *problem, int d, int64_t i, const Iterate *it, Rows *rows) {
    const int begins = problem->begins[i];
    const double *const x = it->x + i * states_of(d), *const u = it->u + i * (d + 1);
    const double duration = duration_of(d, begins, x, u);
    rows->duration = duration_at(d, begins);
    rows->count = 0;
    for (int q = 0; q < POINTS; q++) {
        rows->rate[q] = problem->share[i] * (q / 3.0);
        rows->length[q] = rows->rate[q] * duration;
        joint_at(d, rows->length[q], x, u, rows->y[q]);
        if (i == 0 && q == 0) continue;
        const int64_t at = i * POINTS + q;
        add_distance(q, problem->near[at], it->off + at * d, it->curve + at * d * d, rows);
        add_squares(d, q, VELOCITY, problem->pace[at], rows);
        add_axes(d, q, VELOCITY, problem->velocity, rows);
    }
    if (i > 0) {
        add_axes(d, 0, ACCELERATION, problem->acceleration, rows);
        add_squares(d, 0, ACCELERATION, problem->bend, rows);
    }
    add_axes(d, 0, JERK, problem->jerk, rows);
}

INLINE int64_t values(const Problem *problem, int d, int64_t i, const Iterate *it) {
    Rows rows;
    list_rows(problem, d, i, it, &rows);
    double *const value = it->value + i * most_rows_of(d);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        value[r] = row->value;
        if (row->order != POSITION) continue;
        const int64_t at = i * POINTS + row->point, leg = problem->leg[i];
        const double *const p = rows.y[row->point];
        double *const off = it->off + at * d, *const curve = it->curve + at * d * d;
        const int vertex = row->point == 0 && i > 0 && problem->leg[i - 1] != leg;
        value[r] = problem->near[at] * (vertex ? joint_vertex : joint_distance)(problem, leg, p, off, curve) - 1.0;
    }
    if (!problem->begins[i]) return rows.count;
    value[rows.count] = problem->shortest - it->u[i * (d + 1) + d];
    return rows.count + 1;
}

INLINE void changes(const Problem *problem, int d, int64_t i, const Iterate *it, double *change) {
    Rows rows;
    list_rows(problem, d, i, it, &rows);
    const double *const dx = it->dx + i * states_of(d), *const du = it->du + i * (d + 1);
    const double dduration = duration_of(d, problem->begins[i], dx, du);
    double dy[POINTS][4 * MOST_AXES];
    for (int q = 0; q < POINTS; q++) {
        joint_at(d, rows.length[q], dx, du, dy[q]);
        for (int k = 0; k < 3 * d; k++) dy[q][k] += rows.rate[q] * dduration * rows.y[q][d + k];
    }
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double *const moved = dy[row->point] + row->order * d;
        double sum = 0.0;
        if (row->axis >= 0)
            sum = moved[row->axis];
        else
            for (int k = 0; k < d; k++) sum += row->vector[k] * moved[k];
        change[r] = row->scale * sum;
    }
    if (problem->begins[i]) change[rows.count] = -dduration;
}

/* Sums over the rows about one derivative at one point: Hessian, gradient of the barrier, and sum of dual times gradient. */
typedef struct {
    double hessian[MOST_AXES * MOST_AXES], gradient[MOST_AXES], pull[MOST_AXES];
} Sums;

INLINE void add_row(int d, const Row *row, double weight, double push, double dual, Sums *sums) {
    double *restrict const h = sums->hessian;
    if (row->axis >= 0) {
        const int k = row->axis;
        h[k * d + k] += weight * row->scale * row->scale;
        sums->gradient[k] += push * row->scale;
        sums->pull[k] += dual * row->scale;
        return;
    }
    const double both = weight * row->scale * row->scale, bent = dual * row->hessian;
    for (int k = 0; k < d; k++) {
        const double g = row->vector[k];
        sums->gradient[k] += push * row->scale * g;
        sums->pull[k] += dual * row->scale * g;
        for (int m = 0; m < d; m++) h[k * d + m] += both * g * row->vector[m];
        if (row->curve)
            for (int m = 0; m < d; m++) h[k * d + m] += bent * row->curve[k * d + m];
        else
            h[k * d + k] += bent;
    }
}

/* Carry sums about the derivative ``order`` at the time h = rate * duration over to state, jerk and duration: the derivative is
   c_0 y_order + c_1 y_order+1 + .. of the start, c_m = h^m / m!, and changes by rate times the next one with the duration. */
INLINE void carry(int d, int order, double rate, double h, int duration, const double *y, double exact,
                  const Sums *sums, double *restrict hessian, double *restrict gradient) {
    const int all = 4 * d + 2, begin[4] = {0, d, 2 * d, 3 * d + 1};
    const double c[4] = {1.0, h, 0.5 * h * h, h * h * h / 6.0};
    double turned[MOST_AXES], twice = 0.0, once = 0.0;
    for (int k = 0; k < d; k++) {
        turned[k] = 0.0;
        for (int m = 0; m < d; m++) turned[k] += sums->hessian[k * d + m] * rate * y[(order + 1) * d + m];
    }
    for (int k = 0; k < d; k++) {
        twice += turned[k] * rate * y[(order + 1) * d + k] + exact * rate * rate * sums->pull[k] * y[(order + 2) * d + k];
        once += sums->gradient[k] * rate * y[(order + 1) * d + k];
    }
    for (int m = order; m < 4; m++) {
        for (int n = m; n < 4; n++) {
            const double both = c[m - order] * c[n - order];
            for (int k = 0; k < d; k++)
                for (int l = 0; l < d; l++)
                    hessian[(begin[m] + k) * all + begin[n] + l] += both * sums->hessian[k * d + l];
        }
        const double slope = m > order ? exact * rate * c[m - order - 1] : 0.0;
        for (int k = 0; k < d; k++) {
            const double mixed = c[m - order] * turned[k] + slope * sums->pull[k];
            const int at = begin[m] + k;
            hessian[at < duration ? at * all + duration : duration * all + at] += mixed;
            gradient[at] += c[m - order] * sums->gradient[k];
        }
    }
    hessian[duration * all + duration] += twice;
    gradient[duration] += once;
}

INLINE void condense(const Problem *problem, int d, int64_t i, const Iterate *it, double mu, double exact,
                     double *restrict hessian, double *restrict gradient) {
    Rows rows;
    Sums sums[POINTS + 2][2];
    list_rows(problem, d, i, it, &rows);
    const int64_t first = i * most_rows_of(d);
    const double *const slack = it->slack + first, *const dual = it->dual + first, *const value = it->value + first;
    const int all = 4 * d + 2;
    memset(sums, 0, sizeof sums);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double weight = dual[r] / slack[r], push = (mu + dual[r] * (value[r] + slack[r])) / slack[r];
        Sums *const to = row->order < ACCELERATION ? &sums[row->point][row->order] : &sums[POINTS][row->order - 2];
        add_row(d, row, weight, push, dual[r], to);
    }
    for (int q = 0; q < POINTS; q++)
        for (int order = POSITION; order <= VELOCITY; order++)
            if (i > 0 || q > 0)
                carry(d, order, rows.rate[q], rows.length[q], rows.duration, rows.y[q], exact, &sums[q][order], hessian,
                      gradient);
    for (int order = ACCELERATION; order <= JERK; order++) {
        const int at = order == JERK ? 3 * d + 1 : 2 * d;
        const Sums *const from = &sums[POINTS][order - 2];
        for (int k = 0; k < d; k++) {
            gradient[at + k] += from->gradient[k];
            for (int m = 0; m < d; m++) hessian[(at + k) * all + at + m] += from->hessian[k * d + m];
        }
    }
    if (!problem->begins[i]) return;
    const int64_t r = rows.count;
    hessian[rows.duration * (all + 1)] += dual[r] / slack[r];
    gradient[rows.duration] -= (mu + dual[r] * (value[r] + slack[r])) / slack[r];
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

HOT void joint_condense(const Problem *problem, int64_t i, const Iterate *it, double mu, double exact, double *hessian,
                        double *gradient) {
    switch (problem->d) {
    case 2: condense(problem, 2, i, it, mu, exact, hessian, gradient); break;
    case 3: condense(problem, 3, i, it, mu, exact, hessian, gradient); break;
    default: condense(problem, (int)problem->d, i, it, mu, exact, hessian, gradient);
    }
}

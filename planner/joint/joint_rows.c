/* The inequalities g <= 0 of a stage: values, change with a step, and their part of the Newton system.

   A row is about a *place*: a control point of the position or one of its derivatives (the order) on a segment, which is linear in
   state and control.  With the duration T of the phase, c = T^3 and g = c / scale^3:
       distance   near |p - foot|^2 - 1,   or near |p - vertex|^2 - 1 where a leg ends
       feed       pace |V|^2 / scale^2 - g^(2/3)
       axes       +-V_k / (V_k max scale) - g^(1/3),  +-A_k / (A_k max scale^2) - g^(2/3),  +-U_k / (J_k max scale^3) - g
       bend       |A|^2 / (bend^2 scale^4 g) - g^(1/3)
   All are convex.  Accelerations are linear on a segment, so that their rows stand at nodes alone.  The row of a switch keeps the
   next duration from 0. */
#include "joint.h"
#include "joint_inline.h"

/* Gradient: scale times the vector (scale in the axis, if it is not -1), and by_c.  Hessian: hessian times curve (the identity, if
   NULL), mixed times the vector with c, and bend_c. */
typedef struct {
    int place, axis;
    double scale, value, by_c;
    const double *vector;
    double hessian;
    const double *curve;
    double mixed, bend_c;
} Row;

/* A place: c_order y_order + c_order+1 y_order+1 + .. c_most y_most of position, V, A and U. */
typedef struct {
    int order, most;
    double c[4];
} Place;

/* What the rows of a segment are made from: its places and the motion there, g and its roots; and the rows. */
typedef struct {
    double scale, cube, g, root;
    Place places[PLACES];
    double y[PLACES][MOST_AXES];
    int64_t count;
    Row rows[MOST_ROWS];
} Rows;

/* The derivative of an order at the share w of a phase after the node, and by times the next one. */
INLINE Place place_of(int order, double w, double by) {
    const double power[4] = {1.0, w, 0.5 * w * w, w * w * w / 6.0};
    Place place = {.order = order, .most = JERK};
    for (int m = order; m < 4; m++) place.c[m] = power[m - order] + (m > order ? by * power[m - order - 1] : 0.0);
    return place;
}

/* The places of a segment that has a share of the phase.  Those of the position are points of the path along a bent leg, whose tube
   is not convex. */
INLINE void list_places(double share, int bent, Place *places) {
    const double width = share / PARTS;
    for (int order = POSITION; order < 4; order++) {
        Place *const node = places + (order == 0 ? 0 : order == 1 ? POINTS : PLACES - 4 + order);
        *node = (Place){.order = order, .most = order};
        node->c[order] = 1.0;
    }
    for (int part = 0; part < PARTS; part++) {
        places[1 + 2 * part] = place_of(POSITION, part * width, width / 3.0);
        places[2 + 2 * part] = place_of(POSITION, (part + 1) * width, -width / 3.0);
        for (int q = 1; bent && q < 3; q++)
            places[q + 2 * part] = place_of(POSITION, share * (q + 2 * part) / POINTS, 0.0);
        places[POINTS + 1 + part] = place_of(VELOCITY, part * width, 0.5 * width);
    }
}

/* A place of a motion, or of its change. */
INLINE void at_place(int d, const Place *place, const double *restrict x, const double *restrict u, double *restrict y) {
    for (int k = 0; k < d; k++) y[k] = 0.0;
    for (int m = place->order; m <= place->most; m++) {
        const double *const from = m < JERK ? x + m * d : u;
        for (int k = 0; k < d; k++) y[k] += place->c[m] * from[k];
    }
}

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

INLINE void add_axes(int d, int place, const double *limits, Rows *rows) {
    const int order = rows->places[place].order;
    const double *const y = rows->y[place];
    const Power power = power_of(rows, order);
    const double unit = order == 1 ? rows->scale : order == 2 ? square(rows->scale) : rows->cube;
    for (int k = 0; k < d; k++) {
        if (!(limits[k] > 0.0)) continue;
        for (int sign = 1; sign >= -1; sign -= 2) {
            const double by = sign * limits[k] / unit;
            rows->rows[rows->count++] = (Row){.place = place,
                                              .axis = k,
                                              .scale = by,
                                              .value = by * y[k] - power.value,
                                              .by_c = -power.once,
                                              .bend_c = -power.twice};
        }
    }
}

INLINE void add_feed(int d, int place, double pace, Rows *rows) {
    if (!(pace > 0.0)) return;
    const double *const y = rows->y[place];
    const Power power = power_of(rows, 2);
    const double by = pace / square(rows->scale);
    rows->rows[rows->count++] = (Row){.place = place,
                                      .axis = -1,
                                      .scale = 2.0 * by,
                                      .value = by * squared(d, y) - power.value,
                                      .by_c = -power.once,
                                      .vector = y,
                                      .hessian = 2.0 * by,
                                      .bend_c = -power.twice};
}

INLINE void add_bend(int d, int place, double bend, Rows *rows) {
    if (!(bend > 0.0)) return;
    const double *const y = rows->y[place];
    const Power power = power_of(rows, 1);
    const double by = bend / (square(square(rows->scale)) * rows->g), per_c = 1.0 / (rows->g * rows->cube);
    const double value = by * squared(d, y);
    rows->rows[rows->count++] = (Row){.place = place,
                                      .axis = -1,
                                      .scale = 2.0 * by,
                                      .value = value - power.value,
                                      .by_c = -value * per_c - power.once,
                                      .vector = y,
                                      .hessian = 2.0 * by,
                                      .mixed = -2.0 * by * per_c,
                                      .bend_c = 2.0 * value * per_c * per_c - power.twice};
}

/* Whether the node before a stage is given, so that it has no rows: the first stage is a switch, the second its first segment. */
INLINE int is_given(int64_t i) { return i < 2; }

/* Rows of a segment; those about distances, which are the first, have no value yet. */
INLINE void list_rows(const Problem *problem, int d, int64_t i, const Iterate *it, Rows *rows) {
    const double *const x = it->x + i * states_of(d), *const u = it->u + i * d;
    const double *const near = problem->near + 2 * i, *const pace = problem->pace + 2 * i;
    rows->scale = problem->scale[i];
    rows->cube = rows->scale * square(rows->scale);
    rows->g = x[3 * d] / rows->cube;
    rows->root = cbrt(rows->g);
    rows->count = 0;
    list_places(problem->share[i], problem->rates[2 * problem->leg[i]] != 0.0, rows->places);
    for (int place = 0; place < PLACES; place++) at_place(d, &rows->places[place], x, u, rows->y[place]);
    for (int q = is_given(i); q < POINTS; q++) {
        const int64_t at = i * POINTS + q;
        rows->rows[rows->count++] = (Row){.place = q,
                                          .axis = -1,
                                          .scale = 2.0 * near[q > 0],
                                          .vector = it->off + at * d,
                                          .hessian = 2.0 * near[q > 0],
                                          .curve = it->curve + at * d * d};
    }
    for (int q = is_given(i); q <= PARTS; q++) {
        add_feed(d, POINTS + q, pace[q > 0], rows);
        add_axes(d, POINTS + q, problem->velocity, rows);
    }
    if (!is_given(i)) {
        add_axes(d, PLACES - 2, problem->acceleration, rows);
        add_bend(d, PLACES - 2, problem->bend, rows);
    }
    add_axes(d, PLACES - 1, problem->jerk, rows);
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
    const int64_t leg = problem->leg[i];
    const int corner = i > 1 && problem->switches[i - 1] && problem->leg[i - 2] != leg;
    for (int64_t r = 0; r < rows.count; r++) value[r] = rows.rows[r].value;
    for (int q = is_given(i); q < POINTS; q++) {
        const int64_t at = i * POINTS + q;
        double *const off = it->off + at * d, *const curve = it->curve + at * d * d;
        const double distance = (corner && q == 0 ? joint_vertex : joint_distance)(problem, leg, rows.y[q], off, curve);
        value[q - is_given(i)] = problem->near[2 * i + (q > 0)] * distance - 1.0;
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
    double dy[PLACES][MOST_AXES];
    for (int place = 0; place < PLACES; place++) at_place(d, &rows.places[place], dx, du, dy[place]);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double *const moved = dy[row->place];
        double sum = 0.0;
        if (row->axis >= 0)
            sum = moved[row->axis];
        else
            for (int k = 0; k < d; k++) sum += row->vector[k] * moved[k];
        change[r] = row->scale * sum + row->by_c * dx[3 * d];
    }
}

/* Sums over the rows about one place: gradient and Hessian over it, and with c. */
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

/* Carry sums about a place over to state and control. */
INLINE void carry(int d, const Place *place, const Sums *sums, double *restrict hessian, double *restrict gradient) {
    const int all = all_of(d), begin[4] = {0, d, 2 * d, 3 * d + 1}, c = 3 * d;
    for (int m = place->order; m <= place->most; m++) {
        for (int n = m; n <= place->most; n++) {
            const double both = place->c[m] * place->c[n];
            for (int k = 0; k < d; k++)
                for (int l = 0; l < d; l++) hessian[(begin[m] + k) * all + begin[n] + l] += both * sums->hessian[k * d + l];
        }
        for (int k = 0; k < d; k++) {
            const int at = begin[m] + k;
            gradient[at] += place->c[m] * sums->gradient[k];
            if (place->order > POSITION) hessian[at < c ? at * all + c : c * all + at] += place->c[m] * sums->mixed[k];
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
    Sums sums[PLACES];
    list_rows(problem, d, i, it, &rows);
    memset(sums, 0, sizeof sums);
    for (int64_t r = 0; r < rows.count; r++) {
        const Row *const row = &rows.rows[r];
        const double weight = dual[r] / slack[r], push = (mu + dual[r] * (value[r] + slack[r])) / slack[r];
        add_row(d, row, weight, push, dual[r], &sums[row->place]);
        gradient[c] += push * row->by_c;
        hessian[c * (all + 1)] += weight * row->by_c * row->by_c + dual[r] * row->bend_c;
    }
    for (int place = 0; place < PLACES; place++) carry(d, &rows.places[place], &sums[place], hessian, gradient);
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

void joint_between(const int64_t *sizes, const uint8_t *switches, const double *share, const int64_t *leg,
                   const double *vectors, const double *rates, const double *lengths, const double *x, const double *u,
                   int64_t parts, double *found) {
    const Problem problem = {.d = sizes[0], .vectors = vectors, .rates = rates, .lengths = lengths};
    const int d = (int)sizes[0];
    for (int64_t i = 0; i < sizes[1]; i++) {
        double distance = 0.0, speed = 0.0, y[4 * MOST_AXES], off[MOST_AXES], curve[MOST_AXES * MOST_AXES];
        for (int64_t q = 1; q < parts && !switches[i]; q++) {
            joint_at(d, share[i] * (double)q / (double)parts, x + i * states_of(d), u + i * d, y);
            distance = larger(distance, joint_distance(&problem, leg[i], y, off, curve));
            speed = larger(speed, squared(d, y + d));
        }
        found[2 * i] = sqrt(distance);
        found[2 * i + 1] = sqrt(speed) / cbrt(x[i * states_of(d) + 3 * d]);
    }
}

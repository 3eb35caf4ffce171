/* The inequalities g <= 0 of a stage: values, change with a step, and their part of the Newton system.

   A row is about a *place*: a control point of the position or one of its derivatives (the order) on a segment, which is linear in
   state and control.  With the duration T of the phase, c = T^3 and g = c / scale^3:
       distance   near |p - foot|^2 - 1,   or near |p - vertex|^2 - 1 where a leg ends
       side       -sqrt(near) n (p - vertex), n the normal to the allowed side of a leg
       feed       pace |V|^2 / scale^2 - g^(2/3)
       axes       +-V_k / (V_k max scale) - g^(1/3),  +-A_k / (A_k max scale^2) - g^(2/3),  +-U_k / (J_k max scale^3) - g
   All are convex.  Accelerations are linear on a segment, so that their rows stand at nodes alone.  The row of a switch keeps the
   next duration from 0. */
#include "joint.h"
#include "joint_inline.h"

enum { VALUES, CHANGES, CONDENSE }; /* what is done with the rows */

/* Gradient: scale times the vector (scale in the axis, if it is not -1), and by_c.  Hessian: hessian times curve (the identity, if
   NULL), and bend_c. */
typedef struct {
    int axis;
    double scale, value, by_c;
    const double *vector;
    double hessian;
    const double *curve;
    double bend_c;
} Row;

/* A segment: its iterate and step, g and its root, 1 / c, and where its rows are. */
typedef struct {
    double scale, cube, g, root, per_c, dc;
    const double *x, *u, *dx, *du;
    const double *slack, *dual;
    double mu;
    double *value, *change, *hessian, *gradient;
    int64_t count;
} Segment;

/* A place, from order on to most: the motion there is the sum of c[m] times position, V, A and U.  Its change; and sums over the
   rows about it: gradient and Hessian over it, and with c. */
typedef struct {
    int order, most;
    double c[4], y[MOST_AXES], dy[MOST_AXES];
    double hessian[MOST_AXES * MOST_AXES], gradient[MOST_AXES], mixed[MOST_AXES];
} Place;

INLINE void motion_at(int d, const Place *place, const double *x, const double *u, double *y) {
    for (int k = 0; k < d; k++) {
        double sum = 0.0;
        for (int m = place->order; m <= place->most; m++) sum += place->c[m] * (m < JERK ? x[m * d + k] : u[k]);
        y[k] = sum;
    }
}

INLINE void open_place(int d, int task, const Segment *on, Place *place) {
    motion_at(d, place, on->x, on->u, place->y);
    if (task == CHANGES) motion_at(d, place, on->dx, on->du, place->dy);
    if (task != CONDENSE) return;
    for (int k = 0; k < d * d; k++) place->hessian[k] = 0.0;
    for (int k = 0; k < d; k++) place->gradient[k] = place->mixed[k] = 0.0;
}

/* The derivative of an order at a node. */
INLINE Place node_of(int d, int task, const Segment *on, int order) {
    Place place;
    place.order = place.most = order;
    place.c[order] = 1.0;
    open_place(d, task, on, &place);
    return place;
}

/* The derivative of an order at the share w of a phase after the node, and by times the next one. */
INLINE Place place_of(int d, int task, const Segment *on, int order, double w, double by) {
    const double power[4] = {1.0, w, 0.5 * w * w, w * w * w / 6.0};
    Place place;
    place.order = order;
    place.most = JERK;
    for (int m = order; m < 4; m++) place.c[m] = power[m - order] + (m > order ? by * power[m - order - 1] : 0.0);
    open_place(d, task, on, &place);
    return place;
}

/* The point q > 0 of the position on a segment.  Along a bent leg, whose tube is not convex, it is one of the path. */
INLINE Place point_of(int d, int task, const Segment *on, double share, int bent, int q) {
    const double width = share / PARTS;
    const int part = (q - 1) / 2;
    if (bent) return place_of(d, task, on, POSITION, share * q / POINTS, 0.0);
    if (q % 2) return place_of(d, task, on, POSITION, part * width, width / 3.0);
    return place_of(d, task, on, POSITION, (part + 1) * width, -width / 3.0);
}

INLINE double squared(int d, const double *a) {
    double sum = 0.0;
    for (int k = 0; k < d; k++) sum += a[k] * a[k];
    return sum;
}

INLINE void add_to_sums(int d, const Row *row, double weight, double push, double dual, Place *place) {
    double *const h = place->hessian;
    const double by = weight * row->scale, mixed = by * row->by_c;
    if (row->axis >= 0) {
        const int k = row->axis;
        h[k * d + k] += by * row->scale;
        place->gradient[k] += push * row->scale;
        place->mixed[k] += mixed;
        return;
    }
    const double both = by * row->scale, bent = dual * row->hessian;
    for (int k = 0; k < d; k++) {
        const double g = row->vector[k];
        place->gradient[k] += push * row->scale * g;
        place->mixed[k] += mixed * g;
        for (int m = k; m < d; m++)
            h[k * d + m] += both * g * row->vector[m] + bent * (row->curve ? row->curve[k * d + m] : k == m);
    }
}

/* The next row of a segment. */
INLINE void take_row(int d, int task, Segment *on, Place *place, Row row) {
    const int64_t r = on->count++;
    if (task == VALUES) on->value[r] = row.value;
    if (task == CHANGES) {
        double sum = 0.0;
        if (row.axis >= 0)
            sum = place->dy[row.axis];
        else
            for (int k = 0; k < d; k++) sum += row.vector[k] * place->dy[k];
        on->change[r] = row.scale * sum + row.by_c * on->dc;
    }
    if (task == CONDENSE) {
        const double per_slack = 1.0 / on->slack[r], dual = on->dual[r], weight = dual * per_slack;
        const double push = (on->mu + dual * (on->value[r] + on->slack[r])) * per_slack;
        const int all = all_of(d), c = 3 * d;
        add_to_sums(d, &row, weight, push, dual, place);
        on->gradient[c] += push * row.by_c;
        on->hessian[c * (all + 1)] += weight * row.by_c * row.by_c + dual * row.bend_c;
    }
}

/* After the rows about a place: carry their sums over to state and control. */
INLINE void close_place(int d, int task, Segment *on, Place *place) {
    const int all = all_of(d), begin[4] = {0, d, 2 * d, 3 * d + 1}, c = 3 * d;
    if (task != CONDENSE) return;
    for (int k = 0; k < d; k++)
        for (int l = 0; l < k; l++) place->hessian[k * d + l] = place->hessian[l * d + k];
    for (int m = place->order; m <= place->most; m++) {
        for (int n = m; n <= place->most; n++) {
            const double both = place->c[m] * place->c[n];
            for (int k = 0; k < d; k++)
                for (int l = m == n ? k : 0; l < d; l++) {
                    const int a = begin[m] + k, b = begin[n] + l;
                    on->hessian[n < JERK ? a * all + b : b * all + a] += both * place->hessian[k * d + l];
                }
        }
        for (int k = 0; k < d; k++) {
            const int at = begin[m] + k;
            on->gradient[at] += place->c[m] * place->gradient[k];
            if (place->order > POSITION) on->hessian[at * all + c] += place->c[m] * place->mixed[k];
        }
    }
}

/* g to the power order / 3, and two derivatives by c. */
typedef struct {
    double value, once, twice;
} Power;

INLINE Power power_of(const Segment *on, int order) {
    const double e = order / 3.0, value = order == 1 ? on->root : order == 2 ? square(on->root) : on->g;
    return (Power){value, e * value * on->per_c, e * (e - 1.0) * value * on->per_c * on->per_c};
}

INLINE void add_axes(int d, int task, Segment *on, Place *place, const double *limits) {
    const int order = place->order;
    const Power power = power_of(on, order);
    const double unit = order == 1 ? on->scale : order == 2 ? square(on->scale) : on->cube, per_unit = 1.0 / unit;
    for (int k = 0; k < d; k++) {
        if (!(limits[k] > 0.0)) continue;
        for (int sign = 1; sign >= -1; sign -= 2) {
            const double by = sign * limits[k] * per_unit;
            const Row row = {.axis = k,
                             .scale = by,
                             .value = by * place->y[k] - power.value,
                             .by_c = -power.once,
                             .bend_c = -power.twice};
            take_row(d, task, on, place, row);
        }
    }
}

INLINE void add_feed(int d, int task, Segment *on, Place *place, double pace) {
    if (!(pace > 0.0)) return;
    const Power power = power_of(on, 2);
    const double by = pace / square(on->scale);
    const Row row = {.axis = -1,
                     .scale = 2.0 * by,
                     .value = by * squared(d, place->y) - power.value,
                     .by_c = -power.once,
                     .vector = place->y,
                     .hessian = 2.0 * by,
                     .bend_c = -power.twice};
    take_row(d, task, on, place, row);
}

/* Whether the node before a stage is given, so that it has no rows: the first stage is a switch, the second its first segment. */
INLINE int is_given(int64_t i) { return i < 2; }

INLINE int is_corner(const Problem *problem, int64_t i) {
    return i > 1 && problem->switches[i - 1] && problem->leg[i - 2] != problem->leg[i];
}

/* The allowed side of a leg. */
INLINE void add_side(const Problem *problem, int d, int task, int64_t leg, double by, Segment *on, Place *place) {
    const double *const normal = problem->walls + leg * (d + 2), *const origin = problem->vectors + leg * 4 * d;
    double off = 0.0, size = 0.0;
    for (int k = 0; k < d; k++) {
        off += normal[k] * (place->y[k] - origin[k]);
        size += square(normal[k]);
    }
    if (size > 0.0)
        take_row(d, task, on, place, (Row){.axis = -1, .scale = -by, .value = -by * off, .vector = normal});
}

/* Sides at the point q, of the leg and of those beside it.  Beside a rest the motion lies on the leg, whatever it is: there are no
   rows. */
INLINE void add_sides(const Problem *problem, int d, int task, int64_t i, int q, Segment *on, Place *place) {
    const int64_t leg = problem->leg[i];
    const double *const beside = problem->walls + leg * (d + 2) + d, by = sqrt(problem->near[2 * i + (q > 0)]);
    if ((is_given(i) && q <= PARTS) || (i == problem->n - 1 && q > PARTS)) return;
    add_side(problem, d, task, leg, by, on, place);
    if (beside[0] > 0.0 || (q == 0 && is_corner(problem, i))) add_side(problem, d, task, leg - 1, by, on, place);
    if (beside[1] > 0.0) add_side(problem, d, task, leg + 1, by, on, place);
}

/* The rows about the distance of the point q of a segment, and its side. */
INLINE void add_distance(const Problem *problem, int d, int task, int64_t i, int q, const Iterate *it, Segment *on,
                         Place *place) {
    const int64_t at = i * POINTS + q, leg = problem->leg[i];
    double *const off = it->off + at * d, *const curve = it->curve + at * d * d;
    const double near = problem->near[2 * i + (q > 0)];
    Row row = {.axis = -1, .scale = 2.0 * near, .vector = off, .hessian = 2.0 * near, .curve = curve};
    if (task == VALUES) {
        const int corner = q == 0 && is_corner(problem, i);
        row.value = near * (corner ? joint_vertex : joint_distance)(problem, leg, place->y, off, curve) - 1.0;
    }
    take_row(d, task, on, place, row);
    if (problem->walls) add_sides(problem, d, task, i, q, on, place);
    close_place(d, task, on, place);
}

INLINE void go_through(const Problem *problem, int d, int task, int64_t i, const Iterate *it, Segment *on) {
    const double share = problem->share[i], width = share / PARTS, *const pace = problem->pace + 2 * i;
    const int bent = problem->rates[2 * problem->leg[i]] != 0.0;
    Place place;
    if (!is_given(i)) {
        place = node_of(d, task, on, POSITION);
        add_distance(problem, d, task, i, 0, it, on, &place);
    }
    for (int q = 1; q < POINTS; q++) {
        place = point_of(d, task, on, share, bent, q);
        add_distance(problem, d, task, i, q, it, on, &place);
    }
    if (!is_given(i)) {
        place = node_of(d, task, on, VELOCITY);
        add_feed(d, task, on, &place, pace[0]);
        add_axes(d, task, on, &place, problem->velocity);
        close_place(d, task, on, &place);
    }
    for (int part = 0; part < PARTS; part++) {
        place = place_of(d, task, on, VELOCITY, part * width, 0.5 * width);
        add_feed(d, task, on, &place, pace[1]);
        add_axes(d, task, on, &place, problem->velocity);
        close_place(d, task, on, &place);
    }
    if (!is_given(i)) {
        place = node_of(d, task, on, ACCELERATION);
        add_axes(d, task, on, &place, problem->acceleration);
        close_place(d, task, on, &place);
    }
    place = node_of(d, task, on, JERK);
    add_axes(d, task, on, &place, problem->jerk);
    close_place(d, task, on, &place);
}

INLINE Segment segment_of(const Problem *problem, int d, int64_t i, const Iterate *it) {
    const int64_t first = i * most_rows_of(d);
    Segment on = {.x = it->x + i * states_of(d), .u = it->u + i * d, .scale = problem->scale[i], .root = it->root[i]};
    on.dx = it->dx + i * states_of(d);
    on.du = it->du + i * d;
    on.dc = on.dx[3 * d];
    on.value = it->value + first;
    on.slack = it->slack + first;
    on.dual = it->dual + first;
    on.cube = on.scale * square(on.scale);
    on.g = on.x[3 * d] / on.cube;
    on.per_c = 1.0 / on.x[3 * d];
    return on;
}

INLINE int64_t values(const Problem *problem, int d, int64_t i, const Iterate *it) {
    const double scale = problem->scale[i];
    if (problem->switches[i]) {
        it->value[i * most_rows_of(d)] = (problem->least - it->u[i * d]) / (scale * scale * scale);
        return 1;
    }
    const double *const c = it->x + i * states_of(d) + 3 * d;
    const int same = i > 1 && !problem->switches[i - 1] && *c == c[-states_of(d)] && scale == problem->scale[i - 1];
    it->root[i] = same ? it->root[i - 1] : cbrt(*c) / scale;
    Segment on = segment_of(problem, d, i, it);
    go_through(problem, d, VALUES, i, it, &on);
    return on.count;
}

INLINE void changes(const Problem *problem, int d, int64_t i, const Iterate *it, double *change) {
    if (problem->switches[i]) {
        const double scale = problem->scale[i];
        change[0] = -it->du[i * d] / (scale * scale * scale);
        return;
    }
    Segment on = segment_of(problem, d, i, it);
    on.change = change;
    go_through(problem, d, CHANGES, i, it, &on);
}

INLINE void condense(const Problem *problem, int d, int64_t i, const Iterate *it, double mu) {
    const int64_t first = i * most_rows_of(d);
    const int all = all_of(d), c = 3 * d;
    double *const hessian = it->hessian + i * all * all, *const gradient = it->gradient + i * all;
    memset(hessian, 0, sizeof(double) * (size_t)(all * all));
    memset(gradient, 0, sizeof(double) * (size_t)all);
    if (problem->switches[i]) {
        const double slack = it->slack[first], dual = it->dual[first], scale = problem->scale[i];
        const double by = -1.0 / (scale * square(scale));
        hessian[(c + 1) * (all + 1)] = dual / slack * by * by;
        gradient[c + 1] = by * (mu + dual * (it->value[first] + slack)) / slack;
        return;
    }
    Segment on = segment_of(problem, d, i, it);
    on.mu = mu;
    on.hessian = hessian;
    on.gradient = gradient;
    go_through(problem, d, CONDENSE, i, it, &on);
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

HOT void joint_condense(const Problem *problem, int64_t i, const Iterate *it, double mu) {
    switch (problem->d) {
    case 2: condense(problem, 2, i, it, mu); break;
    case 3: condense(problem, 3, i, it, mu); break;
    default: condense(problem, (int)problem->d, i, it, mu);
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

/* A tape's instructions, one after the other, each on a block of points, and on their values and three derivatives at once. */
#include "planner/geometry/geometry.h"

#include <string.h>

#include "planner/geometry/angle_inline.h"
#include "planner/geometry/sine_inline.h"

enum { BLOCK = 32 };
/* What a step does, as tape.py counts them. */
enum {
    ADD, SUBTRACT, MULTIPLY, DIVIDE, SHIFT, SCALE, QUOTIENT, SQRT, ABSOLUTE, POWER, POWER_OF, EXP, LOG,
    SIN, COS, TAN, ASIN, ACOS, ATAN, ATAN2, SINH, COSH, TANH
};

/* Value and derivatives 1..3 with respect to the parameter, at each point of a block. */
typedef double Values[BLOCK];
typedef const Values *Jet;

/* Derivatives of a function f at each point of a block. */
typedef struct {
    Values f0, f1, f2, f3;
} Outer;

#define INLINED static inline __attribute__((always_inline))

/* f(x) from the derivatives of f at x, by the chain rule. */
INLINED void compose(int64_t n, int full, const Outer *f, Jet x, Values *restrict y)
{
    for (int64_t i = 0; full && i < n; i++) {
        const double x1 = x[1][i], x2 = x[2][i], x3 = x[3][i];
        y[1][i] = f->f1[i] * x1;
        y[2][i] = f->f2[i] * (x1 * x1) + f->f1[i] * x2;
        y[3][i] = f->f3[i] * (x1 * x1 * x1) + f->f2[i] * (3.0 * x1 * x2) + f->f1[i] * x3;
    }
    for (int64_t i = 0; i < n; i++)
        y[0][i] = f->f0[i];
}

/* Leibniz' rule. */
INLINED void multiply(int64_t n, int full, Jet a, Jet b, Values *restrict y)
{
    for (int64_t i = 0; full && i < n; i++) {
        const double a0 = a[0][i], a1 = a[1][i], a2 = a[2][i], a3 = a[3][i];
        const double b0 = b[0][i], b1 = b[1][i], b2 = b[2][i], b3 = b[3][i];
        y[0][i] = a0 * b0;
        y[1][i] = a0 * b1 + a1 * b0;
        y[2][i] = a0 * b2 + 2.0 * (a1 * b1) + a2 * b0;
        y[3][i] = a0 * b3 + 3.0 * (a1 * b2 + a2 * b1) + a3 * b0;
    }
    for (int64_t i = 0; !full && i < n; i++)
        y[0][i] = a[0][i] * b[0][i];
}

/* a = y b, solved for the derivatives of y one after the other. */
INLINED void divide(int64_t n, int full, Jet a, Jet b, Values *restrict y)
{
    for (int64_t i = 0; full && i < n; i++) {
        const double b0 = b[0][i], b1 = b[1][i], b2 = b[2][i], b3 = b[3][i];
        const double y0 = a[0][i] / b0, per = 1.0 / b0; /* a division costs as much as ten products */
        const double y1 = (a[1][i] - y0 * b1) * per;
        const double y2 = (a[2][i] - 2.0 * (y1 * b1) - y0 * b2) * per;
        const double y3 = (a[3][i] - 3.0 * (y2 * b1 + y1 * b2) - y0 * b3) * per;
        y[0][i] = y0;
        y[1][i] = y1;
        y[2][i] = y2;
        y[3][i] = y3;
    }
    for (int64_t i = 0; !full && i < n; i++)
        y[0][i] = a[0][i] / b[0][i];
}

INLINED void add(int64_t n, int full, Jet a, Jet b, double sign, Values *restrict y)
{
    for (int k = 0; k < (full ? 4 : 1); k++)
        for (int64_t i = 0; i < n; i++)
            y[k][i] = a[k][i] + sign * b[k][i];
}

INLINED void scale(int64_t n, int full, Jet a, double factor, Values *restrict y)
{
    for (int k = 0; k < (full ? 4 : 1); k++)
        for (int64_t i = 0; i < n; i++)
            y[k][i] = a[k][i] * factor;
}

INLINED void quotient(int64_t n, int full, Jet a, double divisor, Values *restrict y)
{
    for (int k = 0; k < (full ? 4 : 1); k++)
        for (int64_t i = 0; i < n; i++)
            y[k][i] = a[k][i] / divisor;
}

INLINED void shift(int64_t n, int full, Jet a, double by, Values *restrict y)
{
    for (int64_t i = 0; i < n; i++)
        y[0][i] = a[0][i] + by;
    for (int k = 1; k < (full ? 4 : 1); k++)
        for (int64_t i = 0; i < n; i++)
            y[k][i] = a[k][i];
}

INLINED void absolute(int64_t n, int full, Jet x, Values *restrict y)
{
    for (int64_t i = 0; i < n; i++) {
        const double here = x[0][i], sign = here > 0.0 ? 1.0 : here < 0.0 ? -1.0 : 0.0;
        y[0][i] = fabs(here);
        for (int k = 1; k < (full ? 4 : 1); k++)
            y[k][i] = sign * x[k][i];
    }
}

INLINED void square_root(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double root = sqrt(x[i]), first = 0.5 / root, per = 4.0 * (first * first); /* 1 / x */
        const double second = -0.5 * first * per;
        f->f0[i] = root;
        f->f1[i] = first;
        f->f2[i] = second;
        f->f3[i] = -1.5 * second * per;
    }
}

/* c (c - 1) ... x^(c - k); where the product is 0 so is the derivative, also at x = 0. */
static void power(int64_t n, const double *x, double c, Outer *f)
{
    Values *out[4] = {&f->f0, &f->f1, &f->f2, &f->f3};
    double factor = 1.0;
    for (int k = 0; k < 4; k++) {
        for (int64_t i = 0; i < n; i++)
            (*out[k])[i] = factor == 0.0 ? 0.0 : factor * pow(x[i], c - k);
        factor *= c - k;
    }
}

static void exponential(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++)
        f->f0[i] = f->f1[i] = f->f2[i] = f->f3[i] = exp(x[i]);
}

static void logarithm(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double first = 1.0 / x[i];
        f->f0[i] = log(x[i]);
        f->f1[i] = first;
        f->f2[i] = -first * first;
        f->f3[i] = 2.0 * first * first * first;
    }
}

/* The sine and cosine of the operand that had them last: a formula that takes one mostly takes the other. */
typedef struct {
    Values of, sine, cosine;
} Turn;

INLINED void turn_to(int64_t n, const double *x, Turn *last)
{
    int64_t other = 0;
    for (int64_t i = 0; i < n; i++)
        other += !(x[i] == last->of[i]);
    if (!other)
        return;
    memcpy(last->of, x, (size_t)n * sizeof(double));
    sine_cosine(n, x, last->sine, last->cosine);
}

INLINED void sine(int64_t n, int full, const double *x, Turn *last, Outer *f)
{
    turn_to(n, x, last);
    for (int64_t i = 0; i < n; i++) {
        f->f0[i] = last->sine[i];
        f->f1[i] = last->cosine[i];
    }
    for (int64_t i = 0; full && i < n; i++) {
        f->f2[i] = -f->f0[i];
        f->f3[i] = -f->f1[i];
    }
}

INLINED void cosine(int64_t n, int full, const double *x, Turn *last, Outer *f)
{
    turn_to(n, x, last);
    for (int64_t i = 0; i < n; i++) {
        f->f0[i] = last->cosine[i];
        f->f3[i] = last->sine[i];
    }
    for (int64_t i = 0; full && i < n; i++) {
        f->f1[i] = -f->f3[i];
        f->f2[i] = -f->f0[i];
    }
}

static void tangent(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double t = tan(x[i]), first = 1.0 + t * t;
        f->f0[i] = t;
        f->f1[i] = first;
        f->f2[i] = 2.0 * t * first;
        f->f3[i] = 2.0 * first * (first + 2.0 * t * t);
    }
}

static void arcsine(int64_t n, const double *x, double sign, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double w = 1.0 - x[i] * x[i], first = sign / sqrt(w);
        f->f0[i] = sign > 0.0 ? asin(x[i]) : acos(x[i]);
        f->f1[i] = first;
        f->f2[i] = x[i] * first / w;
        f->f3[i] = (1.0 + 2.0 * x[i] * x[i]) * first / (w * w);
    }
}

static void arctangent(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double first = 1.0 / (1.0 + x[i] * x[i]);
        f->f0[i] = atan(x[i]);
        f->f1[i] = first;
        f->f2[i] = -2.0 * x[i] * first * first;
        f->f3[i] = (6.0 * x[i] * x[i] - 2.0) * first * first * first;
    }
}

static void hyperbolic(int64_t n, const double *x, int even, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double odd_part = sinh(x[i]), even_part = cosh(x[i]);
        f->f0[i] = f->f2[i] = even ? even_part : odd_part;
        f->f1[i] = f->f3[i] = even ? odd_part : even_part;
    }
}

static void hyperbolic_tangent(int64_t n, const double *x, Outer *f)
{
    for (int64_t i = 0; i < n; i++) {
        const double t = tanh(x[i]), first = 1.0 - t * t;
        f->f0[i] = t;
        f->f1[i] = first;
        f->f2[i] = -2.0 * t * first;
        f->f3[i] = first * (4.0 * t * t - 2.0 * first);
    }
}

/* The angle of (x, y), whose rate is (x y' - y x') / (x^2 + y^2). */
INLINED void angle(int64_t n, int full, Jet y, Jet x, Values *restrict out)
{
    angles(n, y[0], x[0], out[0]);
    for (int64_t i = 0; full && i < n; i++) {
        const double x0 = x[0][i], x1 = x[1][i], x2 = x[2][i], x3 = x[3][i];
        const double y0 = y[0][i], y1 = y[1][i], y2 = y[2][i], y3 = y[3][i];
        const double d = x0 * x0 + y0 * y0, d1 = 2.0 * (x0 * x1 + y0 * y1);
        const double d2 = 2.0 * (x1 * x1 + y1 * y1 + x0 * x2 + y0 * y2);
        const double per = 1.0 / d, first = (x0 * y1 - y0 * x1) * per;
        const double second = (x0 * y2 - y0 * x2 - first * d1) * per;
        const double turn = x0 * y3 - y0 * x3 + x1 * y2 - y1 * x2;
        out[1][i] = first;
        out[2][i] = second;
        out[3][i] = (turn - 2.0 * (second * d1) - first * d2) * per;
    }
}

/* a^b with an exponent that varies: exp of b log a, but for its value. */
static void power_of(int64_t n, int full, Jet a, Jet b, Values *restrict y)
{
    Outer f;
    Values logs[4], exponent[4];
    logarithm(n, a[0], &f);
    compose(n, full, &f, a, logs);
    multiply(n, full, b, (Jet)logs, exponent);
    for (int64_t i = 0; i < n; i++)
        f.f0[i] = f.f1[i] = f.f2[i] = f.f3[i] = pow(a[0][i], b[0][i]);
    compose(n, full, &f, (Jet)exponent, y);
}

/* f(x) of one operand; c: the exponent of a power. */
INLINED void apply(int code, int64_t n, int full, Jet x, double c, Turn *last, Values *restrict y)
{
    Outer f;
    switch (code) {
    case SQRT: square_root(n, x[0], &f); break;
    case POWER: power(n, x[0], c, &f); break;
    case EXP: exponential(n, x[0], &f); break;
    case LOG: logarithm(n, x[0], &f); break;
    case SIN: sine(n, full, x[0], last, &f); break;
    case COS: cosine(n, full, x[0], last, &f); break;
    case TAN: tangent(n, x[0], &f); break;
    case ASIN: arcsine(n, x[0], 1.0, &f); break;
    case ACOS: arcsine(n, x[0], -1.0, &f); break;
    case ATAN: arctangent(n, x[0], &f); break;
    case SINH: hyperbolic(n, x[0], 0, &f); break;
    case COSH: hyperbolic(n, x[0], 1, &f); break;
    default: hyperbolic_tangent(n, x[0], &f); break;
    }
    compose(n, full, &f, x, y);
}

INLINED void run_step(int code, int64_t n, int full, Jet a, Jet b, Turn *last, Values *restrict y)
{
    const double c = b[0][0]; /* of a constant, which is one all over */
    switch (code) {
    case ADD: add(n, full, a, b, 1.0, y); break;
    case SUBTRACT: add(n, full, a, b, -1.0, y); break;
    case MULTIPLY: multiply(n, full, a, b, y); break;
    case DIVIDE: divide(n, full, a, b, y); break;
    case SHIFT: shift(n, full, a, c, y); break;
    case SCALE: scale(n, full, a, c, y); break;
    case QUOTIENT: quotient(n, full, a, c, y); break;
    case ABSOLUTE: absolute(n, full, a, y); break;
    case POWER_OF: power_of(n, full, a, b, y); break;
    case ATAN2: angle(n, full, a, b, y); break;
    default: apply(code, n, full, a, c, last, y); break;
    }
}

/* All steps on a block of so many points, which the compiler knows: no loop has a rest. */
INLINED void run_block(int64_t steps, const int32_t *code, int full, Turn *last, Values *slots)
{
    for (int64_t s = 0; s < steps; s++) {
        const int32_t *step = code + 4 * s; /* what to do, two operands, target */
        run_step(step[0], BLOCK, full, (Jet)(slots + 4 * step[1]), (Jet)(slots + 4 * step[2]), last, slots + 4 * step[3]);
    }
}

HOT void tape_run(int64_t steps, const int32_t *code, int64_t inputs, int64_t constants, const double *constant,
                  int64_t rows, const int32_t *row, int64_t n, int64_t order, int64_t given, const double *in,
                  double *out, double *work)
{
    Values *slots = (Values *)work;
    const int full = order > 0, orders = full ? 4 : 1;
    Turn last;
    for (int64_t i = 0; i < BLOCK; i++)
        last.of[i] = NAN; /* that of nothing yet: it equals no operand */
    for (int64_t c = 0; c < constants; c++)
        for (int k = 0; k < 4; k++)
            for (int64_t i = 0; i < BLOCK; i++)
                slots[4 * (inputs + c) + k][i] = k ? 0.0 : constant[c];
    for (int64_t first = 0; first < n; first += BLOCK) {
        const int64_t count = n - first < BLOCK ? n - first : BLOCK;
        for (int k = 0; k < orders; k++)
            for (int64_t j = 0; j < inputs; j++) {
                double *slot = slots[4 * j + k];
                for (int64_t i = 0; i < count; i++)
                    slot[i] = k < given ? in[(k * n + first + i) * inputs + j] : k == 1;
                for (int64_t i = count; i < BLOCK; i++)
                    slot[i] = slot[count - 1]; /* the last block has its last point more than once */
            }
        if (full)
            run_block(steps, code, 1, &last, slots);
        else
            run_block(steps, code, 0, &last, slots);
        for (int64_t k = 0; k <= order; k++)
            for (int64_t j = 0; j < rows; j++)
                for (int64_t i = 0; i < count; i++)
                    out[(k * n + first + i) * rows + j] = slots[4 * row[j] + k][i];
    }
}

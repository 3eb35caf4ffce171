#include "planner/geometry/geometry.h"

#include "planner/geometry/differential_inline.h"

static void put(Triple found, int64_t n, double *out)
{
    out[0] = found.first;
    out[n] = found.second;
    out[2 * n] = found.third;
}

static Triple column(const double *rows, int64_t n)
{
    const Triple found = {rows[0], rows[n], rows[2 * n]};
    return found;
}

void differential_chain_rule(int64_t n, const double *q, const double *u, double *out)
{
    for (int64_t i = 0; i < n; i++)
        put(chain_rule(q[i], q[n + i], q[2 * n + i], u[i], u[n + i], u[2 * n + i]), n, out + i);
}

void differential_speed_derivatives(int64_t n, const double *products, double *out)
{
    for (int64_t i = 0; i < n; i++)
        put(speed_derivatives(products[i], products[n + i], products[2 * n + i]), n, out + i);
}

void differential_rates_along(int64_t n, const double *speeds, const double *u, double *out)
{
    for (int64_t i = 0; i < n; i++)
        put(rates_along(column(speeds + i, n), u[i], u[n + i], u[2 * n + i]), n, out + i);
}

void differential_rates_of_parameter(int64_t n, const double *speeds, const double *s, double *out)
{
    for (int64_t i = 0; i < n; i++)
        put(rates_of_parameter(column(speeds + i, n), s[i], s[n + i], s[2 * n + i]), n, out + i);
}

void differential_half_chord(int64_t n, const double *radius, const double *error, double *out)
{
    for (int64_t i = 0; i < n; i++)
        out[i] = half_chord(radius[i], error[i]);
}

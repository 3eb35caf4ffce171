/* How many intervals of a grid in time fall into each of its cells. */
#include "plan.h"

#include "planner/core.h"

#include <math.h>

static double middle(const double *fine, int64_t k) { return 0.5 * (fine[k + 1] + fine[k]); }

void time_knots_count(int64_t cells, const double *fine, const double *spacing, const double *most, double intervals,
                      double growth, int64_t rounds, double max_wider, double *grown, double *count) {
    int held = 0;
    for (int64_t k = 0; k < cells; k++) {
        held |= isfinite(most[k]);
        /* what must be closer than the density has it comes on top */
        intervals += (fine[k + 1] - fine[k]) * fmax(1.0 / most[k] - 1.0 / spacing[k], 0.0);
    }
    double scale = 1.0;
    for (int64_t round = 0; round < rounds; round++) {
        for (int64_t k = 0; k < cells; k++) {
            grown[k] = fmin(scale * spacing[k], most[k]);
            if (k) grown[k] = fmin(grown[k], grown[k - 1] + growth * (middle(fine, k) - middle(fine, k - 1)));
        }
        for (int64_t k = cells - 2; k >= 0; k--)
            grown[k] = fmin(grown[k], grown[k + 1] + growth * (middle(fine, k + 1) - middle(fine, k)));
        count[0] = 0.0;
        for (int64_t k = 0; k < cells; k++) count[k + 1] = count[k] + (fine[k + 1] - fine[k]) / grown[k];
        scale = scale * count[cells] / intervals;
        if (held) scale = fmin(scale, max_wider);
    }
}

/* The calls of step.h on bytes; see step_run.h.  numpy aligns what it allocates as malloc does. */
#include "interp/step_run.h"

#include "interp/step.h"

#include <stddef.h>

static const feedplan_plan *plan_of(const uint8_t *plan) { return (const feedplan_plan *)(const void *)plan; }

static feedplan_state *state_of(uint8_t *state) { return (feedplan_state *)(void *)state; }

void step_sizes(int64_t *sizes)
{
    sizes[0] = (int64_t)sizeof(feedplan_plan);
    sizes[1] = (int64_t)sizeof(feedplan_state);
}

int64_t step_open(const uint8_t *bytes, int64_t size, uint8_t *plan)
{
    return feedplan_open((feedplan_plan *)(void *)plan, bytes, (size_t)size);
}

int64_t step_start(const uint8_t *plan, uint8_t *state, double period)
{
    return feedplan_start(plan_of(plan), state_of(state), period);
}

int64_t step_seek(const uint8_t *plan, uint8_t *state, double time, int64_t sample, double rate)
{
    if (sample >= 0)
        return feedplan_seek_sample(plan_of(plan), state_of(state), sample, rate);
    return feedplan_seek(plan_of(plan), state_of(state), time, rate);
}

int64_t step_once(const int64_t *call)
{
    const feedplan_plan *plan = (const feedplan_plan *)(intptr_t)call[0];
    feedplan_state *state = (feedplan_state *)(intptr_t)call[1];
    const double *command = (const double *)(intptr_t)call[2];
    return feedplan_step(plan, state, command[0], command[1] != 0.0, (double *)(intptr_t)call[3]);
}

int64_t step_run(const uint8_t *plan, uint8_t *state, int64_t count, const double *override, const uint8_t *hold,
                 double *positions, double *course)
{
    const feedplan_plan *of = plan_of(plan);
    feedplan_state *at = state_of(state);
    for (int64_t i = 0; i < count; i++) {
        const int done = feedplan_step(of, at, override[i], hold[i], positions + i * of->dim);
        double *row = course + 4 * i;
        row[0] = feedplan_time(of, at);
        row[1] = at->rate;
        row[2] = at->rate_slope;
        row[3] = at->u;
        if (done)
            return i + 1;
    }
    return count;
}

void step_place(const uint8_t *plan, const uint8_t *state, double *place, double *position)
{
    const feedplan_plan *of = plan_of(plan);
    const feedplan_state *at = (const feedplan_state *)(const void *)state;
    place[0] = feedplan_time(of, at);
    place[1] = at->u;
    place[2] = at->rate;
    place[3] = at->rate_slope;
    place[4] = feedplan_progress(of, at);
    place[5] = (double)feedplan_line(of, at);
    place[6] = (double)feedplan_done(of, at);
    feedplan_position(of, at, position);
}

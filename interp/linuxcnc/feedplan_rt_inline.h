/* What the HAL component does with a plan.  It stands apart from feedplan_rt.comp since halcompile makes macros of the names of
   pins, which are those of members of the interpolator's structs. */
#ifndef FEEDPLAN_RT_INLINE_H
#define FEEDPLAN_RT_INLINE_H

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The interpolator itself; its samples have the bits that the check has seen. */
#pragma GCC optimize("O2", "fp-contract=off")
#include "interp/step.h"
#include "interp/step.c"

/* A plan that is run. */
typedef struct {
    feedplan_plan plan;
    feedplan_state state;
    void *bytes;
    int started;     /* the period is known, and the state is one of the plan */
    int may_restart; /* run was false since the plan was done */
    double at[FEEDPLAN_MAX_AXES]; /* the last sample */
} Runner;

/* What the pins show beside the positions. */
typedef struct {
    double path_feed, plan_rate, time_done, share_done;
    int at_end, obeys;
    int64_t program_line;
} Shown;

/* Read a whole file into memory that malloc aligns.  Returns NULL, and errno says why, where that fails. */
static inline void *whole_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        return NULL;
    void *bytes = NULL;
    long length = fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    if (length > 0 && !fseek(file, 0, SEEK_SET))
        bytes = malloc((size_t)length);
    if (bytes && fread(bytes, 1, (size_t)length, file) != (size_t)length) {
        free(bytes);
        bytes = NULL;
    }
    *size = bytes ? (size_t)length : 0;
    errno = bytes || errno ? errno : EINVAL;
    fclose(file);
    return bytes;
}

/* Load a plan; not in real time.  Returns NULL, or what is wrong. */
static inline const char *load_plan(Runner *runner, const char *path)
{
    size_t size = 0;
    runner->bytes = whole_file(path, &size);
    if (!runner->bytes)
        return strerror(errno);
    const int wrong = feedplan_open(&runner->plan, runner->bytes, size);
    if (!wrong)
        return NULL;
    free(runner->bytes);
    runner->bytes = NULL;
    return feedplan_error_text(wrong);
}

static inline void unload_plan(Runner *runner)
{
    free(runner->bytes);
    runner->bytes = NULL;
}

/* Length of the step of the linear axes, mm, to a new sample, which is kept. */
static inline double step_length(Runner *runner, const double *sample)
{
    double sum = 0.0;
    for (int64_t j = 0; j < runner->plan.dim; j++) {
        const double step = sample[j] - runner->at[j];
        if (feedplan_axis_unit(&runner->plan, j)[0] == 'm')
            sum += step * step;
        runner->at[j] = sample[j];
    }
    return sqrt(sum);
}

/* One period of so many seconds.  While run is false the plan stands before its first sample, or comes to a stop as under hold.
   Once it is done, run false and then true begins it again. */
static inline void run_period(Runner *runner, double seconds, double override, int hold, int run, Shown *shown)
{
    const feedplan_plan *plan = &runner->plan;
    feedplan_state *state = &runner->state;
    double sample[FEEDPLAN_MAX_AXES];
    memset(shown, 0, sizeof *shown);
    shown->obeys = plan->governed != 0;
    const int again = runner->started && run && runner->may_restart;
    if (!runner->started || again) {
        if (feedplan_start(plan, state, seconds))
            return; /* there is no such period: nothing moves */
        runner->started = 1;
        runner->may_restart = 0;
        feedplan_position(plan, state, sample);
        step_length(runner, sample);
    }
    if (run || state->begun)
        shown->at_end = feedplan_step(plan, state, override, hold || !run, sample) != 0;
    else
        feedplan_position(plan, state, sample);
    runner->may_restart = shown->at_end && (runner->may_restart || !run);
    shown->path_feed = step_length(runner, sample) / seconds;
    shown->plan_rate = state->begun && !shown->at_end ? state->rate : 0.0;
    shown->time_done = feedplan_time(plan, state);
    shown->share_done = feedplan_progress(plan, state);
    shown->program_line = feedplan_line(plan, state);
}

#endif

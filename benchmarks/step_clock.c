/* Times of feedplan_step on this machine: step_clock FILE STEPS GOVERNED, pinned to the core that it runs on first.

   Prints ns a step of a loop (median of 21 blocks), and of single steps with a clock around each the median and the largest.
   GOVERNED 1 asks for a rate that changes all the time. */
#define _GNU_SOURCE
#include "interp/step.h"

#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { BLOCKS = 21, COUNTED = 100000 };

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The override of step k: up and down over 300 periods, never at rest. */
static double override_of(int64_t k, int governed)
{
    const double phase = (double)(k % 300) / 300.0;
    return governed ? 0.2 + 0.8 * (phase < 0.5 ? 2.0 * phase : 2.0 - 2.0 * phase) : 1.0;
}

int main(int count, char **arguments)
{
    if (count != 4)
        return 2;
    FILE *file = fopen(arguments[1], "rb");
    const int64_t steps = atoll(arguments[2]);
    const int governed = atoi(arguments[3]);
    if (!file || fseek(file, 0, SEEK_END))
        return 2;
    const size_t size = (size_t)ftell(file);
    rewind(file);
    void *bytes = malloc(size);
    if (!bytes || fread(bytes, 1, size, file) != size)
        return 2;
    fclose(file);
    cpu_set_t core;
    CPU_ZERO(&core);
    CPU_SET(sched_getcpu(), &core);
    sched_setaffinity(0, sizeof core, &core);

    feedplan_plan plan;
    feedplan_state state;
    double position[FEEDPLAN_MAX_AXES], sum = 0.0;
    if (feedplan_open(&plan, bytes, size) || feedplan_start(&plan, &state, plan.period))
        return 3;
    double *blocks = malloc(BLOCKS * sizeof *blocks), *single = malloc((size_t)steps * sizeof *single);
    if (!blocks || !single)
        return 2;
    for (int b = 0; b < BLOCKS; b++) {
        const double begin = now();
        for (int64_t k = 0; k < COUNTED; k++) {
            if (feedplan_step(&plan, &state, override_of(k, governed), 0, position))
                feedplan_start(&plan, &state, plan.period);
            sum += position[0];
        }
        blocks[b] = (now() - begin) / COUNTED;
    }
    qsort(blocks, BLOCKS, sizeof *blocks, by_size);
    for (int64_t k = 0; k < steps; k++) {
        const double begin = now();
        const int done = feedplan_step(&plan, &state, override_of(k, governed), 0, position);
        single[k] = now() - begin;
        sum += position[0];
        if (done)
            feedplan_start(&plan, &state, plan.period);
    }
    qsort(single, (size_t)steps, sizeof *single, by_size);
    printf("%.2f %.1f %.1f %.1f %g\n", blocks[BLOCKS / 2], single[steps / 2], single[steps - 1 - steps / 1000000],
           single[steps - 1], sum);
    return 0;
}

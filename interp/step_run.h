/* The calls of step.h for Python, which has arrays and no structs: plan and state are bytes that hold them. */
#ifndef FEEDPLAN_STEP_RUN_H
#define FEEDPLAN_STEP_RUN_H

#include <stdint.h>

/* Sizes in bytes of the plan and of the state: sizes (2). */
void step_sizes(int64_t *sizes);

/* Open bytes (size), which must stay; begin with a period; both return what feedplan_open and feedplan_start do. */
int64_t step_open(const uint8_t *bytes, int64_t size, uint8_t *plan);
int64_t step_start(const uint8_t *plan, uint8_t *state, double period);

/* Go to a plan time, s, or where sample is not negative to that sample, at a rate. */
int64_t step_seek(const uint8_t *plan, uint8_t *state, double time, int64_t sample, double rate);

/* One step.  call (4) has the addresses of plan, state, command and position, for every argument costs Python more than the
   step does: command (2) is the override, and whether to hold; position (dim). */
int64_t step_once(const int64_t *call);

/* Count steps, or as many as there are to the end: override (count), hold (count); positions (count, dim), and for each step
   the plan time, the rate, its slope and the curve parameter: course (count, 4).  Returns how many were taken. */
int64_t step_run(const uint8_t *plan, uint8_t *state, int64_t count, const double *override, const uint8_t *hold,
                 double *positions, double *course);

/* Where a state is: place (7) gets plan time, curve parameter, rate, its slope, progress, program line, whether it is done;
   position (dim). */
void step_place(const uint8_t *plan, const uint8_t *state, double *place, double *position);

#endif

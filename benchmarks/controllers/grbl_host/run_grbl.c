/* Times of programs by GRBL's own planner and stepper code, built for this computer: no machine, no serial line.

   Compiled with the sources of GRBL 1.1, which are not here: run_grbl.py gets their folder.  The step segments that GRBL
   would hand to its timer are counted instead: n steps of so many cycles of a clock of 16 MHz.  Lines and arcs come in as
   fast as the planner has room for them.

   Input: a line each, numbers in mm and mm/min
     set   steps/mm, then X Y Z of rates, of accelerations (mm/s^2), junction deviation, arc tolerance
     from  X Y Z
     rapid X Y Z | line X Y Z F | arc X Y Z F  i j k  axis_0 axis_1 axis_linear clockwise
     wait
   Output: the seconds. */

#include <stdio.h>
#include "stepper.c" /* its segments are static there */

system_t sys;
int32_t sys_position[N_AXIS];
int32_t sys_probe_position[N_AXIS];
volatile uint8_t sys_probe_state, sys_rt_exec_state, sys_rt_exec_alarm, sys_rt_exec_motion_override;
volatile uint8_t sys_rt_exec_accessory_override;
settings_t settings;
registers host;

static double seconds;

/* Let the machine take a segment; 0 where there is none. */
static int take_segment(void) {
  st_prep_buffer();
  if (segment_buffer_tail == segment_buffer_head) return 0;
  const segment_t *segment = &segment_buffer[segment_buffer_tail];
  seconds += (double)segment->n_step * (double)segment->cycles_per_tick / (double)F_CPU;
  if (++segment_buffer_tail == SEGMENT_BUFFER_SIZE) segment_buffer_tail = 0;
  return 1;
}

void protocol_execute_realtime(void) {}
void protocol_auto_cycle_start(void) {
  sys.state = STATE_CYCLE;
  while (plan_check_full_buffer() && take_segment()) {}
}
void protocol_buffer_synchronize(void) {
  sys.state = STATE_CYCLE;
  while (take_segment()) {}
}
uint8_t spindle_compute_pwm_value(float rpm) { (void)rpm; return 0; }
void spindle_set_speed(uint8_t value) { (void)value; }
void system_set_exec_state_flag(uint8_t mask) { (void)mask; }
void system_clear_exec_state_flag(uint8_t mask) { (void)mask; }
void probe_state_monitor(void) {}
void limits_soft_check(float *target) { (void)target; }
void spindle_sync(uint8_t state, float rpm) { (void)state; (void)rpm; }
uint8_t get_step_pin_mask(uint8_t axis) { return (uint8_t)(1 << axis); }
uint8_t get_direction_pin_mask(uint8_t axis) { return (uint8_t)(1 << axis); }

static int numbers(float *value, int count) {
  for (int k = 0; k < count; k++)
    if (scanf("%f", &value[k]) != 1) return 0;
  return 1;
}

static int settings_of(void) {
  float v[9];
  if (!numbers(v, 9)) return 0;
  for (int k = 0; k < N_AXIS; k++) {
    settings.steps_per_mm[k] = v[0];
    settings.max_rate[k] = v[1 + k];
    settings.acceleration[k] = v[4 + k] * 60.0f * 60.0f;
  }
  settings.junction_deviation = v[7];
  settings.arc_tolerance = v[8];
  settings.pulse_microseconds = 10;
  sys.f_override = sys.r_override = 100;
  st_reset();
  plan_reset();
  return 1;
}

int main(void) {
  char word[16];
  float position[N_AXIS] = {0};
  while (scanf("%15s", word) == 1) {
    float to[N_AXIS], offset[N_AXIS], feed = 0.0f;
    plan_line_data_t data;
    memset(&data, 0, sizeof data);
    if (!strcmp(word, "set")) {
      if (!settings_of()) return 2;
      continue;
    }
    if (!strcmp(word, "wait")) {
      protocol_buffer_synchronize();
      continue;
    }
    if (!numbers(to, N_AXIS)) return 2;
    if (!strcmp(word, "from")) {
      for (int k = 0; k < N_AXIS; k++) sys_position[k] = lround(to[k] * settings.steps_per_mm[k]);
      plan_sync_position();
    } else if (!strcmp(word, "rapid")) {
      data.condition = PL_COND_FLAG_RAPID_MOTION;
      mc_line(to, &data);
    } else {
      if (!numbers(&feed, 1)) return 2;
      data.feed_rate = feed;
      if (!strcmp(word, "line")) {
        mc_line(to, &data);
      } else {
        int axis[4];
        if (!numbers(offset, N_AXIS)) return 2;
        for (int k = 0; k < 4; k++)
          if (scanf("%d", &axis[k]) != 1) return 2;
        mc_arc(to, &data, position, offset, hypot_f(offset[axis[0]], offset[axis[1]]), (uint8_t)axis[0],
               (uint8_t)axis[1], (uint8_t)axis[2], (uint8_t)axis[3]);
      }
    }
    memcpy(position, to, sizeof position);
  }
  protocol_buffer_synchronize();
  printf("%.9f\n", seconds);
  return 0;
}

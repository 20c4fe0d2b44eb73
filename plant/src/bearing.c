/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/bearing.h"

#include <string.h>

#define MASK (ANHYST_PLANT_DELAY_MOST - 1U)

void anhyst_plant_start(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                        uint64_t seed)
{
  int j;
  memset(state, 0, sizeof *state);
  state->gap = bearing->stop_high;
  state->load_gap = anhyst_plant_convert(state->gap, 0.0, 1.0, bearing->load.encoder_step);
  anhyst_plant_noise_start(&state->noise, seed);
  anhyst_plant_sensor_start(&state->gap_sensing, state->gap);
  anhyst_plant_sensor_start(&state->force_sensing, 0.0);
  for (j = 0; j < bearing->magnets; j++) {
    anhyst_plant_sensor_start(&state->current_sensing[j], 0.0);
    anhyst_plant_sensor_start(&state->hall_sensing[j], 0.0);
  }
}

void anhyst_plant_read(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                       anhyst_plant_readings *readings)
{
  int j;
  anhyst_plant_noise *noise = &state->noise;
  memset(readings, 0, sizeof *readings);
  readings->gap = anhyst_plant_sensor_read(&bearing->gap_sensor, &state->gap_sensing, noise);
  for (j = 0; j < bearing->magnets; j++) {
    readings->current[j] =
        anhyst_plant_sensor_read(&bearing->current_sensor, &state->current_sensing[j], noise);
    readings->density[j] =
        anhyst_plant_sensor_read(&bearing->hall_probe, &state->hall_sensing[j], noise);
  }
  readings->force = anhyst_plant_sensor_read(&bearing->force_sensor, &state->force_sensing, noise);
}

/* One amplifier and its winding. */
static void winding_step(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, int j,
                         double gap, double seconds)
{
  const anhyst_plant_amplifier *amplifier = &bearing->amplifier;
  anhyst_plant_coil *coil = &state->coil[j];
  anhyst_plant_source source;
  source.limit = amplifier->limit;
  if (amplifier->gain > 0.0) {
    source.reference = state->output[j];
    source.gain = amplifier->gain + 0.5 * seconds * amplifier->reset;
    source.voltage = state->integral[j];
  } else {
    source.reference = 0.0;
    source.gain = 0.0;
    source.voltage = state->output[j];
  }
  anhyst_plant_coil_step(&bearing->magnet[j], coil, &source, gap, seconds);
  if (coil->voltage < source.limit && coil->voltage > -source.limit) {
    state->integral[j] += seconds * amplifier->reset * (source.reference - coil->current);
  }
}

static double pushed(const anhyst_plant_bearing *bearing, double gap, double *damping)
{
  const double over = gap > bearing->stop_high  ? gap - bearing->stop_high
                      : gap < bearing->stop_low ? gap - bearing->stop_low
                                                : 0.0;
  if (over > 0.0 || over < 0.0) {
    *damping += bearing->stop_damping;
  }
  return -bearing->stop_stiffness * over;
}

static void substep(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                    double load_command)
{
  const double seconds = bearing->tick / (double)bearing->substeps;
  const double gap_before = state->gap;
  const double force_before = state->force;
  const double middle = gap_before + 0.5 * seconds * state->velocity;
  double current[ANHYST_PLANT_MAGNETS];
  double density[ANHYST_PLANT_MAGNETS];
  double damping = bearing->damping;
  double drive;
  double force;
  double lag;
  int j;
  if (state->due[state->at]) {
    memcpy(state->output, state->line[state->at], sizeof state->output);
    state->due[state->at] = 0;
  }
  state->at = (state->at + 1U) & MASK;
  for (j = 0; j < bearing->magnets; j++) {
    current[j] = state->coil[j].current;
    density[j] = state->coil[j].density;
    winding_step(bearing, state, j, j == 0 ? middle : bearing->gap_total - middle, seconds);
  }
  state->force = state->coil[0].force - (bearing->magnets > 1 ? state->coil[1].force : 0.0);
  lag = bearing->load.share * (load_command - state->load);
  drive = state->load + 0.5 * lag;
  state->load += lag;
  force =
      drive + bearing->mass * bearing->gravity - state->force + pushed(bearing, middle, &damping);
  lag = 0.5 * seconds * damping / bearing->mass;
  state->velocity = (state->velocity * (1.0 - lag) + seconds * force / bearing->mass) / (1.0 + lag);
  state->gap = middle + 0.5 * seconds * state->velocity;
  anhyst_plant_sensor_follow(&bearing->gap_sensor, &state->gap_sensing, gap_before, state->gap);
  anhyst_plant_sensor_follow(&bearing->force_sensor, &state->force_sensing, force_before,
                             state->force);
  for (j = 0; j < bearing->magnets; j++) {
    anhyst_plant_sensor_follow(&bearing->current_sensor, &state->current_sensing[j], current[j],
                               state->coil[j].current);
    anhyst_plant_sensor_follow(&bearing->hall_probe, &state->hall_sensing[j], density[j],
                               state->coil[j].density);
  }
}

/* What the state controller of the load drive commands at this tick. */
static double load_control(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                           double force)
{
  const anhyst_plant_load *load = &bearing->load;
  const double gap = anhyst_plant_convert(state->gap, 0.0, 1.0, load->encoder_step);
  const double velocity = (gap - state->load_gap) / bearing->tick;
  state->load_velocity += load->velocity_share * (velocity - state->load_velocity);
  state->load_gap = gap;
  return force - load->damping * state->load_velocity - load->stiffness * (gap - load->rest);
}

void anhyst_plant_advance(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                          const double command[ANHYST_PLANT_MAGNETS], double load)
{
  const anhyst_plant_amplifier *amplifier = &bearing->amplifier;
  const unsigned due = (state->at + (unsigned)bearing->delay) & MASK;
  const double load_command = load_control(bearing, state, load);
  int j;
  for (j = 0; j < bearing->magnets; j++) {
    state->line[due][j] =
        anhyst_plant_convert(command[j], amplifier->low, amplifier->high, amplifier->step);
  }
  state->due[due] = 1;
  for (j = 0; j < bearing->substeps; j++) {
    substep(bearing, state, load_command);
  }
}

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

static double gap_of(const anhyst_plant_bearing *bearing, const anhyst_plant_state *state, int j)
{
  return j == 0 ? state->gap : bearing->gap_total - state->gap;
}

static void sum_up(const anhyst_plant_bearing *bearing, anhyst_plant_state *state)
{
  state->force = state->coil[0].force - (bearing->magnets > 1 ? state->coil[1].force : 0.0);
}

void anhyst_plant_place(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, double gap,
                        double velocity)
{
  state->gap = gap;
  state->velocity = velocity;
  state->load_gap = anhyst_plant_convert(gap, 0.0, 1.0, bearing->load.encoder_step);
  anhyst_plant_sensor_start(&state->gap_sensing, gap);
}

void anhyst_plant_hold(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, int j,
                       double current)
{
  const double voltage = bearing->magnet[j].resistance * current;
  anhyst_plant_coil *coil = &state->coil[j];
  anhyst_plant_coil_hold(&bearing->magnet[j], coil, current, gap_of(bearing, state, j));
  if (bearing->amplifier.gain > 0.0) {
    coil->integral = voltage;
    state->output[j] = current;
  } else {
    state->output[j] = voltage;
  }
  sum_up(bearing, state);
  anhyst_plant_sensor_start(&state->current_sensing[j], current);
  anhyst_plant_sensor_start(&state->hall_sensing[j], coil->density);
  anhyst_plant_sensor_start(&state->force_sensing, state->force);
}

/* One amplifier and its winding. */
static void winding_step(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, int j,
                         double seconds)
{
  const anhyst_plant_amplifier *amplifier = &bearing->amplifier;
  anhyst_plant_source source = {0.0, 0.0, 0.0, 0.0, 0.0};
  source.limit = amplifier->limit;
  if (amplifier->gain > 0.0) {
    source.reference = state->output[j];
    source.gain = amplifier->gain;
    source.reset = amplifier->reset;
  } else {
    source.voltage = state->output[j];
  }
  anhyst_plant_coil_step(&bearing->magnet[j], &state->coil[j], &source, gap_of(bearing, state, j),
                         seconds);
}

/* All that pushes the armature now, but for damping. */
static double pushed(const anhyst_plant_bearing *bearing, const anhyst_plant_state *state,
                     double *damping)
{
  const double over = state->gap > bearing->stop_high  ? state->gap - bearing->stop_high
                      : state->gap < bearing->stop_low ? state->gap - bearing->stop_low
                                                       : 0.0;
  *damping = bearing->damping;
  if (over > 0.0 || over < 0.0) {
    *damping += bearing->stop_damping;
  }
  return state->load + bearing->mass * bearing->gravity - state->force -
         bearing->stop_stiffness * over;
}

static void magnets_step(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                         double seconds)
{
  int j;
  for (j = 0; j < bearing->magnets; j++) {
    const double current = state->coil[j].current;
    const double density = state->coil[j].density;
    winding_step(bearing, state, j, seconds);
    anhyst_plant_sensor_follow(&bearing->current_sensor, &state->current_sensing[j], current,
                               state->coil[j].current);
    anhyst_plant_sensor_follow(&bearing->hall_probe, &state->hall_sensing[j], density,
                               state->coil[j].density);
  }
  sum_up(bearing, state);
}

static void substep(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                    double load_command)
{
  const double seconds = bearing->tick / (double)bearing->substeps;
  const double push = 0.5 * seconds / bearing->mass;
  const double gap = state->gap;
  const double force = state->force;
  double damping;
  double pushing;
  if (state->due[state->at]) {
    memcpy(state->output, state->line[state->at], sizeof state->output);
    state->due[state->at] = 0;
  }
  state->at = (state->at + 1U) & MASK;
  pushing = pushed(bearing, state, &damping);
  state->velocity += push * (pushing - damping * state->velocity);
  state->gap += seconds * (state->velocity - state->frame_velocity);
  magnets_step(bearing, state, seconds);
  state->load += bearing->load.share * (load_command - state->load);
  pushing = pushed(bearing, state, &damping);
  state->velocity = (state->velocity + push * pushing) / (1.0 + push * damping);
  anhyst_plant_sensor_follow(&bearing->gap_sensor, &state->gap_sensing, gap, state->gap);
  anhyst_plant_sensor_follow(&bearing->force_sensor, &state->force_sensing, force, state->force);
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

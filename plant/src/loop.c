/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/loop.h"

#include <math.h>
#include <string.h>

/* Voltages that bring the currents to their references. */
static void control_currents(anhyst_plant_loop *loop, const double *reference, const double *read,
                             double *command)
{
  const anhyst_plant_current_loop *c = &loop->current_loop;
  int j;
  for (j = 0; j < loop->bearing->magnets; j++) {
    const double error = reference[j] - read[j];
    const double wanted = c->resistance * reference[j] + c->gain * error + loop->integral[j];
    command[j] = anhyst_plant_bound(wanted, -c->limit, c->limit);
    if (fabs(wanted) < c->limit) {
      loop->integral[j] += c->reset * error;
    }
  }
}

static void write_row(const anhyst_plant_loop *loop, const anhyst_loop_sample *sample,
                      const anhyst_loop_answer *answer, double *row)
{
  const anhyst_plant_state *s = loop->state;
  row[0] = (double)loop->ticks * loop->bearing->tick;
  row[1] = answer->reference;
  row[2] = s->gap;
  row[3] = sample->gap;
  row[4] = s->velocity;
  row[5] = answer->demand;
  row[6] = s->force;
  row[7] = s->load;
  row[8] = answer->current[0];
  row[9] = s->coil[0].current;
  row[10] = sample->current[0];
  row[11] = s->coil[0].voltage;
  row[12] = s->coil[0].psi;
  row[13] = s->coil[0].density;
  row[14] = answer->current[1];
  row[15] = s->coil[1].current;
  row[16] = (double)answer->state;
  row[17] = (double)answer->flags;
}

static void take_sample(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t i,
                        anhyst_loop_sample *sample)
{
  anhyst_plant_readings readings;
  int j;
  anhyst_plant_read(loop->bearing, loop->state, &readings);
  memset(sample, 0, sizeof *sample);
  sample->gap = readings.gap + events->inject[i];
  sample->position =
      loop->state->gap + (events->frame ? events->frame[i] : 0.0) + events->inject[i];
  for (j = 0; j < ANHYST_PLANT_MAGNETS; j++) {
    sample->current[j] = readings.current[j];
    sample->flux[j] = loop->has_hall ? readings.density[j] : (double)NAN;
  }
  sample->target = events->target[i];
  sample->load = events->feed[i];
  sample->inject = events->inject[i];
  sample->command = events->command[i] & 0xFFU;
  if (events->command[i] & ANHYST_LOOP_DROP) {
    sample->gap = (double)NAN;
  }
}

size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record)
{
  const anhyst_plant_bearing *bearing = loop->bearing;
  size_t i;
  for (i = 0; i < n; i++) {
    anhyst_loop_sample sample;
    anhyst_loop_answer answer;
    double command[ANHYST_PLANT_MAGNETS];
    memset(&answer, 0, sizeof answer);
    take_sample(loop, events, i, &sample);
    loop->controller.tick(loop->controller.self, &sample, &answer);
    if (answer.gone) {
      return i;
    }
    write_row(loop, &sample, &answer, record + i * ANHYST_LOOP_COLUMNS);
    memcpy(command, answer.current, sizeof command);
    if (loop->current_loop.gain > 0.0) {
      control_currents(loop, command, sample.current, command);
    }
    if (events->frame) {
      loop->state->frame_velocity = (events->frame[i + 1] - events->frame[i]) / bearing->tick;
    }
    anhyst_plant_advance(bearing, loop->state, command, events->load[i]);
    loop->ticks++;
    if (!isfinite(loop->state->gap)) {
      return i + 1;
    }
  }
  return n;
}

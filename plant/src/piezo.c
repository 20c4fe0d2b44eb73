/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/piezo.h"

#include <math.h>

static void run_step(const anhyst_piezo *p, anhyst_piezo_state *s, double command, double load)
{
  const double before = s->voltage;
  const double h = s->hysteresis;
  double free_stack;
  double target = 0.0;
  double change;
  int j;
  s->voltage = command + p->kept * (before - command);
  change = s->voltage - before;
  s->hysteresis += change * p->slope - p->beta * fabs(change) * h - p->gamma * change * fabs(h);
  free_stack =
      p->stroke_per_volt * s->voltage + p->bend * (s->voltage * s->voltage) - s->hysteresis;
  for (j = 0; j < p->creeps; j++) {
    s->creep[j] += p->step / p->creep_time[j] * (p->creep_share[j] * free_stack - s->creep[j]);
    target += s->creep[j];
  }
  target = free_stack + target + load;
  s->velocity += p->step * (p->omega * p->omega * (target - s->place) -
                            2.0 * p->damping * p->omega * s->velocity);
  s->place += p->step * s->velocity;
}

void anhyst_piezo_advance(const anhyst_piezo *piezo, anhyst_piezo_state *state, double command,
                          double load)
{
  int i;
  for (i = 0; i < piezo->steps; i++) {
    run_step(piezo, state, command, load);
  }
}

void anhyst_piezo_loop_tick(anhyst_piezo_loop *loop, const anhyst_piezo_event *event, double *row)
{
  const double step = loop->sensor_step;
  const double place = loop->state.place;
  const double noisy_place = place + event->noise;
  const double read = step > 0.0 ? floor(noisy_place / step + 0.5) * step : noisy_place;
  const anhyst_tracking_answer answer =
      anhyst_tracking_tick(loop->controller, event->expected - read, event->wanted);
  anhyst_piezo_advance(loop->piezo, &loop->state, loop->command, event->load);
  loop->command = answer.output;
  row[ANHYST_PIEZO_PLACE] = place;
  row[ANHYST_PIEZO_READ] = read;
  row[ANHYST_PIEZO_DEMAND] = answer.demand;
  row[ANHYST_PIEZO_COMMAND] = answer.output;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/loop.h"

#include <math.h>
#include <string.h>

const anhyst_plant_signal_row anhyst_plant_signals[ANHYST_LOOP_SIGNALS] = {
    {"t", "s", "s", ANHYST_LOOP_ONE},
    {"reference", "m", "rad", ANHYST_LOOP_A_COORDINATE},
    {"pose", "m", "rad", ANHYST_LOOP_A_COORDINATE},
    {"velocity", "m_per_s", "rad_per_s", ANHYST_LOOP_A_COORDINATE},
    {"demand", "N", "N_m", ANHYST_LOOP_A_COORDINATE},
    {"wrench", "N", "N_m", ANHYST_LOOP_A_COORDINATE},
    {"gap_read", "m", "m", ANHYST_LOOP_A_HEAD},
    {"force", "N", "N", ANHYST_LOOP_ONE},
    {"load", "N", "N", ANHYST_LOOP_ONE},
    {"gap", "m", "m", ANHYST_LOOP_A_MAGNET},
    {"command", "A", "A", ANHYST_LOOP_A_MAGNET},
    {"current", "A", "A", ANHYST_LOOP_A_MAGNET},
    {"current_read", "A", "A", ANHYST_LOOP_A_MAGNET},
    {"voltage", "V", "V", ANHYST_LOOP_A_MAGNET},
    {"flux", "Wb", "Wb", ANHYST_LOOP_A_MAGNET},
    {"flux_density", "T", "T", ANHYST_LOOP_A_MAGNET},
    {"state", "", "", ANHYST_LOOP_ONE},
    {"flags", "", "", ANHYST_LOOP_ONE},
};

int anhyst_plant_signal_count(const anhyst_plant_body *body, anhyst_plant_signal signal)
{
  switch (anhyst_plant_signals[signal].shape) {
  case ANHYST_LOOP_A_COORDINATE:
    return body->coordinates;
  case ANHYST_LOOP_A_HEAD:
    return body->heads;
  case ANHYST_LOOP_A_MAGNET:
    return body->magnets;
  default:
    return 1;
  }
}

int anhyst_plant_signal_column(const anhyst_plant_body *body, anhyst_plant_signal signal)
{
  int column = 0;
  int before;
  for (before = 0; before < (int)signal; before++) {
    column += anhyst_plant_signal_count(body, (anhyst_plant_signal)before);
  }
  return column;
}

/* One of the numbers of a signal. */
static double value_of(const anhyst_plant_loop *loop, const anhyst_loop_sample *sample,
                       const anhyst_loop_answer *answer, anhyst_plant_signal signal, int j)
{
  const anhyst_plant_body *body = loop->body;
  const anhyst_plant_state *s = loop->state;
  switch (signal) {
  case ANHYST_LOOP_TIME:
    return (double)loop->ticks * body->tick;
  case ANHYST_LOOP_REFERENCE:
    return answer->reference[j];
  case ANHYST_LOOP_POSE:
    return s->pose[body->coordinate[j].axis];
  case ANHYST_LOOP_VELOCITY:
    return s->velocity[body->coordinate[j].axis];
  case ANHYST_LOOP_DEMAND:
    return answer->demand[j];
  case ANHYST_LOOP_WRENCH:
    return s->wrench[body->coordinate[j].axis];
  case ANHYST_LOOP_GAP_READ:
    return sample->head[j];
  case ANHYST_LOOP_FORCE:
    return s->force;
  case ANHYST_LOOP_LOAD:
    return s->load;
  case ANHYST_LOOP_GAP:
    return s->actuator[j].gap;
  case ANHYST_LOOP_COMMAND:
    return answer->current[j];
  case ANHYST_LOOP_CURRENT:
    return s->actuator[j].coil.current;
  case ANHYST_LOOP_CURRENT_READ:
    return sample->current[j];
  case ANHYST_LOOP_VOLTAGE:
    return s->actuator[j].coil.voltage;
  case ANHYST_LOOP_FLUX:
    return s->actuator[j].coil.psi;
  case ANHYST_LOOP_DENSITY:
    return s->actuator[j].coil.density;
  case ANHYST_LOOP_STATE:
    return (double)answer->state;
  default:
    return (double)answer->flags;
  }
}

static double *write_row(const anhyst_plant_loop *loop, const anhyst_loop_sample *sample,
                         const anhyst_loop_answer *answer, double *row)
{
  int signal;
  int j;
  for (signal = 0; signal < (int)ANHYST_LOOP_SIGNALS; signal++) {
    const int count = anhyst_plant_signal_count(loop->body, (anhyst_plant_signal)signal);
    for (j = 0; j < count; j++) {
      *row++ = value_of(loop, sample, answer, (anhyst_plant_signal)signal, j);
    }
  }
  return row;
}

/* The sample's arrays in the loop's room. */
typedef struct {
  double *current;
  double *flux;
  double *head;
  double *position;
} taken;

static void take_sample(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t i,
                        const taken *into, anhyst_loop_sample *sample)
{
  const anhyst_plant_body *body = loop->body;
  const size_t row = i * (size_t)body->coordinates;
  const double *inject = events->inject + row;
  anhyst_plant_readings readings = {into->head, into->current, into->flux, 0.0};
  double away[ANHYST_PLANT_AXES] = {0.0};
  int j;
  anhyst_plant_read(body, loop->state, &readings);
  for (j = 0; j < body->coordinates; j++) {
    const int axis = body->coordinate[j].axis;
    away[axis] = inject[j];
    into->position[j] = loop->state->pose[axis] +
                        (events->frame ? events->frame[row + (size_t)j] : 0.0) + inject[j];
  }
  for (j = 0; j < body->heads; j++) {
    into->head[j] = events->command[i] & ANHYST_LOOP_DROP
                        ? (double)NAN
                        : into->head[j] + anhyst_plant_moved(&body->head[j].line, away);
  }
  sample->magnets = body->magnets;
  sample->heads = body->heads;
  sample->coordinates = body->coordinates;
  sample->head = into->head;
  sample->position = into->position;
  sample->current = into->current;
  sample->flux = into->flux;
  sample->target = events->target + row;
  sample->load = events->feed + row;
  sample->inject = inject[0];
  sample->command = events->command[i] & 0xFFU;
}

/* What the amplifiers are given: currents, or voltages that bring them to their references. */
static void to_amplifiers(anhyst_plant_loop *loop, const double *reference, const double *read,
                          double *command)
{
  int j;
  for (j = 0; j < loop->body->magnets; j++) {
    anhyst_plant_current_loop *c = &loop->current_loop[j];
    command[j] = reference[j];
    if (c->gain > 0.0) {
      const double error = reference[j] - read[j];
      const double wanted = c->resistance * reference[j] + c->gain * error + c->integral;
      command[j] = anhyst_plant_bound(wanted, -c->limit, c->limit);
      if (fabs(wanted) < c->limit) {
        c->integral += c->reset * error;
      }
    }
  }
}

static void move_frame(anhyst_plant_loop *loop, const double *now)
{
  const anhyst_plant_body *body = loop->body;
  int j;
  for (j = 0; j < body->coordinates; j++) {
    loop->state->frame_velocity[body->coordinate[j].axis] =
        (now[body->coordinates + j] - now[j]) / body->tick;
  }
}

static int finite(const anhyst_plant_state *state)
{
  int axis;
  int found = 1;
  for (axis = 0; axis < ANHYST_PLANT_AXES; axis++) {
    found = found && isfinite(state->pose[axis]);
  }
  return found;
}

size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record)
{
  const anhyst_plant_body *body = loop->body;
  const size_t magnets = (size_t)body->magnets;
  const size_t coordinates = (size_t)body->coordinates;
  double *command = loop->room;
  double *flux = command + magnets;
  const taken into = {flux + magnets, flux, flux + 2 * magnets,
                      flux + 2 * magnets + (size_t)body->heads};
  double *answered = into.position + coordinates;
  size_t i;
  for (i = 0; i < n; i++) {
    anhyst_loop_sample sample;
    anhyst_loop_answer answer = {
        answered, answered + magnets, answered + magnets + coordinates, 0, 0, 0};
    memset(answered, 0, (magnets + 2 * coordinates) * sizeof *answered);
    take_sample(loop, events, i, &into, &sample);
    loop->controller.tick(loop->controller.self, &sample, &answer);
    if (answer.gone) {
      return i;
    }
    record = write_row(loop, &sample, &answer, record);
    to_amplifiers(loop, answer.current, sample.current, command);
    if (events->frame) {
      move_frame(loop, events->frame + i * coordinates);
    }
    anhyst_plant_advance(body, loop->state, command, events->load[i]);
    loop->ticks++;
    if (!finite(loop->state)) {
      return i + 1;
    }
  }
  return n;
}

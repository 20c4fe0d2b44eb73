/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/loop.h"

#include <math.h>
#include <string.h>

#define SIGNAL_COUNTS(body) {1, (body)->coordinates, (body)->heads, (body)->magnets}

#define DESCRIBE_SIGNAL(name, text, unit, angular, shape, value)                                   \
  {text, unit, angular, ANHYST_EACH_##shape},
const anhyst_plant_signal_row anhyst_plant_signals[ANHYST_LOOP_SIGNALS] = {
    ANHYST_LOOP_SIGNAL_TABLE(DESCRIBE_SIGNAL)};

int anhyst_plant_signal_count(const anhyst_plant_body *body, anhyst_plant_signal signal)
{
  const int counts[] = SIGNAL_COUNTS(body);
  return counts[anhyst_plant_signals[signal].shape];
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

static double *write_row(const anhyst_plant_loop *loop, const anhyst_loop_sample *sample,
                         const anhyst_loop_answer *answer, double *row)
{
  const anhyst_plant_body *body = loop->body;
  const anhyst_plant_state *s = loop->state;
  const int counts[] = SIGNAL_COUNTS(body);
  int j;
#define WRITE_SIGNAL(name, text, unit, angular, shape, value)                                      \
  for (j = 0; j < counts[ANHYST_EACH_##shape]; j++) {                                              \
    *row++ = (value);                                                                              \
  }
  ANHYST_LOOP_SIGNAL_TABLE(WRITE_SIGNAL)
  return row;
}

static void make_sample(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t i,
                        anhyst_loop_sample *sample)
{
  const anhyst_plant_body *body = loop->body;
  const size_t row = i * (size_t)body->coordinates;
  const double *inject = events->inject + row;
  double *current = loop->room + body->magnets; /* current readings */
  double *flux = current + body->magnets;
  double *head = flux + body->magnets;
  double *position = head + body->heads;
  double *last = position + body->magnets + (ptrdiff_t)3 * body->coordinates; /* last readings */
  const uint32_t command = events->command[i];
  int has_failed;
  anhyst_plant_readings readings = {head, current, flux, 0.0};
  double injected[ANHYST_PLANT_AXES] = {0.0};
  double injected_with_frame[ANHYST_PLANT_AXES] = {0.0}; /* frame position plus disturbance */
  int j;
  anhyst_plant_read(body, loop->state, &readings);
  for (j = 0; j < body->coordinates; j++) {
    const int axis = body->coordinate[j].axis;
    injected[axis] = inject[j];
    injected_with_frame[axis] = inject[j] + (events->frame ? events->frame[row + (size_t)j] : 0.0);
    position[j] = loop->state->pose[axis] + (events->frame ? events->frame[row + (size_t)j] : 0.0) +
                  inject[j];
  }
  for (j = 0; j < body->heads; j++) {
    head[j] += anhyst_plant_displacement(
        &body->head[j].line,
        body->head[j].base == ANHYST_PLANT_BODY ? injected_with_frame : injected);
    has_failed = command & ANHYST_INJECT_HEAD_FAULTS && j >= body->magnets &&
                 command >> ANHYST_INJECT_FIRST_FAULT_BIT >> (j - body->magnets) & 1U;
    if (command & ANHYST_INJECT_HEAD_DROPOUT || (has_failed && command & ANHYST_INJECT_HEAD_NAN)) {
      head[j] = (double)NAN;
    } else if (has_failed) {
      head[j] = command & ANHYST_INJECT_FROZEN_HEAD ? last[j] : head[j] + ANHYST_INJECTED_JUMP_M;
    }
    last[j] = head[j];
  }
  sample->magnets = body->magnets;
  sample->heads = body->heads;
  sample->coordinates = body->coordinates;
  sample->head = head;
  sample->position = position;
  sample->current = current;
  sample->flux = flux;
  sample->target = events->target + row;
  sample->load = events->feed + row;
  sample->command = command & 0xFFU;
}

/* Sets the commands of the amplifiers: currents, or voltages from the current controllers. */
static void set_commands(anhyst_plant_loop *loop, const double *reference, const double *read,
                         double *command)
{
  int j;
  for (j = 0; j < loop->body->magnets; j++) {
    anhyst_plant_current_loop *c = &loop->current_loop[j];
    command[j] = reference[j];
    if (c->gain > 0.0) {
      const double error = reference[j] - read[j];
      const double unlimited = c->resistance * reference[j] + c->gain * error + c->integral;
      command[j] = anhyst_plant_limit_to_range(unlimited, -c->limit, c->limit);
      if (fabs(unlimited) < c->limit) {
        c->integral += c->reset * error;
      }
    }
  }
}

/* Sets the failures of the amplifiers from this tick on. */
static void set_failures(anhyst_plant_loop *loop, uint32_t command)
{
  int j;
  for (j = 0; j < loop->body->magnets && j < 16; j++) {
    const uint32_t has_failed = command & ANHYST_INJECT_HEAD_FAULTS
                                    ? 0U
                                    : command >> (ANHYST_INJECT_FIRST_FAULT_BIT + j) & 1U;
    loop->state->actuator[j].failure = has_failed == 0U                        ? ANHYST_PLANT_WORKS
                                       : command & ANHYST_INJECT_SHORT_CIRCUIT ? ANHYST_PLANT_SHORT
                                                                               : ANHYST_PLANT_OPEN;
  }
}

size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record)
{
  const anhyst_plant_body *body = loop->body;
  const size_t magnets = (size_t)body->magnets;
  const size_t coordinates = (size_t)body->coordinates;
  const double *q = loop->state->pose;
  double *command = loop->room;
  double *answer_arrays = command + 3 * magnets + (size_t)body->heads + coordinates;
  size_t i;
  size_t j;
  for (i = 0; i < n; i++) {
    anhyst_loop_sample sample;
    anhyst_loop_answer answer = {
        answer_arrays, answer_arrays + magnets, answer_arrays + magnets + coordinates, 0, 0, 0};
    memset(answer_arrays, 0, (magnets + 2 * coordinates) * sizeof *answer_arrays);
    if (events->frame && loop->ticks == 0) {
      anhyst_plant_ride(body, loop->state, events->frame);
    }
    make_sample(loop, events, i, &sample);
    loop->controller.tick(loop->controller.self, &sample, &answer);
    if (answer.gone) {
      return i;
    }
    record = write_row(loop, &sample, &answer, record);
    set_commands(loop, answer.current, sample.current, command);
    set_failures(loop, events->command[i]);
    for (j = 0; events->frame && j < coordinates; j++) {
      const double *now = events->frame + i * coordinates + j;
      const int axis = body->coordinate[j].axis;
      loop->state->frame[axis] = now[0]; /* reset, to prevent accumulated rounding errors */
      loop->state->frame_velocity[axis] = (now[coordinates] - now[0]) / body->tick;
    }
    anhyst_plant_advance(body, loop->state, command, events->load[i]);
    loop->ticks++;
    if (!isfinite(q[0] + q[1] + q[2] + q[3] + q[4] + q[5])) {
      return i + 1;
    }
  }
  return n;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "component.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "part.h"
#include "part_values.h"

#define ROUNDING 1e-6 /* tolerance in ticks, because times are sums of steps */
#define FIRST_OUTPUT (1 + PART_INPUTS)

/* Head of a byte array; the state of the part follows it. */
typedef union {
  struct {
    anhyst_phase phase;
    double start;               /* time of the first tick, s */
    double ticks;               /* ticks done since the start; an integer */
    double values[PART_VALUES]; /* the time, inputs, outputs, constants */
  } of;
  long double widest; /* aligns the state that follows for any type */
} snapshot;

struct anhyst_component {
  void *tables;
  snapshot *now;
};

static const double first_values[PART_VALUES] = PART_FIRST_VALUES;

static size_t snapshot_size(void) { return sizeof(snapshot) + anhyst_the_part.state; }

const char *anhyst_component_token(void) { return PART_TOKEN; }

anhyst_component *anhyst_component_new(void)
{
  anhyst_component *created = (anhyst_component *)calloc(1, sizeof *created);
  if (created == NULL) {
    return NULL;
  }
  created->tables = calloc(1, anhyst_the_part.tables > 0 ? anhyst_the_part.tables : 1);
  created->now = (snapshot *)calloc(1, snapshot_size());
  if (created->tables == NULL || created->now == NULL ||
      (anhyst_the_part.build != NULL && anhyst_the_part.build(created->tables) != 0) ||
      anhyst_component_reset(created) != NULL) {
    anhyst_component_free(created);
    return NULL;
  }
  return created;
}

void anhyst_component_free(anhyst_component *component)
{
  if (component == NULL) {
    return;
  }
  if (component->tables != NULL && anhyst_the_part.drop != NULL) {
    anhyst_the_part.drop(component->tables);
  }
  free(component->tables);
  free(component->now);
  free(component);
}

/* Sets the state at time 0, with the present inputs. */
static const char *start(anhyst_component *component)
{
  snapshot *now = component->now;
  (void)memset(now + 1, 0, anhyst_the_part.state);
  const int bad = anhyst_the_part.start(component->tables, now + 1, now->of.values);
  return bad == 0 ? NULL : "the parameters are damaged";
}

const char *anhyst_component_reset(anhyst_component *component)
{
  (void)memset(component->now, 0, snapshot_size());
  (void)memcpy(component->now->of.values, first_values, sizeof first_values);
  return start(component);
}

const char *anhyst_component_begin(anhyst_component *component, double start)
{
  snapshot *now = component->now;
  if (now->of.phase != ANHYST_PHASE_MADE) {
    return "only an instance that is new or reset can be initialised";
  }
  if (!isfinite(start)) {
    return "the start time is not a number";
  }
  now->of.phase = ANHYST_PHASE_INITIALISING;
  now->of.start = start;
  now->of.values[0] = start;
  return NULL;
}

const char *anhyst_component_run(anhyst_component *component)
{
  if (component->now->of.phase != ANHYST_PHASE_INITIALISING) {
    return "initialisation cannot end before it has begun";
  }
  component->now->of.phase = ANHYST_PHASE_RUNNING;
  return NULL;
}

const char *anhyst_component_end(anhyst_component *component)
{
  if (component->now->of.phase != ANHYST_PHASE_RUNNING) {
    return "only an instance that runs can be terminated";
  }
  component->now->of.phase = ANHYST_PHASE_TERMINATED;
  return NULL;
}

int anhyst_component_is_in_phase(const anhyst_component *component, anhyst_phase phase)
{
  return component->now->of.phase == phase;
}

const char *anhyst_component_get(const anhyst_component *component, const unsigned *at, size_t n,
                                 double *values)
{
  for (size_t i = 0; i < n; i++) {
    if (at[i] >= PART_VALUES) {
      return "no such variable";
    }
    values[i] = component->now->of.values[at[i]];
  }
  return NULL;
}

const char *anhyst_component_set(anhyst_component *component, const unsigned *at, size_t n,
                                 const double *values)
{
  for (size_t i = 0; i < n; i++) {
    if (at[i] < 1 || at[i] >= FIRST_OUTPUT) {
      return "no such input";
    }
    if (!isfinite(values[i])) {
      return "an input is not a finite number";
    }
  }
  for (size_t i = 0; i < n; i++) {
    component->now->of.values[at[i]] = values[i];
  }
  return component->now->of.phase <= ANHYST_PHASE_INITIALISING ? start(component) : NULL;
}

const char *anhyst_component_step(anhyst_component *component, double now, double step)
{
  snapshot *m = component->now;
  const double until = now + step;
  const double due = (until - m->of.start) * PART_RATE;
  const char *why = NULL;
  if (m->of.phase != ANHYST_PHASE_RUNNING) {
    return "a step needs an instance that has been initialised";
  }
  if (!(step >= 0.0) || !isfinite(until)) {
    return "a step must be a number of seconds, not below 0";
  }
  if (due - m->of.ticks > ANHYST_STEP_TICKS) {
    return "a step of more than 1e9 ticks";
  }
  if (!(PART_RATE > 0.0) && step > 0.0) {
    why = anhyst_the_part.tick(component->tables, m + 1, m->of.values, step);
  }
  while (why == NULL && PART_RATE > 0.0 && due > m->of.ticks + ROUNDING) {
    why = anhyst_the_part.tick(component->tables, m + 1, m->of.values, 1.0 / PART_RATE);
    m->of.ticks += why == NULL ? 1.0 : 0.0;
  }
  if (why == NULL) {
    m->of.values[0] = until;
  }
  return why;
}

const char *anhyst_component_save(const anhyst_component *component, void **state)
{
  if (*state == NULL) {
    *state = malloc(snapshot_size());
  }
  if (*state == NULL) {
    return "not enough memory for a state";
  }
  (void)memcpy(*state, component->now, snapshot_size());
  return NULL;
}

const char *anhyst_component_restore(anhyst_component *component, const void *state)
{
  if (state == NULL) {
    return "there is no such state";
  }
  (void)memcpy(component->now, state, snapshot_size());
  anhyst_the_part.relink(component->tables, component->now + 1);
  return NULL;
}

void anhyst_component_forget(void **state)
{
  free(*state);
  *state = NULL;
}

size_t anhyst_component_bytes(void) { return sizeof PART_TOKEN + snapshot_size(); }

const char *anhyst_component_write(const void *state, unsigned char *bytes, size_t n)
{
  if (state == NULL || n < anhyst_component_bytes()) {
    return "no state, or too few bytes for it";
  }
  (void)memcpy(bytes, PART_TOKEN, sizeof PART_TOKEN);
  (void)memcpy(bytes + sizeof PART_TOKEN, state, snapshot_size());
  return NULL;
}

const char *anhyst_component_read(const unsigned char *bytes, size_t n, void **state)
{
  if (n != anhyst_component_bytes() || memcmp(bytes, PART_TOKEN, sizeof PART_TOKEN) != 0) {
    return "the bytes are no state of this component";
  }
  if (*state == NULL) {
    *state = malloc(snapshot_size());
  }
  if (*state == NULL) {
    return "not enough memory for a state";
  }
  (void)memcpy(*state, bytes + sizeof PART_TOKEN, snapshot_size());
  return NULL;
}

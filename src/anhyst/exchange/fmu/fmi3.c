/* SPDX-License-Identifier: Apache-2.0 */
/* FMI 3.0 for co-simulation around a component. */
#include <stdlib.h>
#include <string.h>

#include "actuator.h"
#include "component.h"
#include "fmi/fmi3Functions.h"

typedef struct {
  anhyst_component component;
  fmi3LogMessageCallback log;
  fmi3InstanceEnvironment environment;
} instance;

static fmi3Status refuse(const instance *self, const char *why)
{
  if (self->log != NULL) {
    self->log(self->environment, fmi3Error, "logStatusError", why);
  }
  return fmi3Error;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
  (void)c;
  (void)on;
  (void)n;
  (void)names;
  return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place,
                                         fmi3Boolean visible, fmi3Boolean on, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference wanted[],
                                         size_t n, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
  instance *self = NULL;
  (void)name;
  (void)place;
  (void)visible;
  (void)on;
  (void)events;
  (void)early;
  (void)wanted;
  (void)n;
  (void)update;
  if (token == NULL || strcmp(token, ACTUATOR_TOKEN) != 0) {
    return NULL;
  }
  self = (instance *)calloc(1, sizeof *self);
  if (self == NULL) {
    return NULL;
  }
  self->log = log;
  self->environment = environment;
  if (anhyst_component_start(&self->component) != 0) {
    (void)refuse(self, "the parameters are damaged");
    free(self);
    return NULL;
  }
  return self;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
  instance *self = (instance *)c;
  (void)defined;
  (void)tolerance;
  (void)ends;
  (void)stop;
  self->component.start = start;
  self->component.time = start;
  return fmi3OK;
}

/* Modes that this component is always ready to enter or leave. */
#define NOTHING_TO_DO(name)                                                                        \
  fmi3Status name(fmi3Instance c) { return c == NULL ? fmi3Error : fmi3OK; }

NOTHING_TO_DO(fmi3ExitInitializationMode)
NOTHING_TO_DO(fmi3EnterEventMode)
NOTHING_TO_DO(fmi3EnterStepMode)
NOTHING_TO_DO(fmi3EnterConfigurationMode)
NOTHING_TO_DO(fmi3ExitConfigurationMode)
NOTHING_TO_DO(fmi3EvaluateDiscreteStates)
NOTHING_TO_DO(fmi3Terminate)

fmi3Status fmi3Reset(fmi3Instance c)
{
  instance *self = (instance *)c;
  return anhyst_component_start(&self->component) == 0 ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                          fmi3Float64 value[], size_t values)
{
  const instance *self = (const instance *)c;
  for (size_t i = 0; i < n && i < values; i++) {
    if (anhyst_component_get(&self->component, at[i], &value[i]) != 0) {
      return refuse(self, "no such variable");
    }
  }
  return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                          const fmi3Float64 value[], size_t values)
{
  instance *self = (instance *)c;
  for (size_t i = 0; i < n && i < values; i++) {
    if (anhyst_component_set(&self->component, at[i], value[i]) != 0) {
      return refuse(self, "no such input");
    }
  }
  return fmi3OK;
}

static fmi3Status none(const void *c, size_t n)
{
  return n == 0 ? fmi3OK : refuse((const instance *)c, "no such variable");
}

/* There are no variables of these kinds. */
#define NO_VARIABLES(kind)                                                                         \
  fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference at[], size_t n,                \
                           fmi3##kind value[], size_t values)                                      \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    (void)values;                                                                                  \
    return none(c, n);                                                                             \
  }                                                                                                \
  fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference at[], size_t n,                \
                           const fmi3##kind value[], size_t values)                                \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    (void)values;                                                                                  \
    return none(c, n);                                                                             \
  }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference at[], size_t n, size_t sizes[],
                         fmi3Binary value[], size_t values)
{
  (void)at;
  (void)sizes;
  (void)value;
  (void)values;
  return none(c, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                         const size_t sizes[], const fmi3Binary value[], size_t values)
{
  (void)at;
  (void)sizes;
  (void)value;
  (void)values;
  return none(c, n);
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference at[], size_t n, fmi3Clock value[])
{
  (void)at;
  (void)value;
  return none(c, n);
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                        const fmi3Clock value[])
{
  (void)at;
  (void)value;
  return none(c, n);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference at, size_t *n)
{
  (void)at;
  *n = 0;
  return none(c, 1);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference at, size_t elements[],
                                       fmi3ValueReference from[], size_t of[],
                                       fmi3DependencyKind kinds[], size_t n)
{
  (void)at;
  (void)elements;
  (void)from;
  (void)of;
  (void)kinds;
  return none(c, n);
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
  const instance *self = (const instance *)c;
  if (*state == NULL) {
    *state = malloc(sizeof self->component);
  }
  if (*state == NULL) {
    return refuse(self, "not enough memory for a state");
  }
  (void)memcpy(*state, &self->component, sizeof self->component);
  return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
  anhyst_component_restore(&((instance *)c)->component, (const anhyst_component *)state);
  return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
  (void)c;
  free(*state);
  *state = NULL;
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
  (void)c;
  (void)state;
  *size = sizeof(anhyst_component);
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
  if (size < sizeof(anhyst_component)) {
    return refuse((const instance *)c, "too few bytes for a state");
  }
  (void)memcpy(bytes, state, sizeof(anhyst_component));
  return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
  if (size < sizeof(anhyst_component)) {
    return refuse((const instance *)c, "too few bytes for a state");
  }
  if (*state == NULL) {
    *state = malloc(sizeof(anhyst_component));
  }
  if (*state == NULL) {
    return refuse((const instance *)c, "not enough memory for a state");
  }
  (void)memcpy(*state, bytes, sizeof(anhyst_component));
  return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                        size_t unknowns, const fmi3ValueReference known[],
                                        size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 answer[], size_t answers)
{
  (void)unknown;
  (void)unknowns;
  (void)known;
  (void)knowns;
  (void)seed;
  (void)seeds;
  (void)answer;
  (void)answers;
  return refuse((const instance *)c, "a sampled controller has no derivative");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                    size_t unknowns, const fmi3ValueReference known[],
                                    size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 answer[], size_t answers)
{
  return fmi3GetDirectionalDerivative(c, unknown, unknowns, known, knowns, seed, seeds, answer,
                                      answers);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                    const fmi3Int32 order[], fmi3Float64 value[], size_t values)
{
  (void)at;
  (void)order;
  (void)value;
  (void)values;
  return none(c, n);
}

/* There are no clocks. */
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                  fmi3Float64 value[], fmi3IntervalQualifier kind[])
{
  (void)at;
  (void)value;
  (void)kind;
  return none(c, n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                   fmi3UInt64 count[], fmi3UInt64 of[],
                                   fmi3IntervalQualifier kind[])
{
  (void)at;
  (void)count;
  (void)of;
  (void)kind;
  return none(c, n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                               fmi3Float64 value[])
{
  (void)at;
  (void)value;
  return none(c, n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                fmi3UInt64 count[], fmi3UInt64 of[])
{
  (void)at;
  (void)count;
  (void)of;
  return none(c, n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                  const fmi3Float64 value[])
{
  (void)at;
  (void)value;
  return none(c, n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                   const fmi3UInt64 count[], const fmi3UInt64 of[])
{
  (void)at;
  (void)count;
  (void)of;
  return none(c, n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                               const fmi3Float64 value[])
{
  return fmi3SetIntervalDecimal(c, at, n, value);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                const fmi3UInt64 count[], const fmi3UInt64 of[])
{
  return fmi3SetIntervalFraction(c, at, n, count, of);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states,
                                    fmi3Boolean *defined, fmi3Float64 *next)
{
  (void)next;
  *again = fmi3False;
  *terminate = fmi3False;
  *nominals = fmi3False;
  *states = fmi3False;
  *defined = fmi3False;
  return c == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 step, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached)
{
  instance *self = (instance *)c;
  (void)no_return;
  if (!(step >= 0.0)) {
    return refuse(self, "a step cannot go back in time");
  }
  anhyst_component_advance(&self->component, now + step);
  *event = fmi3False;
  *terminate = fmi3False;
  *early = fmi3False;
  *reached = now + step;
  return fmi3OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* FMI 3.0 for co-simulation around a component. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "fmi/fmi3Functions.h"

typedef struct {
  anhyst_component *component;
  fmi3LogMessageCallback log;
  fmi3InstanceEnvironment environment;
} instance;

/* Returns OK if there is no text; otherwise logs the text and returns the status of an error. */
static fmi3Status to_status(const void *c, const char *fault)
{
  const instance *self = (const instance *)c;
  if (fault != NULL && self != NULL && self->log != NULL) {
    self->log(self->environment, fmi3Error, "logStatusError", fault);
  }
  return fault == NULL ? fmi3OK : fmi3Error;
}

static anhyst_component *component_of(fmi3Instance c) { return ((instance *)c)->component; }

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
  if (token == NULL || strcmp(token, anhyst_component_token()) != 0) {
    return NULL;
  }
  self = (instance *)calloc(1, sizeof *self);
  if (self == NULL) {
    return NULL;
  }
  self->log = log;
  self->environment = environment;
  self->component = anhyst_component_new();
  if (self->component == NULL) {
    (void)to_status(self, "not enough memory, or the parameters are damaged");
    free(self);
    return NULL;
  }
  return self;
}

void fmi3FreeInstance(fmi3Instance c)
{
  if (c != NULL) {
    anhyst_component_free(component_of(c));
    free(c);
  }
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
  (void)defined;
  (void)tolerance;
  (void)ends;
  (void)stop;
  return to_status(c, anhyst_component_begin(component_of(c), start));
}

/* This component can always enter and leave these modes. */
#define NOTHING_TO_DO(name)                                                                        \
  fmi3Status name(fmi3Instance c) { return c == NULL ? fmi3Error : fmi3OK; }

NOTHING_TO_DO(fmi3EnterEventMode)
NOTHING_TO_DO(fmi3EnterStepMode)
NOTHING_TO_DO(fmi3EnterConfigurationMode)
NOTHING_TO_DO(fmi3ExitConfigurationMode)
NOTHING_TO_DO(fmi3EvaluateDiscreteStates)

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
  return to_status(c, anhyst_component_run(component_of(c)));
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
  return to_status(c, anhyst_component_end(component_of(c)));
}

fmi3Status fmi3Reset(fmi3Instance c)
{
  return to_status(c, anhyst_component_reset(component_of(c)));
}

/* All variables are scalars. */
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                          fmi3Float64 value[], size_t values)
{
  return to_status(c, values == n ? anhyst_component_get(component_of(c), at, n, value)
                                  : "no array is here");
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                          const fmi3Float64 value[], size_t values)
{
  return to_status(c, values == n ? anhyst_component_set(component_of(c), at, n, value)
                                  : "no array is here");
}

static fmi3Status none(const void *c, size_t n)
{
  return to_status(c, n == 0 ? NULL : "no such variable");
}

/* The component has no variables of these types. */
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
                                       fmi3ValueReference from[], size_t component_of[],
                                       fmi3DependencyKind kinds[], size_t n)
{
  (void)at;
  (void)elements;
  (void)from;
  (void)component_of;
  (void)kinds;
  return none(c, n);
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
  return to_status(c, anhyst_component_save(component_of(c), state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
  return to_status(c, anhyst_component_restore(component_of(c), state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
  (void)c;
  anhyst_component_forget(state);
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
  (void)c;
  (void)state;
  *size = anhyst_component_bytes();
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
  return to_status(c, anhyst_component_write(state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
  return to_status(c, anhyst_component_read(bytes, size, state));
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
  return to_status(c, "what is sampled has no derivative");
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

/* The component has no clocks. */
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                  fmi3Float64 value[], fmi3IntervalQualifier kind[])
{
  (void)at;
  (void)value;
  (void)kind;
  return none(c, n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                   fmi3UInt64 count[], fmi3UInt64 component_of[],
                                   fmi3IntervalQualifier kind[])
{
  (void)at;
  (void)count;
  (void)component_of;
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
                                fmi3UInt64 count[], fmi3UInt64 component_of[])
{
  (void)at;
  (void)count;
  (void)component_of;
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
                                   const fmi3UInt64 count[], const fmi3UInt64 component_of[])
{
  (void)at;
  (void)count;
  (void)component_of;
  return none(c, n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                               const fmi3Float64 value[])
{
  return fmi3SetIntervalDecimal(c, at, n, value);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference at[], size_t n,
                                const fmi3UInt64 count[], const fmi3UInt64 component_of[])
{
  return fmi3SetIntervalFraction(c, at, n, count, component_of);
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
  const char *fault = anhyst_component_step(component_of(c), now, step);
  (void)no_return;
  *event = fmi3False;
  *terminate = fmi3False;
  *early = fmi3False;
  *reached = fault == NULL ? now + step : now;
  return to_status(c, fault);
}

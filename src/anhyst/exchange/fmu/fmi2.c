/* SPDX-License-Identifier: Apache-2.0 */
/* FMI 2.0 for co-simulation around a component. */
#include <stdlib.h>
#include <string.h>

#include "actuator.h"
#include "component.h"
#include "fmi/fmi2Functions.h"

typedef struct {
  anhyst_component component;
  fmi2CallbackLogger log;
  fmi2ComponentEnvironment environment;
  char name[64];
} instance;

static fmi2Status refuse(const instance *self, const char *why)
{
  if (self->log != NULL) {
    self->log(self->environment, self->name, fmi2Error, "logStatusError", why);
  }
  return fmi2Error;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
  (void)c;
  (void)on;
  (void)n;
  (void)names;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean on)
{
  instance *self = NULL;
  (void)place;
  (void)visible;
  (void)on;
  if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, ACTUATOR_TOKEN) != 0) {
    return NULL;
  }
  self = (instance *)calloc(1, sizeof *self);
  if (self == NULL) {
    return NULL;
  }
  self->log = functions == NULL ? NULL : functions->logger;
  self->environment = functions == NULL ? NULL : functions->componentEnvironment;
  if (name != NULL) {
    (void)strncpy(self->name, name, sizeof self->name - 1);
  }
  if (anhyst_component_start(&self->component) != 0) {
    (void)refuse(self, "the parameters are damaged");
    free(self);
    return NULL;
  }
  return self;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
  instance *self = (instance *)c;
  (void)defined;
  (void)tolerance;
  (void)ends;
  (void)stop;
  self->component.start = start;
  self->component.time = start;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c == NULL ? fmi2Error : fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c == NULL ? fmi2Error : fmi2OK; }

fmi2Status fmi2Terminate(fmi2Component c) { return c == NULL ? fmi2Error : fmi2OK; }

fmi2Status fmi2Reset(fmi2Component c)
{
  instance *self = (instance *)c;
  return anhyst_component_start(&self->component) == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference at[], size_t n, fmi2Real value[])
{
  const instance *self = (const instance *)c;
  for (size_t i = 0; i < n; i++) {
    if (anhyst_component_get(&self->component, at[i], &value[i]) != 0) {
      return refuse(self, "no such real variable");
    }
  }
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference at[], size_t n,
                       const fmi2Real value[])
{
  instance *self = (instance *)c;
  for (size_t i = 0; i < n; i++) {
    if (anhyst_component_set(&self->component, at[i], value[i]) != 0) {
      return refuse(self, "no such real input");
    }
  }
  return fmi2OK;
}

/* There are no variables of these kinds. */
#define NO_VARIABLES(kind, type)                                                                   \
  fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference at[], size_t n, type value[]) \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    return n == 0 ? fmi2OK : refuse((const instance *)c, "no such variable");                      \
  }                                                                                                \
  fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference at[], size_t n,               \
                           const type value[])                                                     \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    return n == 0 ? fmi2OK : refuse((const instance *)c, "no such variable");                      \
  }

NO_VARIABLES(Integer, fmi2Integer)
NO_VARIABLES(Boolean, fmi2Boolean)
NO_VARIABLES(String, fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  const instance *self = (const instance *)c;
  if (*state == NULL) {
    *state = malloc(sizeof self->component);
  }
  if (*state == NULL) {
    return refuse(self, "not enough memory for a state");
  }
  (void)memcpy(*state, &self->component, sizeof self->component);
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
  anhyst_component_restore(&((instance *)c)->component, (const anhyst_component *)state);
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  (void)c;
  free(*state);
  *state = NULL;
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  (void)c;
  (void)state;
  *size = sizeof(anhyst_component);
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  if (size < sizeof(anhyst_component)) {
    return refuse((const instance *)c, "too few bytes for a state");
  }
  (void)memcpy(bytes, state, sizeof(anhyst_component));
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
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
  return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real seed[], fmi2Real answer[])
{
  (void)unknown;
  (void)unknowns;
  (void)known;
  (void)knowns;
  (void)seed;
  (void)answer;
  return refuse((const instance *)c, "a sampled controller has no derivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
  (void)at;
  (void)order;
  (void)value;
  return n == 0 ? fmi2OK : refuse((const instance *)c, "inputs are held, not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
  (void)at;
  (void)order;
  (void)value;
  return n == 0 ? fmi2OK : refuse((const instance *)c, "outputs are held: no derivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean no_return)
{
  instance *self = (instance *)c;
  (void)no_return;
  if (!(step >= 0.0)) {
    return refuse(self, "a step cannot go back in time");
  }
  anhyst_component_advance(&self->component, now + step);
  return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
  return refuse((const instance *)c, "no step is ever pending");
}

/* Steps are done when they return. */
#define NO_STATUS(kind, type)                                                                      \
  fmi2Status fmi2Get##kind(fmi2Component c, const fmi2StatusKind what, type *value)                \
  {                                                                                                \
    (void)c;                                                                                       \
    (void)what;                                                                                    \
    (void)value;                                                                                   \
    return fmi2Discard;                                                                            \
  }

NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)

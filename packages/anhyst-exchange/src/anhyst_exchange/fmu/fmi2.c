/* SPDX-License-Identifier: Apache-2.0 */
/* FMI 2.0 for co-simulation around a component. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "fmi/fmi2Functions.h"

typedef struct {
  anhyst_component *component;
  fmi2CallbackLogger log;
  fmi2ComponentEnvironment environment;
  char name[64];
} instance;

/* Returns OK if there is no text; otherwise logs the text and returns the status of an error. */
static fmi2Status to_status(const void *c, const char *fault)
{
  const instance *self = (const instance *)c;
  if (fault != NULL && self != NULL && self->log != NULL) {
    self->log(self->environment, self->name, fmi2Error, "logStatusError", fault);
  }
  return fault == NULL ? fmi2OK : fmi2Error;
}

static anhyst_component *component_of(fmi2Component c) { return ((instance *)c)->component; }

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
  if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, anhyst_component_token()) != 0) {
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
  self->component = anhyst_component_new();
  if (self->component == NULL) {
    (void)to_status(self, "not enough memory, or the parameters are damaged");
    free(self);
    return NULL;
  }
  return self;
}

void fmi2FreeInstance(fmi2Component c)
{
  if (c != NULL) {
    anhyst_component_free(component_of(c));
    free(c);
  }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
  (void)defined;
  (void)tolerance;
  (void)ends;
  (void)stop;
  return to_status(c, anhyst_component_begin(component_of(c), start));
}

/* A tool may omit the set-up of the experiment; the simulation then begins at 0. */
fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
  return to_status(c, anhyst_component_is_in_phase(component_of(c), ANHYST_PHASE_INITIALISING)
                          ? NULL
                          : anhyst_component_begin(component_of(c), 0.0));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
  return to_status(c, anhyst_component_run(component_of(c)));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
  return to_status(c, anhyst_component_end(component_of(c)));
}

fmi2Status fmi2Reset(fmi2Component c)
{
  return to_status(c, anhyst_component_reset(component_of(c)));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference at[], size_t n, fmi2Real value[])
{
  return to_status(c, anhyst_component_get(component_of(c), at, n, value));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference at[], size_t n,
                       const fmi2Real value[])
{
  return to_status(c, anhyst_component_set(component_of(c), at, n, value));
}

/* The component has no variables of these types. */
#define NO_VARIABLES(kind, type)                                                                   \
  fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference at[], size_t n, type value[]) \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    return to_status(c, n == 0 ? NULL : "no such variable");                                       \
  }                                                                                                \
  fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference at[], size_t n,               \
                           const type value[])                                                     \
  {                                                                                                \
    (void)at;                                                                                      \
    (void)value;                                                                                   \
    return to_status(c, n == 0 ? NULL : "no such variable");                                       \
  }

NO_VARIABLES(Integer, fmi2Integer)
NO_VARIABLES(Boolean, fmi2Boolean)
NO_VARIABLES(String, fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  return to_status(c, anhyst_component_save(component_of(c), state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
  return to_status(c, anhyst_component_restore(component_of(c), state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  (void)c;
  anhyst_component_forget(state);
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  (void)c;
  (void)state;
  *size = anhyst_component_bytes();
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  return to_status(c, anhyst_component_write(state, (unsigned char *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
  return to_status(c, anhyst_component_read((const unsigned char *)bytes, size, state));
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
  return to_status(c, "what is sampled has no derivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
  (void)at;
  (void)order;
  (void)value;
  return to_status(c, n == 0 ? NULL : "inputs are held, not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
  (void)at;
  (void)order;
  (void)value;
  return to_status(c, n == 0 ? NULL : "outputs are held: no derivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean no_return)
{
  (void)no_return;
  return to_status(c, anhyst_component_step(component_of(c), now, step));
}

fmi2Status fmi2CancelStep(fmi2Component c) { return to_status(c, "no step is ever pending"); }

/* A step is complete when its function returns. */
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

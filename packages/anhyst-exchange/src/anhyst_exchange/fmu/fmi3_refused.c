/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that FMI 3.0 requires and that an FMU for co-simulation does not support: model
 * exchange and scheduled execution. */
#include <stddef.h>

#include "fmi/fmi3Functions.h"

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place,
                                          fmi3Boolean visible, fmi3Boolean on,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
  (void)name;
  (void)token;
  (void)place;
  (void)visible;
  (void)on;
  (void)environment;
  (void)log;
  return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, fmi3Boolean on,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
  (void)clock;
  (void)lock;
  (void)unlock;
  return fmi3InstantiateModelExchange(name, token, place, visible, on, environment, log);
}

#define REFUSED_ARRAY(name, type)                                                                  \
  fmi3Status name(fmi3Instance c, type values[], size_t n)                                         \
  {                                                                                                \
    (void)c;                                                                                       \
    (void)values;                                                                                  \
    (void)n;                                                                                       \
    return fmi3Error;                                                                              \
  }

#define REFUSED_NUMBER(name)                                                                       \
  fmi3Status name(fmi3Instance c, size_t *n)                                                       \
  {                                                                                                \
    (void)c;                                                                                       \
    *n = 0;                                                                                        \
    return fmi3Error;                                                                              \
  }

REFUSED_ARRAY(fmi3SetContinuousStates, const fmi3Float64)
REFUSED_ARRAY(fmi3GetContinuousStateDerivatives, fmi3Float64)
REFUSED_ARRAY(fmi3GetEventIndicators, fmi3Float64)
REFUSED_ARRAY(fmi3GetContinuousStates, fmi3Float64)
REFUSED_ARRAY(fmi3GetNominalsOfContinuousStates, fmi3Float64)
REFUSED_NUMBER(fmi3GetNumberOfEventIndicators)
REFUSED_NUMBER(fmi3GetNumberOfContinuousStates)

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
  (void)c;
  return fmi3Error;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
  (void)c;
  (void)time;
  return fmi3Error;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_return, fmi3Boolean *event,
                                       fmi3Boolean *terminate)
{
  (void)c;
  (void)no_return;
  *event = fmi3False;
  *terminate = fmi3False;
  return fmi3Error;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
  (void)c;
  (void)clock;
  (void)time;
  return fmi3Error;
}

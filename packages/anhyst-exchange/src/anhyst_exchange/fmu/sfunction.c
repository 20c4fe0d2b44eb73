/* SPDX-License-Identifier: Apache-2.0 */
/* A component as a level-2 S-function. mex -DS_FUNCTION_NAME=... sets its name.
 *
 * Each input and each output has a port, in the order of part_values.h. A component with a rate
 * samples at this rate. The sample time (s) of a component without a rate is the only parameter of
 * the block. As in an FMU, outputs that follow from the inputs of a sample appear at the next
 * sample. */
#define S_FUNCTION_LEVEL 2

#include "component.h"
#include "part_values.h"
#include "simstruc.h"

#define PARAMETERS (PART_RATE > 0.0 ? 0 : 1)

static double sample_time(SimStruct *S)
{
  return PART_RATE > 0.0 ? 1.0 / PART_RATE : mxGetScalar(ssGetSFcnParam(S, 0));
}

static void mdlInitializeSizes(SimStruct *S)
{
  int i;
  ssSetNumSFcnParams(S, PARAMETERS);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
    return; /* Simulink reports this error itself */
  }
  if (PARAMETERS > 0) {
    ssSetSFcnParamTunable(S, 0, 0);
    if (!(sample_time(S) > 0.0)) {
      ssSetErrorStatus(S, "the parameter is the sample time: give a number of seconds above 0");
      return;
    }
  }
  if (!ssSetNumInputPorts(S, PART_INPUTS) || !ssSetNumOutputPorts(S, PART_OUTPUTS)) {
    return;
  }
  for (i = 0; i < PART_INPUTS; i++) {
    ssSetInputPortWidth(S, i, 1);
    ssSetInputPortRequiredContiguous(S, i, 1);
    ssSetInputPortDirectFeedThrough(S, i, 0);
  }
  for (i = 0; i < PART_OUTPUTS; i++) {
    ssSetOutputPortWidth(S, i, 1);
  }
  ssSetNumSampleTimes(S, 1);
  ssSetNumPWork(S, 1);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
  ssSetSampleTime(S, 0, sample_time(S));
  ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct *S)
{
  anhyst_component *component = anhyst_component_new();
  const char *why = component == NULL ? "not enough memory, or damaged parameters" : NULL;
  ssSetPWorkValue(S, 0, component);
  if (why == NULL) {
    why = anhyst_component_begin(component, ssGetTStart(S));
  }
  if (why == NULL) {
    why = anhyst_component_run(component);
  }
  if (why != NULL) {
    ssSetErrorStatus(S, why);
  }
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
  const anhyst_component *component = (const anhyst_component *)ssGetPWorkValue(S, 0);
  unsigned i;
  (void)tid;
  for (i = 0; i < PART_OUTPUTS; i++) {
    const unsigned at = 1 + PART_INPUTS + i;
    (void)anhyst_component_get(component, &at, 1, ssGetOutputPortRealSignal(S, (int)i));
  }
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
  anhyst_component *component = (anhyst_component *)ssGetPWorkValue(S, 0);
  const char *why = NULL;
  unsigned i;
  (void)tid;
  for (i = 0; i < PART_INPUTS && why == NULL; i++) {
    const unsigned at = 1 + i;
    why = anhyst_component_set(component, &at, 1, ssGetInputPortRealSignal(S, (int)i));
  }
  if (why == NULL) {
    why = anhyst_component_step(component, ssGetT(S), sample_time(S));
  }
  if (why != NULL) {
    ssSetErrorStatus(S, why);
  }
}

static void mdlTerminate(SimStruct *S)
{
  anhyst_component_free((anhyst_component *)ssGetPWorkValue(S, 0));
  ssSetPWorkValue(S, 0, NULL);
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif

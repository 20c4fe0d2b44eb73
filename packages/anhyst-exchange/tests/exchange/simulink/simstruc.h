/* SPDX-License-Identifier: Apache-2.0 */
/* The part of the S-function interface that the components use, so that they run without Simulink.
 */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H

#include <stddef.h>

#define PORTS 128

typedef int int_T;
typedef double mxArray;

typedef struct {
  int parameters_wanted, parameters_given;
  mxArray parameter;
  int inputs, outputs, works;
  double in[PORTS], out[PORTS];
  int feeds_through[PORTS];
  double sample_time, offset, start, now;
  void *work;
  const char *error;
} SimStruct;

#define mxGetScalar(array) (*(array))
#define ssGetSFcnParam(S, i) (&(S)->parameter + (i))
#define ssSetNumSFcnParams(S, n) ((S)->parameters_wanted = (n))
#define ssGetNumSFcnParams(S) ((S)->parameters_wanted)
#define ssGetSFcnParamsCount(S) ((S)->parameters_given)
#define ssSetSFcnParamTunable(S, i, flag) ((void)(i), (void)(flag))
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n), (n) <= PORTS)
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n), (n) <= PORTS)
#define ssSetInputPortWidth(S, i, n) ((void)(i), (void)(n))
#define ssSetOutputPortWidth(S, i, n) ((void)(i), (void)(n))
#define ssSetInputPortRequiredContiguous(S, i, flag) ((void)(i), (void)(flag))
#define ssSetInputPortDirectFeedThrough(S, i, flag) ((S)->feeds_through[i] = (flag))
#define ssSetNumSampleTimes(S, n) ((void)(n))
#define ssSetNumPWork(S, n) ((S)->works = (n))
#define ssSetSampleTime(S, i, seconds) ((S)->sample_time = (seconds))
#define ssSetOffsetTime(S, i, seconds) ((S)->offset = (seconds))
#define ssSetPWorkValue(S, i, value) ((S)->work = (value))
#define ssGetPWorkValue(S, i) ((S)->work)
#define ssGetTStart(S) ((S)->start)
#define ssGetT(S) ((S)->now)
#define ssGetInputPortRealSignal(S, i) ((const double *)&(S)->in[i])
#define ssGetOutputPortRealSignal(S, i) (&(S)->out[i])

#endif

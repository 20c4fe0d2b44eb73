/* SPDX-License-Identifier: Apache-2.0 */
/* The hysteresis law as an operator from effective field to magnetisation.
   Declarations are in generic/operator.h. */
#ifndef ANHYST_OPERATOR_H
#define ANHYST_OPERATOR_H

#include "anhyst/branch.h"
#include "anhyst/status.h"

/* Largest alpha*c*M_s/a of the law of 1986. At 3 its irreversible part turns vertical; beyond 2.85
   its sub-steps, of kappa/8*(1 - eps/3), are no longer sure to be stable. */
#define ANHYST_EPS_MAX 2.85

/* How the irreversible part is carried over one step. */
typedef enum {
  ANHYST_STEP_EXACT = 0,  /* effective-field law, exact at any step length */
  ANHYST_STEP_LINEAR = 1, /* effective-field law, anhysteretic taken linear over the step */
  ANHYST_STEP_JA1986 = 2  /* law of 1986, classical Runge-Kutta sub-steps */
} anhyst_step;

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/operator.h"
#include "anhyst/f32.h"
#include "anhyst/generic/operator.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* Return codes of the core. Zero means success. Every other value states why there is no result. */
#ifndef ANHYST_STATUS_H
#define ANHYST_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  ANHYST_OK = 0,
  /* A parameter is outside its stated range. Nothing was computed. */
  ANHYST_BAD_PARAMETER = -1,
  /* The law cannot reach the initial state: |L(p) - y| > kappa/3 or |x - p| > play (operator.h). */
  ANHYST_BAD_STATE = -2,
  /* Even the reversible part would jump (-omega*c*A > 1), so the equation is not valid. */
  ANHYST_REFUSED = -3,
  /* The solution is beyond |x| = ANHYST_X_MAX, or an input was not finite. */
  ANHYST_OUT_OF_RANGE = -4,
  /* The iteration limit was reached. This cannot happen with valid parameters. */
  ANHYST_NOT_CONVERGED = -5,
  /* A cycle did not reach its steady state within the given number of repetitions. */
  ANHYST_NOT_SETTLED = -6,
  /* The caller was compiled with another ANHYST_MEMORIES than this library. Nothing was changed. */
  ANHYST_BAD_SIZE = -7
} anhyst_status;

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* Derivatives of a path with respect to parameters, forward mode, double precision. */
#ifndef ANHYST_SENSITIVITY_H
#define ANHYST_SENSITIVITY_H

#include <stddef.h>

#include "anhyst/law/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One direction of differentiation: the derivatives of what is constant along the path, and of the
   state, which is advanced. */
typedef struct {
  double kappa, c, play;
  anhyst_state_f64 state;
} anhyst_tangent_f64;

/* A drive of n samples in the terms of the solver, and its derivatives: row i of omega_t and r_t
   holds the `directions` derivatives at sample i. */
typedef struct {
  size_t n;
  size_t directions;
  const double *omega, *r;
  const double *omega_t, *r_t;
} anhyst_differentiated_drive_f64;

/* Follows the drive as anhyst_solve does, sample by sample, and beside it every tangent, by the
   implicit function theorem: x1_t = (r_t - omega_t*m - omega*Mp)/(1 + omega*dm/dx).
   x, m: n values; x_t, m_t: n rows of `directions`. State and tangents are advanced.
   branch_slope is needed for the exact step, else may be null. Error against the derivative of the
   computed path: 1e-9 relative, away from jumps, where none exists.
   Returns a status as anhyst_solve does, with *index the sample; ANHYST_BAD_PARAMETER for the law
   of 1986, whose sub-steps are not differentiated. */
anhyst_status anhyst_sensitivity_f64(const anhyst_operator_f64 *law,
                                     const anhyst_branch_slope_f64 *branch_slope,
                                     const anhyst_differentiated_drive_f64 *drive,
                                     anhyst_state_f64 *state, anhyst_tangent_f64 *tangents,
                                     double *x, double *m, double *x_t, double *m_t, size_t *index);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* Parameter derivatives of a path in double precision, by forward differentiation. */
#ifndef ANHYST_SENSITIVITY_H
#define ANHYST_SENSITIVITY_H

#include <stddef.h>

#include "anhyst/law/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One direction of differentiation: the derivatives of the parameters and of the advanced state. */
typedef struct {
  double kappa, c, play;
  anhyst_state_f64 state;
} anhyst_tangent_f64;

/* A drive of n samples in the variables of the solver, and its derivatives. Row i of omega_t and
   r_t contains the derivatives at sample i in every direction. */
typedef struct {
  size_t n;
  size_t directions;
  const double *omega, *r;
  const double *omega_t, *r_t;
} anhyst_differentiated_drive_f64;

/* Follows the drive sample by sample like anhyst_solve. Computes the derivative in each direction
   (subscript t) by the implicit function theorem: x1_t = (r_t - omega_t*m - omega*Mp)/(1 +
   omega*dm/dx). Mp is the derivative of m at constant x. x and m have n values, x_t and m_t n rows
   of `directions` values. The state and the tangents are advanced. branch_slope is required for the
   exact step, and may be null otherwise. The relative error is 1e-9 against the derivative of the
   computed path, except at jumps, where there is no derivative. Returns a status like anhyst_solve,
   with the sample in *index. Returns ANHYST_BAD_PARAMETER for the law of 1986, which is not
   differentiated. */
anhyst_status anhyst_sensitivity_f64(const anhyst_operator_f64 *law,
                                     const anhyst_branch_slope_f64 *branch_slope,
                                     const anhyst_differentiated_drive_f64 *drive,
                                     anhyst_state_f64 *state, anhyst_tangent_f64 *tangents,
                                     double *x, double *m, double *x_t, double *m_t, size_t *index);

#ifdef __cplusplus
}
#endif
#endif

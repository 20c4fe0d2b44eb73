/* SPDX-License-Identifier: Apache-2.0 */
/* The solver of the scalar equation x + omega*m(x) = r. */
#ifndef ANHYST_SOLVER_H
#define ANHYST_SOLVER_H

#include "anhyst/law/operator.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A solution before its commit: the state after the step, and its magnetisation. */
typedef struct {
  anhyst_state_f64 state;
  double m;        /* magnetisation / M_s */
  double m_slope;  /* dm/dx after the step, in the direction of travel */
  int evaluations; /* number of evaluations of the law, including the start */
} anhyst_candidate_f64;

/* Solves x + omega*m(x) = r for the first x that a monotone path from the state reaches. omega is
   w*M_s/a, and r is in units of a; circuit.h lists applications. Does not change the state. The
   assignment state = candidate.state commits the solution.

   With 1 + omega*A > 0, the solution is unique. The distance of the solution from the start is
   between d/(1+omega*A) and d, where d is the residual at the start. Newton's method in this
   interval takes 3 to 5 evaluations. If 1 + omega*A is 0 or less, the material may jump: the search
   follows the path from its start and returns the first solution. A moving gap may change omega and
   r between steps; use the new values.

   Requires that anhyst_operator_check_f64 and anhyst_state_check_f64 accept law and state. Error:
   |x + omega*m - r| is within 8 ulp of |x| + |r| + |omega|, and of the same sum at the start of the
   path. Returns ANHYST_OK, ANHYST_REFUSED, ANHYST_OUT_OF_RANGE or ANHYST_NOT_CONVERGED. The
   candidate is valid only with ANHYST_OK. */
anhyst_status anhyst_solve_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state,
                               double omega, double r, anhyst_candidate_f64 *candidate);

#ifdef __cplusplus
}
#endif
#endif

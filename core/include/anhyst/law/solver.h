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
  double m_slope;  /* dm/dx there, in the direction of travel */
  int evaluations; /* of the law, including the start */
} anhyst_candidate_f64;

/* Solves x + omega*m(x) = r for the first x that a monotone path from the state reaches. omega =
   w*M_s/a, r in units of a (see circuit.h for the applications). Does not change the state; the
   assignment state = candidate.state commits the solution.

   With 1 + omega*A > 0, the solution is unique and between d/(1+omega*A) and d from the start,
   where d is the residual there. Newton's method in this bracket takes 3 to 5 evaluations.
   Otherwise the material may jump: the search follows the path from its start and returns the first
   solution. A moving gap may change omega and r between steps; use the new values.

   Requires that law and state have passed their checks. Error: |x + omega*m - r| is within 8 ulp of
   |x| + |r| + |omega| and of the start of the path. Returns ANHYST_OK, ANHYST_REFUSED,
   ANHYST_OUT_OF_RANGE or ANHYST_NOT_CONVERGED; the candidate is valid only with ANHYST_OK. */
anhyst_status anhyst_solve_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state,
                               double omega, double r, anhyst_candidate_f64 *candidate);

#ifdef __cplusplus
}
#endif
#endif

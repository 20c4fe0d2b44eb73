/* SPDX-License-Identifier: Apache-2.0 */
/* The one scalar equation x + omega*m(x) = r. */
#ifndef ANHYST_SOLVER_H
#define ANHYST_SOLVER_H

#include "anhyst/law/operator.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A solution that has not been committed: the state it would lead to, and what it is worth. */
typedef struct {
  anhyst_state_f64 state;
  double m;        /* magnetisation / M_s */
  double m_slope;  /* dm/dx there, in the direction of travel */
  int evaluations; /* of the law, the start included */
} anhyst_candidate_f64;

/* Solves x + omega*m(x) = r for the x that a monotone path from the state reaches first.
   omega = w*M_s/a, r in units of a (see circuit.h for the uses). The state is not touched:
   committing is the assignment state = candidate.state.

   With 1 + omega*A > 0 the solution is unique and lies between d/(1+omega*A) and d from the start,
   d the residual there; Newton inside that bracket, 3 to 5 evaluations. Otherwise the material may
   jump: the path is walked from the start and the first solution taken. A value of the law changed
   by a moving gap is allowed: omega and r are the new ones.

   Preconditions: law and state have passed their checks. Error: |x + omega*m - r| within 8 units in
   the last place of |x| + |r| + |omega| and of where the path started. Returns ANHYST_OK,
   ANHYST_REFUSED, ANHYST_OUT_OF_RANGE or ANHYST_NOT_CONVERGED; the candidate is valid only with
   ANHYST_OK. */
anhyst_status anhyst_solve_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state,
                               double omega, double r, anhyst_candidate_f64 *candidate);

#ifdef __cplusplus
}
#endif
#endif

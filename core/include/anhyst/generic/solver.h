/* SPDX-License-Identifier: Apache-2.0 */

/* A solution that has not been committed: the state it would lead to, and what it is worth. */
typedef struct {
  ANHYST_NAME(anhyst_state) state;
  ANHYST_REAL m;       /* magnetisation / M_s */
  ANHYST_REAL m_slope; /* dm/dx there, in the direction of travel */
  int evaluations;     /* of the law, the start included */
} ANHYST_NAME(anhyst_candidate);

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
anhyst_status ANHYST_NAME(anhyst_solve)(const ANHYST_NAME(anhyst_operator) *law,
                                        const ANHYST_NAME(anhyst_state) *state, ANHYST_REAL omega,
                                        ANHYST_REAL r, ANHYST_NAME(anhyst_candidate) *candidate);

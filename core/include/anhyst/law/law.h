/* SPDX-License-Identifier: Apache-2.0 */
/* What circuits need of a law, whichever it is: one table of functions a law. */
#ifndef ANHYST_LAW_H
#define ANHYST_LAW_H

#include "anhyst/law/cells.h"
#include "anhyst/law/solver.h"

/* Numbers that the state of any law consists of, at most. */
#define ANHYST_NUMBERS_MAX ANHYST_CELLS_MAX

#ifdef __cplusplus
extern "C" {
#endif

/* The state of an iron of any law. All zero: demagnetised. */
typedef union {
  anhyst_state_f64 lag;
  anhyst_cells_state_f64 cells;
} anhyst_memory_f64;

/* A solution that has not been committed. */
typedef struct {
  double x;     /* effective field */
  double m;     /* magnetisation, both in units of the law */
  double slope; /* dm/dx where it stands, along the way there */
  union {
    anhyst_state_f64 lag;
    anhyst_cells_candidate_f64 cells;
  } next;
} anhyst_solution_f64;

/* A law by its functions; the first argument is its parameters. */
typedef struct {
  /* Numbers of a state, at most ANHYST_NUMBERS_MAX; the first is x. */
  int (*numbers)(const void *law);
  /* Solves x + omega*m(x) = r as solver.h and cells.h say; the state is not touched. */
  anhyst_status (*solve)(const void *law, const anhyst_memory_f64 *state, double omega, double r,
                         anhyst_solution_f64 *found);
  /* Takes a solution over into the state from which it was found. */
  void (*accept)(const void *law, anhyst_memory_f64 *state, const anhyst_solution_f64 *found);
  /* Effective field and magnetisation of a state. */
  void (*read)(const void *law, const anhyst_memory_f64 *state, double *x, double *m);
  /* A state from its numbers: ANHYST_BAD_STATE where the law cannot reach it. */
  anhyst_status (*enter)(const void *law, const double *numbers, anhyst_memory_f64 *state);
  void (*leave)(const void *law, const anhyst_memory_f64 *state, double *numbers);
  /* From the numbers after three repetitions of a cycle, the oldest first, guesses where they lead,
     and makes that the state if it is one. Null where a cycle is settled after one repetition. */
  void (*hasten)(const void *law, const double *const ends[3], anhyst_memory_f64 *state);
} anhyst_law_f64;

/* Parameters: anhyst_operator_f64, in units of a and M_s. */
extern const anhyst_law_f64 anhyst_law_lag_f64;
/* Parameters: anhyst_cells_f64, in A/m. */
extern const anhyst_law_f64 anhyst_law_cells_f64;

#ifdef __cplusplus
}
#endif
#endif

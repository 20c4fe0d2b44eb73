/* SPDX-License-Identifier: Apache-2.0 */
/* The interface between circuits and hysteresis laws: each law is a table of functions. */
#ifndef ANHYST_LAW_H
#define ANHYST_LAW_H

#include "anhyst/law/cells.h"
#include "anhyst/law/solver.h"

/* Maximum number of real numbers in the hysteresis state of any law. */
#define ANHYST_NUMBERS_MAX ANHYST_CELLS_MAX

#ifdef __cplusplus
extern "C" {
#endif

/* Hysteresis state of any law. If all bytes are 0, the iron is demagnetised. */
typedef union {
  anhyst_state_f64 lag;
  anhyst_cells_state_f64 cells;
  double flux; /* flux density inside a leaky ring, T; not a state of the iron (circuit.h) */
} anhyst_memory_f64;

/* A solution before its commit. */
typedef struct {
  double x;     /* effective field, in units of the law */
  double m;     /* magnetisation, in units of the law */
  double slope; /* dm/dx at the solution, in the direction of travel */
  union {
    anhyst_state_f64 lag;
    anhyst_cells_candidate_f64 cells;
  } next;
} anhyst_solution_f64;

/* The functions of a law. The first argument of each is the parameters of the law. */
typedef struct {
  /* Returns the count of real numbers in a state, at most ANHYST_NUMBERS_MAX. The first is x. */
  int (*numbers)(const void *law);
  /* Solves x + omega*m(x) = r as described in solver.h and cells.h. Does not change the state. */
  anhyst_status (*solve)(const void *law, const anhyst_memory_f64 *state, double omega, double r,
                         anhyst_solution_f64 *found);
  /* Commits a solution to the state from which it was found. */
  void (*accept)(const void *law, anhyst_memory_f64 *state, const anhyst_solution_f64 *found);
  /* Sets *x to the effective field and *m to the magnetisation of a state. */
  void (*read)(const void *law, const anhyst_memory_f64 *state, double *x, double *m);
  /* Convert real numbers to a state, and back. ANHYST_BAD_STATE: the law cannot reach the state. */
  anhyst_status (*enter)(const void *law, const double *numbers, anhyst_memory_f64 *state);
  void (*leave)(const void *law, const anhyst_memory_f64 *state, double *numbers);
  /* Extrapolates a slow drift from the numbers after three repetitions of a cycle, oldest first. If
     the result is valid, sets the state. Null if the law needs only one repetition for a steady
     state. */
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

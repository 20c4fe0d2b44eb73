/* SPDX-License-Identifier: Apache-2.0 */
/* Simulation of many parameter sets with one drive signal, for an identification search. */
#ifndef ANHYST_BATCH_H
#define ANHYST_BATCH_H

#include <stddef.h>

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Parameter sets as a structure of arrays, one entry for each set; in units of a and M_s. */
typedef struct {
  size_t sets;
  const double *kappa;  /* k/a > 0 */
  const double *c;      /* 0..1 */
  const double *omega;  /* w*M_s/a; requires 1 + omega/3 > 0, because jumps are not followed here */
  const double *scale;  /* per unit of the drive: r = scale*(drive - offset) */
  const double *offset; /* in the unit of the drive */
} anhyst_batch_sets;

/* Method to solve x + omega*m = r at each sample. */
typedef enum {
  /* One linearly implicit step with one evaluation of the law; the lag is a rational function. The
     residual enters the next step, so that errors do not accumulate. The error is about 2e-2 of the
     drive at 100 samples per loop: for ranking sets. */
  ANHYST_BATCH_EXPLICIT = 0,
  /* Newton's method with three evaluations and the linear step of operator.h. The residual at 100
     samples per loop and drives up to 3*a is below 2.5e-4 of a for omega from -1.5 to 10 (median
     4e-8). Near the onset of jumps (omega below -2) and for omega far above 100, single sets can
     have useless results. Therefore, a search must check its final fit with the solver, as the
     search of this package does. */
  ANHYST_BATCH_IMPLICIT = 1
} anhyst_batch_mode;

/* Instruction sets of the batch. Every processor also has the sets before its own. */
typedef enum {
  ANHYST_BATCH_BASE = 0, /* every processor of the family */
  ANHYST_BATCH_AVX2 = 1, /* with FMA */
  ANHYST_BATCH_AVX512 = 2
} anhyst_batch_level;

/* Returns the last instruction set of this processor. Takes up to 40 us on a virtual machine. */
anhyst_batch_level anhyst_batch_best(void);

/* Follows n samples of one drive with every set, without play. x and y (one entry for each set) are
   the states, which are read and advanced. m_out and x_out are n rows of `sets` entries, or null if
   the run only brings a cycle to its steady state. Errors of the inline functions: exp 1e-11
   relative, Langevin 4.4e-9 absolute.

   Returns ANHYST_OK, or ANHYST_BAD_PARAMETER, without a change, if one set is out of range or the
   processor lacks the level. */
anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_level level,
                               anhyst_batch_mode mode, size_t n, const double *drive, double *x,
                               double *y, double *m_out, double *x_out);

/* Evaluates the inline exp(-t), t >= 0, and Langevin function of the batch to test their errors. */
anhyst_status anhyst_batch_functions_f64(anhyst_batch_level level, size_t n, const double *t,
                                         double *exp_minus, double *langevin);

#ifdef __cplusplus
}
#endif
#endif

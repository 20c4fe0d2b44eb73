/* SPDX-License-Identifier: Apache-2.0 */
/* Simulation of many parameter sets with the same drive signal, for an identification search. */
#ifndef ANHYST_BATCH_H
#define ANHYST_BATCH_H

#include <stddef.h>

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Parameter sets as a structure of arrays, with one entry for each set; units of a and M_s. */
typedef struct {
  size_t sets;
  const double *kappa;  /* k/a > 0 */
  const double *c;      /* 0..1 */
  const double *omega;  /* w*M_s/a; requires 1 + omega/3 > 0, which excludes jumps */
  const double *scale;  /* scale factor of the drive: r = scale*(drive - offset) */
  const double *offset; /* offset of the drive, in its unit */
} anhyst_batch_sets;

/* Method to solve x + omega*m = r at each sample. */
typedef enum {
  /* One linearly implicit step with one evaluation of the law. The lag is a rational function. The
     residual is added to the next step, so that errors do not accumulate. The error is about 2e-2
     of the drive at 100 samples per loop. Use this method only to rank parameter sets. */
  ANHYST_BATCH_EXPLICIT = 0,
  /* Newton's method with three evaluations of the law and the linear step of operator.h. The
     residual is below 2.5e-4 of a (median 4e-8) at 100 samples per loop, drives up to 3*a and omega
     from -1.5 to 10. Some sets can have useless results near the onset of jumps (omega below -2)
     and for omega far above 100. Therefore, a search must check its final fit with the solver, as
     the search of this package does. */
  ANHYST_BATCH_IMPLICIT = 1
} anhyst_batch_mode;

/* Instruction sets of the batch. A processor with one set also has those before it. */
typedef enum {
  ANHYST_BATCH_BASE = 0, /* available on every processor of the family */
  ANHYST_BATCH_AVX2 = 1, /* AVX2 and FMA */
  ANHYST_BATCH_AVX512 = 2
} anhyst_batch_level;

/* Returns the last instruction set of this processor. Takes up to 40 us on a virtual machine. */
anhyst_batch_level anhyst_batch_best(void);

/* Simulates n samples of one drive with every set, without a play. x and y (one entry for each set)
   are the initial states and are replaced by the final states. m_out and x_out have n rows of
   `sets` entries. Both outputs may be null if the run only brings a cycle to its steady state.
   Errors of the inline functions: exp 1e-11 relative, Langevin 4.4e-9 absolute.

   Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if one set is out of range or the processor lacks the
   instruction set. After an error, nothing is changed. */
anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_level level,
                               anhyst_batch_mode mode, size_t n, const double *drive, double *x,
                               double *y, double *m_out, double *x_out);

/* Evaluates the functions exp(-t), t >= 0, and Langevin of the batch, to test their errors. */
anhyst_status anhyst_batch_functions_f64(anhyst_batch_level level, size_t n, const double *t,
                                         double *exp_minus, double *langevin);

#ifdef __cplusplus
}
#endif
#endif

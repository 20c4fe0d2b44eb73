/* SPDX-License-Identifier: Apache-2.0 */
/* Many parameter sets over one drive: what a search runs on. */
#ifndef ANHYST_BATCH_H
#define ANHYST_BATCH_H

#include <stddef.h>

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Parameter sets as a structure of arrays, one entry a set; units of a and M_s. */
typedef struct {
  size_t sets;
  const double *kappa;  /* k/a > 0 */
  const double *c;      /* 0..1 */
  const double *omega;  /* w*M_s/a, 1 + omega/3 > 0 (jumps are not followed here) */
  const double *scale;  /* per unit of the drive: r = scale*(drive - offset) */
  const double *offset; /* in units of the drive */
} anhyst_batch_sets;

/* How the equation x + omega*m = r is met at each sample. */
typedef enum {
  /* One linearly implicit step ahead, one evaluation of the law; the lag by a rational function.
     The residual left over enters the next step, so errors do not add up. About 2e-2 of the drive
     at 100 samples a loop: for ranking sets. */
  ANHYST_BATCH_EXPLICIT = 0,
  /* Newton, three evaluations, the linear step of operator.h. Residual at 100 samples a loop,
     drives up to 3*a: below 2.5e-4 of a for omega from -1.5 to 10 (median 4e-8). Near the onset of
     jumps (omega below -2) and for omega far above 100 it can be useless for single sets: a search
     must check its end by the solver, as ours does. */
  ANHYST_BATCH_IMPLICIT = 1
} anhyst_batch_mode;

/* Instruction sets the batch is compiled for; a processor that has one has those before it. */
typedef enum {
  ANHYST_BATCH_BASE = 0, /* every processor of the family */
  ANHYST_BATCH_AVX2 = 1, /* with FMA */
  ANHYST_BATCH_AVX512 = 2
} anhyst_batch_level;

/* The last one that this processor has. Asking takes up to 40 us on a virtual machine. */
anhyst_batch_level anhyst_batch_best(void);

/* Follows n samples of one drive with every set, without play. x and y (one entry a set) are the
   states, read and advanced. m_out and x_out are n rows of `sets` entries, or null where the pass
   only settles a cycle. Error of the inline functions: exp 1e-11 relative, Langevin 4.4e-9
   absolute.
   Returns ANHYST_OK, or ANHYST_BAD_PARAMETER (nothing done) if one set is out of range or the
   processor lacks the level. */
anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_level level,
                               anhyst_batch_mode mode, size_t n, const double *drive, double *x,
                               double *y, double *m_out, double *x_out);

/* The inline exp(-t), t >= 0, and Langevin function of the batch, for measuring their error. */
anhyst_status anhyst_batch_functions_f64(anhyst_batch_level level, size_t n, const double *t,
                                         double *exp_minus, double *langevin);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* Picks the batch compiled for the best instruction set of the processor it runs on. */
#include "anhyst/batch.h"

#define DECLARE(suffix)                                                                            \
  anhyst_status anhyst_batch_run##suffix(const anhyst_batch_sets *sets, anhyst_batch_mode mode,    \
                                         size_t n, const double *drive, double *x, double *y,      \
                                         double *m_out, double *x_out);                            \
  void anhyst_batch_functions##suffix(size_t n, const double *t, double *exp_minus,                \
                                      double *langevin);

DECLARE(_base)
#ifdef ANHYST_BATCH_X86
DECLARE(_avx2)
DECLARE(_avx512)
#endif

anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_mode mode, size_t n,
                               const double *drive, double *x, double *y, double *m_out,
                               double *x_out)
{
  for (size_t i = 0; i < sets->sets; i++) {
    const int ok =
        sets->kappa[i] > 0.0 && sets->c[i] >= 0.0 && sets->c[i] <= 1.0 && sets->omega[i] > -3.0;
    if (!ok) {
      return ANHYST_BAD_PARAMETER;
    }
  }
#ifdef ANHYST_BATCH_X86
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl")) {
    return anhyst_batch_run_avx512(sets, mode, n, drive, x, y, m_out, x_out);
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    return anhyst_batch_run_avx2(sets, mode, n, drive, x, y, m_out, x_out);
  }
#endif
  return anhyst_batch_run_base(sets, mode, n, drive, x, y, m_out, x_out);
}

void anhyst_batch_functions_f64(size_t n, const double *t, double *exp_minus, double *langevin)
{
#ifdef ANHYST_BATCH_X86
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl")) {
    anhyst_batch_functions_avx512(n, t, exp_minus, langevin);
    return;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    anhyst_batch_functions_avx2(n, t, exp_minus, langevin);
    return;
  }
#endif
  anhyst_batch_functions_base(n, t, exp_minus, langevin);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Picks the batch compiled for an instruction set that the processor has. */
#include "anhyst/law/batch.h"

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

anhyst_batch_level anhyst_batch_best(void)
{
#ifdef ANHYST_BATCH_X86
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512vl")
               ? ANHYST_BATCH_AVX512
               : ANHYST_BATCH_AVX2;
  }
#endif
  return ANHYST_BATCH_BASE;
}

anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_level level,
                               anhyst_batch_mode mode, size_t n, const double *drive, double *x,
                               double *y, double *m_out, double *x_out)
{
  if (level > anhyst_batch_best()) {
    return ANHYST_BAD_PARAMETER;
  }
  for (size_t i = 0; i < sets->sets; i++) {
    const int ok =
        sets->kappa[i] > 0.0 && sets->c[i] >= 0.0 && sets->c[i] <= 1.0 && sets->omega[i] > -3.0;
    if (!ok) {
      return ANHYST_BAD_PARAMETER;
    }
  }
#ifdef ANHYST_BATCH_X86
  if (level == ANHYST_BATCH_AVX512) {
    return anhyst_batch_run_avx512(sets, mode, n, drive, x, y, m_out, x_out);
  }
  if (level == ANHYST_BATCH_AVX2) {
    return anhyst_batch_run_avx2(sets, mode, n, drive, x, y, m_out, x_out);
  }
#endif
  return anhyst_batch_run_base(sets, mode, n, drive, x, y, m_out, x_out);
}

anhyst_status anhyst_batch_functions_f64(anhyst_batch_level level, size_t n, const double *t,
                                         double *exp_minus, double *langevin)
{
  if (level > anhyst_batch_best()) {
    return ANHYST_BAD_PARAMETER;
  }
#ifdef ANHYST_BATCH_X86
  if (level == ANHYST_BATCH_AVX512) {
    anhyst_batch_functions_avx512(n, t, exp_minus, langevin);
    return ANHYST_OK;
  }
  if (level == ANHYST_BATCH_AVX2) {
    anhyst_batch_functions_avx2(n, t, exp_minus, langevin);
    return ANHYST_OK;
  }
#endif
  anhyst_batch_functions_base(n, t, exp_minus, langevin);
  return ANHYST_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Selects the version of the batch for the instruction set of the processor. */
#include "anhyst/law/batch.h"

#ifdef ANHYST_BATCH_X86
#include <cpuid.h>
#endif

#define DECLARE_BATCH_FUNCTIONS(suffix)                                                            \
  anhyst_status anhyst_batch_run##suffix(const anhyst_batch_sets *sets, anhyst_batch_mode mode,    \
                                         size_t n, const double *drive, double *x, double *y,      \
                                         double *m_out, double *x_out);                            \
  void anhyst_batch_functions##suffix(size_t n, const double *t, double *exp_minus,                \
                                      double *langevin);

DECLARE_BATCH_FUNCTIONS(_base)
#ifdef ANHYST_BATCH_X86
DECLARE_BATCH_FUNCTIONS(_avx2)
DECLARE_BATCH_FUNCTIONS(_avx512)
#endif

#ifdef ANHYST_BATCH_X86
/* Bits of CPUID leaf 1, register c; leaf 7, register b; and registers saved at task switches. */
#define FMA_XSAVE_AVX (1u << 12 | 1u << 27 | 1u << 28)
#define AVX2 (1u << 5)
#define AVX512_F_DQ_VL (1u << 16 | 1u << 17 | 1u << 31)
#define SAVES_256_BIT (3u << 1)
#define SAVES_512_BIT (SAVES_256_BIT | 7u << 5)

/* Does not use __builtin_cpu_supports: it returns 0 for every feature if zig links the program. */
anhyst_batch_level anhyst_batch_best(void)
{
  unsigned a, b, c, d;
  __cpuid(1, a, b, c, d); /* every 64-bit processor has this leaf, and with XSAVE also leaf 7 */
  if ((c & FMA_XSAVE_AVX) != FMA_XSAVE_AVX) {
    return ANHYST_BATCH_BASE;
  }
  unsigned enabled, high;
  // NOLINTNEXTLINE(portability-no-assembler): the intrinsic would need -mxsave
  __asm__("xgetbv" : "=a"(enabled), "=d"(high) : "c"(0));
  __cpuid_count(7, 0, a, b, c, d);
  if (!(b & AVX2) || (enabled & SAVES_256_BIT) != SAVES_256_BIT) {
    return ANHYST_BATCH_BASE;
  }
  return (b & AVX512_F_DQ_VL) == AVX512_F_DQ_VL && (enabled & SAVES_512_BIT) == SAVES_512_BIT
             ? ANHYST_BATCH_AVX512
             : ANHYST_BATCH_AVX2;
}
#else
anhyst_batch_level anhyst_batch_best(void) { return ANHYST_BATCH_BASE; }
#endif

anhyst_status anhyst_batch_f64(const anhyst_batch_sets *sets, anhyst_batch_level level,
                               anhyst_batch_mode mode, size_t n, const double *drive, double *x,
                               double *y, double *m_out, double *x_out)
{
  if (level != ANHYST_BATCH_BASE && level > anhyst_batch_best()) {
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
  if (level != ANHYST_BATCH_BASE && level > anhyst_batch_best()) {
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

/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic with fractional numbers of 16 and 32 bits.

   Formats: a q15 is an int16_t with the value n/2^15, a q31 an int32_t with the value n/2^31, and a
   q30 an int32_t with the value n/2^30 (-2 to just below 2). A weight is an int16_t with the value
   n/2^16: a factor of -0.5 to just below 0.5.

   Every function is defined for every argument in its stated range. No intermediate result
   overflows (proved). "Saturates" means: a result outside the format becomes the largest or
   smallest number of the format. "Floor" means rounding towards minus infinity. */
#ifndef ANHYST_FIXED_H
#define ANHYST_FIXED_H

#include "anhyst/numeric/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_Q30_ONE ((int32_t)1073741824)
#define ANHYST_Q28_MAX ((int32_t)268435455)
#define ANHYST_Q28_MIN ((int32_t)(-268435455 - 1))
#define ANHYST_Q15_MAX ((int16_t)32767)
#define ANHYST_Q15_MIN ((int16_t)(-32767 - 1))
#define ANHYST_Q31_MAX ((int32_t)2147483647)
#define ANHYST_Q31_MIN ((int32_t)(-2147483647 - 1))

/* Saturates an int32_t to -32768..32767. The result is exact within this range. */
static inline int16_t anhyst_sat_q15(int32_t a)
{
#ifdef ANHYST_PORT_SAT_Q15
  return (int16_t)ANHYST_PORT_SAT_Q15(a);
#else
  if (a > ANHYST_Q15_MAX) {
    return ANHYST_Q15_MAX;
  }
  return a < ANHYST_Q15_MIN ? ANHYST_Q15_MIN : (int16_t)a;
#endif
}

/* Saturates an int32_t to 0..32767. The result is exact within this range. */
static inline int32_t anhyst_sat_u15(int32_t a)
{
#ifdef ANHYST_PORT_SAT_U15
  return ANHYST_PORT_SAT_U15(a);
#else
  if (a > ANHYST_Q15_MAX) {
    return ANHYST_Q15_MAX;
  }
  return a < 0 ? 0 : a;
#endif
}

/* Saturates to -2^28..2^28 - 1: in q28, from -1 to just below 1. Exact within this range. */
static inline int32_t anhyst_sat_q28(int32_t a)
{
#ifdef ANHYST_PORT_SAT_Q28
  return ANHYST_PORT_SAT_Q28(a);
#else
  if (a > ANHYST_Q28_MAX) {
    return ANHYST_Q28_MAX;
  }
  return a < ANHYST_Q28_MIN ? ANHYST_Q28_MIN : a;
#endif
}

/* Saturates to -2^30..2^30 - 1: in q30, from -1 to just below 1. Exact within this range. */
static inline int32_t anhyst_sat_q30(int32_t a)
{
#ifdef ANHYST_PORT_SAT_Q30
  return ANHYST_PORT_SAT_Q30(a);
#else
  if (a >= ANHYST_Q30_ONE) {
    return ANHYST_Q30_ONE - 1;
  }
  return a < -ANHYST_Q30_ONE ? -ANHYST_Q30_ONE : a;
#endif
}

/* Returns a + b. Saturates; exact inside the range. */
static inline int16_t anhyst_add_q15(int16_t a, int16_t b)
{
  return anhyst_sat_q15((int32_t)a + b);
}

/* Returns a - b. Saturates; exact inside the range. */
static inline int16_t anhyst_sub_q15(int16_t a, int16_t b)
{
  return anhyst_sat_q15((int32_t)a - b);
}

/* Returns a*b, rounded to nearest (halves upwards). Saturates only for (-1)*(-1). */
static inline int16_t anhyst_mul_q15(int16_t a, int16_t b)
{
  return anhyst_sat_q15(((int32_t)a * b + 0x4000) >> 15);
}

/* Returns a + b. Saturates; exact inside the range. */
static inline int32_t anhyst_add_q31(int32_t a, int32_t b)
{
#ifdef ANHYST_PORT_ADD_Q31
  return ANHYST_PORT_ADD_Q31(a, b);
#else
  if (b > 0) {
    return a > ANHYST_Q31_MAX - b ? ANHYST_Q31_MAX : a + b;
  }
  return a < ANHYST_Q31_MIN - b ? ANHYST_Q31_MIN : a + b;
#endif
}

/* Returns a - b. Saturates; exact inside the range. */
static inline int32_t anhyst_sub_q31(int32_t a, int32_t b)
{
#ifdef ANHYST_PORT_SUB_Q31
  return ANHYST_PORT_SUB_Q31(a, b);
#else
  if (b > 0) {
    return a < ANHYST_Q31_MIN + b ? ANHYST_Q31_MIN : a - b;
  }
  return a > ANHYST_Q31_MAX + b ? ANHYST_Q31_MAX : a - b;
#endif
}

/* Returns |a|. Saturates for a = -1. */
static inline int32_t anhyst_abs_q31(int32_t a)
{
  if (a >= 0) {
    return a;
  }
  return a == ANHYST_Q31_MIN ? ANHYST_Q31_MAX : -a;
}

/* Limits a to low..high. Requires low <= high. */
static inline int32_t anhyst_clamp(int32_t a, int32_t low, int32_t high)
{
  if (a < low) {
    return low;
  }
  return a > high ? high : a;
}

/* Returns a times the weight b, floor(a*b/65536), in the format of a. The result cannot overflow
   because |result| <= (|a| + 1)/2. The error is less than 1 LSB. Most products of the core use this
   function: two 16-bit products, or the instruction SMULWB with ANHYST_PORT_HEADER. */
static inline int32_t anhyst_scale(int32_t a, int16_t b)
{
#ifdef ANHYST_PORT_SCALE
  return ANHYST_PORT_SCALE(a, b);
#else
  const int32_t high = a >> 16;              /* -32768..32767 */
  const int32_t low = (int32_t)(a & 0xFFFF); /* 0..65535 */
  return high * b + ((low * b) >> 16);
#endif
}

/* Returns a*2^n for 0 <= n <= 31. Saturates; exact inside the range. */
static inline int32_t anhyst_shl_q31(int32_t a, uint16_t n)
{
  const int32_t shifted = (int32_t)((uint32_t)a << n);
  if ((shifted >> n) != a) { /* some of the removed bits differ from the sign bit */
    return a < 0 ? ANHYST_Q31_MIN : ANHYST_Q31_MAX;
  }
  return shifted;
}

/* Rounds a q31 to the nearest q15 (halves upwards). Saturates. */
static inline int16_t anhyst_round_q31(int32_t a) { return anhyst_sat_q15(((a >> 15) + 1) >> 1); }

/* Returns the number of leading zeros after the sign bit, 0..30: the largest left shift that does
   not change the sign. Requires a > 0. */
static inline uint16_t anhyst_headroom(int32_t a)
{
#ifdef ANHYST_PORT_LEADING_ZEROS
  return (uint16_t)(ANHYST_PORT_LEADING_ZEROS((uint32_t)a) - 1);
#else
  uint16_t n = 0;
  if (a < 0x8000) {
    a *= 0x10000;
    n = 16;
  }
  if (a < 0x800000) {
    a *= 0x100;
    n = (uint16_t)(n + 8);
  }
  if (a < 0x8000000) {
    a *= 0x10;
    n = (uint16_t)(n + 4);
  }
  if (a < 0x20000000) {
    a *= 4;
    n = (uint16_t)(n + 2);
  }
  if (a < 0x40000000) {
    n = (uint16_t)(n + 1);
  }
  return n;
#endif
}

#ifdef __cplusplus
}
#endif
#endif

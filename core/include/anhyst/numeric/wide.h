/* SPDX-License-Identifier: Apache-2.0 */
/* Scalar products of rows of 32-bit numbers and 32-bit signals, summed in 64 bits. In the
   fixed-point core, only this header needs a 64-bit type. Every result is rounded to nearest,
   halves upwards. "Saturates" has the meaning of fixed.h. No intermediate result overflows
   (proved). */
#ifndef ANHYST_WIDE_H
#define ANHYST_WIDE_H

#include "anhyst/numeric/fixed.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_ROW_LENGTH 16                           /* maximum number of coefficients in a row */
#define ANHYST_ROW_MOST ((int32_t)134217728)           /* 2^27, maximum of |coefficient| */
#define ANHYST_ROW_SHIFT 58U                           /* maximum shift of a row */
#define ANHYST_WIDE_ONE ((int64_t)1152921504606846976) /* 2^60 */

/* Matrix rows, stored one after the other. The coefficients of a row are number/2^shift. */
typedef struct {
  const int32_t *number;
  const uint16_t *shift; /* shift of each row, 0..ANHYST_ROW_SHIFT */
} anhyst_rows_q31;

/* Saturates to int32_t. */
static inline int32_t anhyst_sat_wide(int64_t a)
{
  if (a > ANHYST_Q31_MAX) {
    return ANHYST_Q31_MAX;
  }
  return a < ANHYST_Q31_MIN ? ANHYST_Q31_MIN : (int32_t)a;
}

/* Limits a to -most..most. Requires most >= 0. */
static inline int64_t anhyst_clamp_wide(int64_t a, int64_t most)
{
  if (a > most) {
    return most;
  }
  return a < -most ? -most : a;
}

/* Returns a*b. |result| <= |a|*2^31. */
static inline int64_t anhyst_wide(int32_t a, int32_t b) { return (int64_t)a * b; }

/* Returns a/2^n, rounded. Requires |a| <= 2^62 + 2^60 and 0 <= n <= 58. */
static inline int64_t anhyst_rounded_shift(int64_t a, uint16_t n)
{
  return (a + (((int64_t)1 << n) >> 1)) >> n;
}

/* Returns a*b/2^31, rounded. Saturates only for (-1)*(-1). */
static inline int32_t anhyst_product_q31(int32_t a, int32_t b)
{
  return anhyst_sat_wide(anhyst_rounded_shift(anhyst_wide(a, b), 31));
}

/* Returns whether `count` rows of `length` coefficients, and their shifts, are in range. */
static inline int anhyst_rows_are_valid_q31(anhyst_rows_q31 rows, uint16_t count, uint16_t length)
{
  int valid = length <= ANHYST_ROW_LENGTH;
  int32_t i;
  for (i = 0; valid && i < (int32_t)count * (int32_t)length; i++) {
    valid = rows.number[i] >= -ANHYST_ROW_MOST && rows.number[i] <= ANHYST_ROW_MOST;
  }
  for (i = 0; valid && i < (int32_t)count; i++) {
    valid = rows.shift[i] <= ANHYST_ROW_SHIFT;
  }
  return valid;
}

/* Returns the scalar product of a valid row and `length` signals. Saturates. */
static inline int32_t anhyst_row_product_q31(const int32_t *number, uint16_t shift, uint16_t length,
                                             const int32_t *signal)
{
  int64_t sum = 0;
  uint16_t i;
  for (i = 0; i < length; i++) {
    sum += anhyst_wide(number[i], signal[i]);
  }
  return anhyst_sat_wide(anhyst_rounded_shift(sum, shift));
}

#ifdef __cplusplus
}
#endif
#endif

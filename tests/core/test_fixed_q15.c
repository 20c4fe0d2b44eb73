/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the 16-bit operators of anhyst/numeric/fixed.h for every pair of numbers. The required
   results are inequalities of exact integers. The loops over one factor count contradictions
   without a branch, so that 2^32 pairs take seconds. */
#include "anhyst/numeric/fixed.h"

#include "check.h"

enum { LOW = -32768, HIGH = 32767 };

#ifdef TEST_SANITIZED
enum { STRIDE = 251 }; /* a prime, so that every residue of b occurs with every residue of a */
#else
enum { STRIDE = 1 };
#endif

/* Returns whether r is the number of the format nearest to the exact integer. */
static inline int is_nearest(int32_t r, int32_t exact)
{
  return (r == exact) | ((exact > HIGH) & (r == HIGH)) | ((exact < LOW) & (r == LOW));
}

/* Returns whether r is p/32768 rounded, halves upwards: r - 1/2 <= p/32768 < r + 1/2. */
static inline int is_rounded(int32_t r, int32_t p)
{
  const int32_t left = p - 32768 * r; /* cannot overflow: both within 2^30 */
  const int exact = (left >= -16384) & (left < 16384);
  return exact | ((p == 1073741824) & (r == HIGH));
}

static void sums_and_differences_are_exact_or_saturated(void)
{
  int32_t wrong_sums = 0;
  int32_t wrong_differences = 0;
  for (int32_t a = LOW; a <= HIGH; a += STRIDE) {
    for (int32_t b = LOW; b <= HIGH; b++) {
      wrong_sums += !is_nearest(anhyst_add_q15((int16_t)a, (int16_t)b), a + b);
      wrong_differences += !is_nearest(anhyst_sub_q15((int16_t)a, (int16_t)b), a - b);
    }
    if (wrong_sums + wrong_differences != 0) {
      break;
    }
  }
  CHECK(wrong_sums == 0);
  CHECK(wrong_differences == 0);
}

static void products_are_rounded_to_the_nearest(void)
{
  int32_t wrong = 0;
  for (int32_t a = LOW; a <= HIGH && wrong == 0; a += STRIDE) {
    for (int32_t b = LOW; b <= HIGH; b++) {
      wrong += !is_rounded(anhyst_mul_q15((int16_t)a, (int16_t)b), a * b);
    }
  }
  CHECK(wrong == 0);
}

int main(void)
{
  sums_and_differences_are_exact_or_saturated();
  products_are_rounded_to_the_nearest();
  return verdict();
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the conversion from demand to flux and back: root, square, and the quotient of Newton
   steps, compared with double precision. */
#include "compensator/compensator.c" /* NOLINT(bugprone-suspicious-include): calls static
                                        functions */

#include <stdlib.h>

#include "check.h"
#include "edges.h"
#include "truth.h"

static const double FULL_Q31 = 2147483648.0;
static const double FULL_Q30 = 1073741824.0;
static const int16_t LOWEST_KNEE = 2;
static const int16_t HIGHEST_KNEE = 8;

#ifdef TEST_SANITIZED
static const int32_t STRIDE = 99991;
#else
static const int32_t STRIDE = 997;
#endif

/* Returns the error of the root, LSB, minus the allowed relative error. */
static double root_error_above_limit(int32_t a, int16_t knee)
{
  const double exact = sqrt((double)a / FULL_Q31) * FULL_Q30;
  return fabs((double)root_with_knee(a, knee) - exact) - 2e-9 * exact;
}

static void root_is_accurate_above_the_knee(void)
{
  double worst = 0.0;
  for (int16_t knee = LOWEST_KNEE; knee <= HIGHEST_KNEE; knee++) {
    const int32_t first = (int32_t)1 << (31 - 2 * knee);
    for (int64_t a = first; a <= ANHYST_Q31_MAX; a += STRIDE) {
      keep_largest(&worst, root_error_above_limit((int32_t)a, knee));
    }
    for (int i = 0; i < EDGE_COUNT; i++) {
      if (edge_number(i) >= first) {
        keep_largest(&worst, root_error_above_limit(edge_number(i), knee));
      }
    }
  }
  CHECK_BELOW("root, units in the last place beyond 2e-9", worst, 1.0);
}

static void root_is_linear_below_the_knee(void)
{
  double worst = 0.0;
  for (int16_t knee = LOWEST_KNEE; knee <= HIGHEST_KNEE; knee++) {
    const int32_t end = (int32_t)1 << (31 - 2 * knee);
    for (int32_t a = 0; a < end; a += 1 + end / 100003) {
      CHECK(root_with_knee(a, knee) == a * ((int32_t)1 << (knee - 1)));
      const double flux = (double)root_with_knee(a, knee) / FULL_Q30;
      const double share = fabs(flux * flux - (double)a / FULL_Q31) * (double)(1 << (2 * knee));
      keep_largest(&worst, share);
    }
    CHECK(root_with_knee(end - 1, knee) < (int32_t)1 << (30 - knee));
    CHECK(abs(root_with_knee(end, knee) - ((int32_t)1 << (30 - knee))) <= 1);
  }
  CHECK_BELOW("output lost below the knee, over 2^(-2k)", worst, 0.25);
}

static void root_never_falls(void)
{
  for (int16_t knee = LOWEST_KNEE; knee <= HIGHEST_KNEE; knee++) {
    const int32_t end = (int32_t)1 << (31 - 2 * knee);
    for (int32_t a = end - 3000; a < end + 3000; a++) {
      CHECK(root_with_knee(a + 1, knee) >= root_with_knee(a, knee));
    }
    for (int i = 0; i < EDGE_COUNT; i++) {
      if (edge_number(i) >= 0 && edge_number(i) < ANHYST_Q31_MAX) {
        CHECK(root_with_knee(edge_number(i) + 1, knee) >= root_with_knee(edge_number(i), knee));
      }
    }
  }
}

static void square_inverts_the_root(void)
{
  double off = 0.0;
  double back = 0.0;
  for (int16_t knee = LOWEST_KNEE; knee <= HIGHEST_KNEE; knee++) {
    for (int64_t a = (int64_t)1 << (30 - knee); a < ANHYST_Q30_ONE; a += STRIDE) {
      const double part = (double)a / FULL_Q30;
      keep_largest(&off, fabs((double)square_with_knee((int32_t)a, knee) / FULL_Q31 - part * part));
    }
    for (int64_t a = 0; a <= ANHYST_Q31_MAX; a += STRIDE) {
      const double returned = (double)square_with_knee(root_with_knee((int32_t)a, knee), knee);
      keep_largest(&back, fabs(returned - (double)a) / FULL_Q31);
    }
  }
  CHECK_BELOW("square", off, 1.0 / 32768.0);
  CHECK_BELOW("square of the root", back, 1.0 / 32768.0 + 1e-8);
}

/* Returns the relative error of a quotient above one LSB; 0 if it saturates correctly. */
static double error_of_quotient(int32_t numerator, int32_t denominator)
{
  const double exact = (double)numerator * 65536.0 / (double)denominator;
  const double found = (double)anhyst_quotient(numerator, denominator);
  if (exact >= FULL_Q31 * (1.0 - 1.0 / 16384.0) && found >= FULL_Q31 - 1.0) {
    return 0.0;
  }
  return (fabs(found - exact) - 1.0) / exact;
}

static void quotients_have_fourteen_bits(void)
{
  double worst = 0.0;
  for (int i = 0; i < EDGE_COUNT; i++) {
    for (int j = 0; j < EDGE_COUNT; j++) {
      if (edge_number(i) > 0 && edge_number(j) > 0) {
        keep_largest(&worst, error_of_quotient(edge_number(i), edge_number(j)));
      }
    }
  }
  uint64_t seed = 17;
  for (int i = 0; i < 1000000; i++) {
    const int32_t a = (int32_t)(random_bits(&seed) >> (33 + random_bits(&seed) % 30));
    const int32_t b = (int32_t)(random_bits(&seed) >> (33 + random_bits(&seed) % 30));
    if (a > 0 && b > 0) {
      keep_largest(&worst, error_of_quotient(a, b));
    }
  }
  CHECK_BELOW("quotient", worst, 1.0 / 16384.0);
}

int main(void)
{
  root_is_accurate_above_the_knee();
  root_is_linear_below_the_knee();
  root_never_falls();
  square_inverts_the_root();
  quotients_have_fourteen_bits();
  return verdict();
}

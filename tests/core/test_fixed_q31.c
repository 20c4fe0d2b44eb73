/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the 32-bit operators of anhyst/numeric/fixed.h against exact 64-bit integers: edges
   with edges, edges with every 16-bit number, and pseudo-random numbers. */
#include "anhyst/numeric/fixed.h"

#include "check.h"
#include "edges.h"
#include "truth.h"

static const int64_t LOW = -2147483647 - 1;
static const int64_t HIGH = 2147483647;

#ifdef TEST_SANITIZED
enum { STRIDE = 127, RANDOM_PAIRS = 1000000 };
static const int64_t DENSE = 99991;
#else
enum { STRIDE = 1, RANDOM_PAIRS = 4000000 };
static const int64_t DENSE = 17;
#endif

static int64_t nearest(int64_t exact)
{
  if (exact > HIGH) {
    return HIGH;
  }
  return exact < LOW ? LOW : exact;
}

/* Returns whether r = floor(p/q), q > 0. */
static int is_floor(int64_t r, int64_t p, int64_t q) { return r * q <= p && p < (r + 1) * q; }

static int32_t random_word(uint64_t *seed)
{
  /* All magnitudes with equal probability; uniform numbers are almost never small. */
  const uint64_t bits = random_bits(seed);
  return (int32_t)(uint32_t)(bits >> 32) >> (bits % 32);
}

static void check_pair(int32_t a, int32_t b)
{
  CHECK(anhyst_add_q31(a, b) == nearest((int64_t)a + b));
  CHECK(anhyst_sub_q31(a, b) == nearest((int64_t)a - b));
}

static void check_clamp(int32_t a, int32_t low, int32_t high)
{
  const int32_t kept = anhyst_clamp(a, low, high);
  CHECK(low <= kept && kept <= high);
  CHECK(kept == a || (a < low && kept == low) || (a > high && kept == high));
}

static void check_unary(int32_t a)
{
  CHECK(anhyst_sat_q15(a) == (a > 32767 ? 32767 : (a < -32768 ? -32768 : a)));
  CHECK(anhyst_abs_q31(a) == nearest(a < 0 ? -(int64_t)a : a));
  const int32_t rounded = anhyst_round_q31(a);
  CHECK(rounded == 32767 ? a >= 32767 * 65536LL - 32768 : is_floor(rounded, a + 32768LL, 65536));
  if (a > 0) {
    const int n = anhyst_headroom(a);
    CHECK(n >= 0 && n <= 30 && ((int64_t)a << n) <= HIGH && ((int64_t)a << n) >= 1073741824LL);
  }
}

static void check_shifts(int32_t a)
{
  for (int n = 0; n <= 31; n++) {
    CHECK(anhyst_shl_q31(a, (uint16_t)n) == nearest((int64_t)a * ((int64_t)1 << n)));
  }
}

static void operators_hold_for_pairs_of_edges(void)
{
  for (int i = 0; i < EDGE_COUNT; i++) {
    check_unary(edge_number(i));
    check_shifts(edge_number(i));
    for (int j = 0; j < EDGE_COUNT; j++) {
      check_pair(edge_number(i), edge_number(j));
      const int32_t low = edge_number(j);
      const int32_t high = edge_number((7 * i + j) % EDGE_COUNT);
      check_clamp(edge_number(i), low < high ? low : high, low < high ? high : low);
    }
  }
}

static void scaling_is_the_floor_of_the_product(void)
{
  int64_t wrong = 0;
  for (int i = 0; i < EDGE_COUNT; i++) {
    for (int32_t b = -32768; b <= 32767; b += STRIDE) {
      wrong +=
          !is_floor(anhyst_scale(edge_number(i), (int16_t)b), (int64_t)edge_number(i) * b, 65536);
    }
  }
  CHECK(wrong == 0);
}

static void operators_hold_for_random_numbers(void)
{
  uint64_t seed = 31;
  for (int i = 0; i < RANDOM_PAIRS; i++) {
    const int32_t a = random_word(&seed);
    const int32_t b = random_word(&seed);
    const int32_t c = random_word(&seed);
    check_pair(a, b);
    check_clamp(a, b < c ? b : c, b < c ? c : b);
    CHECK(is_floor(anhyst_scale(a, (int16_t)(c >> 16)), (int64_t)a * (c >> 16), 65536));
    CHECK(anhyst_shl_q31(a, (uint16_t)(i % 32)) == nearest((int64_t)a * ((int64_t)1 << (i % 32))));
  }
}

static void unary_operators_hold_for_many_numbers(void)
{
  for (int64_t a = LOW; a <= HIGH; a += DENSE) {
    check_unary((int32_t)a);
  }
}

int main(void)
{
  operators_hold_for_pairs_of_edges();
  scaling_is_the_floor_of_the_product();
  operators_hold_for_random_numbers();
  unary_operators_hold_for_many_numbers();
  return verdict();
}

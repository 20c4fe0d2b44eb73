/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the parts of the simplified law in fixed point: the table over octaves and its search,
   the distance, and the slope. The reference is the equation z = -ln v + nu*v - nu in double
   precision. */
#include "compensator/simplified.c" /* NOLINT(bugprone-suspicious-include): calls static
                                       functions */

#include "check.h"
#include "truth.h"

static const double FULL_Q27 = 134217728.0;
static const double FULL_Q30 = 1073741824.0;
static const double NUS[] = {0.0, 0.5, 0.9, 0.98};
enum { NU_COUNT = 4, MOST_ENTRIES = 15 * 64 + 1 };
static int16_t words[ANHYST_BLOCK_LEAST_WORDS + MOST_ENTRIES];

/* Return z for 0 < v <= 1, and v for a z by bisection. */
static double true_distance(double nu, double v) { return -log(v) + nu * v - nu; }

static double v_from_z(double nu, double z)
{
  double low = 1e-12;
  double high = 1.0;
  for (int i = 0; i < 60; i++) {
    const double middle = sqrt(low * high);
    if (true_distance(nu, middle) > z) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return sqrt(low * high);
}

/* Returns the first z of a segment from the layout of the octaves. */
static double segment_begin(int octaves, int n, int index)
{
  const int octave = index >> n;
  const double inside = (double)(index - (octave << n)) / (double)(1 << n);
  const double first = 16.0 / pow(2.0, octaves);
  return octave == 0 ? inside * first : first * pow(2.0, octave - 1) * (1.0 + inside);
}

static int fill_curve(double nu, int octaves, int n)
{
  const int segments = (octaves + 1) << n;
  words[ANHYST_WORD_SIMPLE_OCTAVES] = (int16_t)octaves;
  words[ANHYST_WORD_SIMPLE_SEGMENTS] = (int16_t)n;
  words[ANHYST_WORD_SIMPLE_CURVE] = ANHYST_BLOCK_LEAST_WORDS;
  for (int i = 0; i <= segments; i++) {
    const double p = 1.0 - v_from_z(nu, segment_begin(octaves, n, i));
    words[ANHYST_BLOCK_LEAST_WORDS + i] = (int16_t)lrint(fmin(p * 32768.0, 32767.0));
  }
  return segments;
}

/* Returns the deviation of state_at_distance from the straight line, LSB per rise of its
   segment. */
static double interpolation_error(int octaves, int n, int segments, int32_t z)
{
  const double place = (double)z / FULL_Q27;
  int index = 0;
  while (index < segments - 1 && segment_begin(octaves, n, index + 1) <= place) {
    index++;
  }
  const double begin = segment_begin(octaves, n, index);
  const double share = (place - begin) / (segment_begin(octaves, n, index + 1) - begin);
  const double low = words[ANHYST_BLOCK_LEAST_WORDS + index];
  const double rise = words[ANHYST_BLOCK_LEAST_WORDS + index + 1] - low;
  const double exact = (low + rise * share) * 32768.0;
  return fabs((double)state_at_distance(words, z) - exact) / (rise + 1e-6);
}

static void check_table(int octaves, int n, int segments, double *worst, double *lost)
{
  uint64_t seed = 3;
  for (int i = 0; i < 3000; i++) {
    const int32_t z = (int32_t)(random_bits(&seed) >> (33 + random_bits(&seed) % 24));
    keep_largest(worst, interpolation_error(octaves, n, segments, z));
    const int32_t p = (int32_t)(random_bits(&seed) % (uint64_t)ANHYST_Q30_ONE);
    const int32_t top = words[ANHYST_BLOCK_LEAST_WORDS + segments] * 32768;
    const int32_t back = state_at_distance(words, distance_at_state(words, p));
    CHECK(back <= p);
    keep_largest(lost, (double)((p < top ? p : top) - back) / FULL_Q30);
  }
}

static void table_and_search_agree(void)
{
  double worst = 0.0;
  double lost = 0.0;
  for (int octaves = 4; octaves <= 14; octaves++) {
    for (int n = 2; n <= 6; n += 2) {
      const int segments = fill_curve(NUS[(octaves + n) % NU_COUNT], octaves, n);
      check_table(octaves, n, segments, &worst, &lost);
      CHECK(state_at_distance(words, 0) == 0);
      CHECK(state_at_distance(words, ANHYST_Q31_MAX) >= 32766 * 32768);
      CHECK(state_at_distance(words, distance_at_state(words, 0)) == 0);
    }
  }
  CHECK_BELOW("p over z, units in the last place over the rise of a segment", worst, 1.0);
  CHECK_BELOW("there and back", lost, 1.0 / 16384.0);
}

static void table_matches_the_law(void)
{
  double worst = 0.0;
  for (int i = 0; i < NU_COUNT; i++) {
    (void)fill_curve(NUS[i], 12, 4);
    for (int step = 0; step < 5500; step++) {
      const double z = 1e-6 * pow(1.003, step); /* up to 14 */
      const double found =
          (double)state_at_distance(words, (int32_t)lrint(z * FULL_Q27)) / FULL_Q30;
      keep_largest(&worst, fabs(found - (1.0 - v_from_z(NUS[i], z))));
    }
  }
  CHECK_BELOW("p over z with 16 segments an octave", worst, 5e-4);
}

static void travel_is_scaled(void)
{
  uint64_t seed = 9;
  for (int i = 0; i < 200000; i++) {
    const int32_t way = (int32_t)(random_bits(&seed) >> (33 + random_bits(&seed) % 31));
    const int16_t weight = (int16_t)(1 + random_bits(&seed) % 32767);
    const int16_t shift = (int16_t)(random_bits(&seed) % 13);
    const double exact = (double)way * weight * (double)(1 << shift) / 65536.0;
    const double found = (double)scale_travel(way, weight, shift);
    const int is_short = (double)way * (double)(1 << shift) < 2147483648.0;
    if (exact >= 2147483647.0) {
      CHECK(found >= 2147483647.0 - (double)(1 << shift));
    } else {
      CHECK(found <= exact && found > exact - (is_short ? 1.0 : (double)(1 << shift)));
    }
  }
}

static void slope_matches_the_equation(void)
{
  double worst = 0.0;
  for (int i = 0; i < NU_COUNT; i++) {
    for (int step = 0; step < 4; step++) {
      const double rate = 0.25 * pow(5.0, step);
      const double hold = rate / (1.0 - NUS[i]);
      const int shift = (int)fmax(ceil(log2(rate / 8.0 / 0.49)), 0.0);
      const int hold_shift = (int)fmax(ceil(log2(hold / 0.49)), 0.0);
      words[ANHYST_WORD_SIMPLE_RATE] = (int16_t)lrint(rate / 8.0 / pow(2.0, shift) * 65536.0);
      words[ANHYST_WORD_SIMPLE_RATE_SHIFT] = (int16_t)shift;
      words[ANHYST_WORD_SIMPLE_HOLD] = (int16_t)lrint(hold / pow(2.0, hold_shift) * 65536.0);
      words[ANHYST_WORD_SIMPLE_HOLD_SHIFT] = (int16_t)hold_shift;
      words[ANHYST_WORD_SIMPLE_REST] = (int16_t)lrint(fmin((1.0 - NUS[i]) * 32768.0, 32767.0));
      for (int k = -300; k <= 300; k++) {
        const double p = k / 300.0;
        const double v = 1.0 - p;
        const double exact = (p < 0.0 ? hold : rate * v / (1.0 - NUS[i] * v)) * 1024.0;
        const double found = (double)state_slope(words, (int32_t)lrint(p * FULL_Q30));
        keep_largest(&worst, (fabs(found - exact) - 2.0) / (exact + 1.0));
      }
    }
  }
  CHECK_BELOW("slope, relative beyond two units of 1/1024", worst, 2e-3);
}

int main(void)
{
  table_and_search_agree();
  table_matches_the_law();
  travel_is_scaled();
  slope_matches_the_equation();
  return verdict();
}

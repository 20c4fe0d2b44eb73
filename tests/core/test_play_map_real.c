/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the map with one play in floating point: it agrees with fixed point except for
   rounding, no damage of its block is accepted, and no signal exceeds the limits. */
#include "edges.h"
#include "rest.h"

static any_play made;

static const double FULL = 2147483648.0;

/* The same signals in every format, from one block. The reference is fixed point, which
   test_fixed_play_map.c compares with the law. */
static void formats_agree(void)
{
  double solve = 0.0;
  double single = 0.0;
  for (int i = 0; i < 100; i++) {
    anhyst_play_map_q31 fixed;
    anhyst_play_map_f64 real;
    anhyst_play_map_f32 narrow;
    make_play(&made, (uint16_t)(i % 9), (uint16_t)(i % 5), 65536 >> (i % 9));
    CHECK(anhyst_play_map_init_q31(&fixed, made.fixed, made.count) == ANHYST_OK);
    CHECK(anhyst_play_map_init_f64(&real, made.real, made.count) == ANHYST_OK);
    CHECK(anhyst_play_map_init_f32(&narrow, made.single, made.count) == ANHYST_OK);
    for (int at = 0; at < SIGNALS; at++) {
      const int32_t demand = any_code();
      const int32_t gap = any_code();
      const double half = anhyst_map_value_q31(&made.half, demand, gap) / FULL;
      real.play = fixed.play / FULL;
      narrow.play = (float)(fixed.play / FULL);
      const int32_t current = anhyst_play_map_solve_q31(&fixed, demand, gap);
      const double right = anhyst_play_map_solve_f64(&real, demand / FULL, gap / FULL);
      const float rounded =
          anhyst_play_map_solve_f32(&narrow, (float)(demand / FULL), (float)(gap / FULL));
      keep_largest(&solve, fabs(right - current / FULL) - half * ldexp(1.0, -15));
      keep_largest(&single, fabs(right - (double)rounded) - half * ldexp(1.0, -12));
      anhyst_play_map_commit_q31(&fixed, at % 2 == 0 ? any_code() : current, gap);
    }
  }
  CHECK_BELOW("solve in double against fixed point, beyond 2^-15 of half", solve, 1e-8);
  CHECK_BELOW("solve in single precision, beyond 2^-12 of half", single, 1e-6);
}

/* Returns the distance of a current from the currents of forces within a tolerance. */
static double current_beside(anhyst_play_map_f64 c, double applied, double force, double gap,
                             double room)
{
  const double low = anhyst_play_map_solve_f64(&c, 0.0, gap);
  const double high = anhyst_play_map_solve_f64(&c, 1.0, gap);
  const double reached = fmin(fmax(applied, low), high);
  const double last = anhyst_play_map_solve_f64(&c, force - room, gap);
  return fmax(last - reached, reached - anhyst_play_map_solve_f64(&c, force + room, gap));
}

static void commit_finds_the_force_of_any_current(void)
{
  double worst = 0.0;
  double worst_single = 0.0;
  for (int i = 0; i < 200; i++) {
    anhyst_play_map_f64 c;
    anhyst_play_map_f32 narrow;
    make_play(&made, (uint16_t)(i % 9), (uint16_t)(i % 5), 65536 >> (i % 9));
    CHECK(anhyst_play_map_init_f64(&c, made.real, made.count) == ANHYST_OK);
    CHECK(anhyst_play_map_init_f32(&narrow, made.single, made.count) == ANHYST_OK);
    for (int at = 0; at < SIGNALS; at++) {
      const double gap = (double)(float)uniform(&seed, -0.1, 1.1);
      const anhyst_play_map_f64 before = c;
      narrow.play = (float)c.play;
      const double solved = anhyst_play_map_solve_f64(&c, uniform(&seed, 0.0, 1.0), gap);
      const double applied =
          at % 2 == 0 ? uniform(&seed, -1.0, 1.0) : floor(solved * 2048.0) / 2048.0;
      anhyst_play_map_solve_f32(&narrow, (float)c.demand, (float)gap);
      const double force = anhyst_play_map_commit_f64(&c, applied, gap);
      const float single = anhyst_play_map_commit_f32(&narrow, (float)applied, (float)gap);
      keep_largest(&worst, current_beside(before, applied, force, gap, 1e-13));
      keep_largest(&worst_single, current_beside(before, applied, (double)single, gap, 1e-6));
    }
  }
  CHECK_BELOW("current at the force that was found", worst, 1e-12);
  CHECK_BELOW("the same in single precision", worst_single, 1e-4);
}

/* Flips every bit of a block. */
static void block_with_a_flipped_bit_is_refused(void)
{
  make_play(&made, 3, 2, 1000);
  for (int word = 0; word < made.count; word++) {
    for (int bit = 0; bit < 32; bit++) {
      anhyst_play_map_f32 c;
      const float right = made.single[word];
      uint32_t bits;
      memcpy(&bits, &right, sizeof bits);
      bits ^= (uint32_t)1 << bit;
      memcpy(&made.single[word], &bits, sizeof bits);
      const int is_same = !is_counted(word) && made.single[word] == right; /* -0 instead of 0 */
      CHECK(is_same ||
            anhyst_play_map_init_f32(&c, made.single, made.count) == ANHYST_BAD_PARAMETER);
      made.single[word] = right;
    }
  }
}

/* Sets a word, updates the checksum, and returns whether the block is rejected without a change. */
static int is_block_refused(int word, double value)
{
  anhyst_play_map_f32 c;
  anhyst_play_map_f32 untouched;
  const float right = made.single[word];
  memset(&c, 0x5A, sizeof c);
  untouched = c;
  made.single[word] = (float)value;
  set_checksums(&made);
  const int refused = anhyst_play_map_init_f32(&c, made.single, made.count) == ANHYST_BAD_PARAMETER;
  made.single[word] = right;
  set_checksums(&made);
  return refused && memcmp(&c, &untouched, sizeof c) == 0;
}

static void invalid_blocks_are_refused(void)
{
  static const int counted[] = {ANHYST_WORD_MAGIC,
                                ANHYST_WORD_LAYOUT,
                                ANHYST_WORD_KIND,
                                ANHYST_WORD_LENGTH,
                                ANHYST_WORD_PLAY_FORCE_SEGMENTS,
                                ANHYST_WORD_PLAY_GAP_SEGMENTS,
                                ANHYST_WORD_PLAY_STEEPNESS,
                                ANHYST_WORD_PLAY_SHIFT,
                                ANHYST_WORD_PLAY_DEMAND_LOW,
                                ANHYST_WORD_PLAY_CURRENT_LOW,
                                ANHYST_WORD_PLAY_CURRENT_HIGH,
                                ANHYST_WORD_SCALE_DEMAND,
                                ANHYST_WORD_SCALE_GAP_LOW,
                                FIRST,
                                FIRST + 45};
  static const double wrong[] = {(double)NAN, (double)INFINITY, -(double)INFINITY, -1e31, 1e31};
  make_play(&made, 3, 2, 1000);
  anhyst_play_map_f32 c;
  CHECK(anhyst_play_map_init_f32(&c, made.single, made.count) == ANHYST_OK);
  CHECK(anhyst_play_map_init_f32(&c, made.single, (uint16_t)(made.count - 1)) ==
        ANHYST_BAD_PARAMETER);
  for (size_t i = 0; i < sizeof counted / sizeof *counted; i++) {
    for (size_t j = 0; j < sizeof wrong / sizeof *wrong; j++) {
      CHECK(is_block_refused(counted[i], wrong[j]));
    }
  }
  CHECK(is_block_refused(ANHYST_WORD_PLAY_FORCE_SEGMENTS, 3.0000002));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_STEEPNESS, 0.0));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_STEEPNESS, -1.0));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_DEMAND_LOW, 1.0));
  made.single[ANHYST_WORD_PLAY_CURRENT_LOW] = 0.5F;
  CHECK(is_block_refused(ANHYST_WORD_PLAY_CURRENT_HIGH, 0.25));
}

static void no_signal_exceeds_the_limits(void)
{
  static const float extremes[] = {NAN,    INFINITY, -INFINITY, 3e38F, -3e38F, 1e30F, -1e30F,
                                   1e-45F, 0.0F,     -0.0F,     0.5F,  1.0F,   -1.0F, 2e30F};
  enum { COUNT = sizeof extremes / sizeof *extremes };
  make_play(&made, 4, 2, 3000);
  made.single[ANHYST_WORD_PLAY_CURRENT_LOW] = -0.01F;
  made.single[ANHYST_WORD_PLAY_CURRENT_HIGH] = 0.1F;
  set_checksums(&made);
  anhyst_play_map_f32 c;
  CHECK(anhyst_play_map_init_f32(&c, made.single, made.count) == ANHYST_OK);
  for (int i = 0; i < COUNT * COUNT * COUNT * COUNT; i++) {
    const float demand = extremes[i % COUNT];
    const float gap = extremes[i / COUNT % COUNT];
    const float applied = extremes[i / COUNT / COUNT % COUNT];
    const float applied_gap = extremes[i / COUNT / COUNT / COUNT];
    const float current = anhyst_play_map_solve_f32(&c, demand, gap);
    CHECK(current >= -0.01F && current <= 0.1F);
    CHECK(!isnan(demand) || (c.flags & ANHYST_DEMAND_LIMITED) != 0U);
    CHECK((gap >= 0.0F && gap <= 1.0F) || (c.flags & ANHYST_GAP_LIMITED) != 0U || gap == 1e-45F);
    const float before = c.play;
    const float force = anhyst_play_map_commit_f32(&c, applied, applied_gap);
    CHECK(force >= 0.0F && force <= 1.0F);
    CHECK(c.play >= -2.0F && c.play <= 2.0F);
    CHECK(fabsf(applied) <= 1e30F || c.play == before);
    CHECK(fabsf(applied) <= 0.1F || applied == current || (c.flags & ANHYST_CURRENT_LIMITED) != 0U);
  }
}

int main(void)
{
  formats_agree();
  commit_finds_the_force_of_any_current();
  block_with_a_flipped_bit_is_refused();
  invalid_blocks_are_refused();
  no_signal_exceeds_the_limits();
  current_does_not_drift_at_rest(100000);
  return verdict();
}

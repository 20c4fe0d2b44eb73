/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the map with one play in fixed point. The reference is the same law in double
   precision. It reads its tables with the map that test_fixed_map.c compares with exact
   arithmetic. */
#include "check.h"
#include "edges.h"
#include "plays.h"

static const double FULL = 2147483648.0;
static any_play made;

/* Starts a compensator with a random block. */
static anhyst_play_map_q31 start_with_any_block(uint16_t n, uint16_t m, int32_t step)
{
  anhyst_play_map_q31 c = {0};
  make_play(&made, n, m, step);
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_OK);
  return c;
}

static anhyst_play_map_q31 make_random_map(int i)
{
  return start_with_any_block((uint16_t)(i % 9), (uint16_t)(i % 5), 65536 >> (i % 9));
}

static void solve_matches_the_law(void)
{
  double worst = 0.0;
  for (int i = 0; i < 200; i++) {
    anhyst_play_map_q31 c = make_random_map(i);
    for (int at = 0; at < SIGNALS; at++) {
      const int32_t force = at < EDGE_COUNT && at % 2 == 0 ? edge_number(at) : any_code();
      const int32_t gap = any_code();
      const int32_t value = anhyst_map_value_q31(&made.map, force, gap);
      const int32_t half = anhyst_map_value_q31(&made.half, force, gap);
      c.play = at % 3 == 0 ? any_code() : any_within(value / 2, value / 2 + ANHYST_Q31_MAX / 2);
      const int32_t before = c.play;
      const double side = ((double)value - before) / (made.radius * FULL);
      const double right = value + half * fmin(fmax(side, -1.0), 1.0);
      const double current = anhyst_play_map_solve_q31(&c, force, gap);
      keep_largest(&worst, fabs(current - right) - half * ldexp(1.0, -15));
      CHECK(c.play == before);
    }
  }
  CHECK_BELOW("solve beyond 2^-15 of half, units in the last place", worst, 4.0);
}

/* The play after a commit must be consistent with the applied current. */
static void commit_finds_the_force_of_any_current(void)
{
  double worst = 0.0;
  double beyond = 0.0;
  for (int i = 0; i < 200; i++) {
    anhyst_play_map_q31 c = make_random_map(i);
    for (int at = 0; at < SIGNALS; at++) {
      c.play = at % 7 == 0 ? any_code() : c.play;
      const int32_t gap = any_code();
      const anhyst_play_map_q31 before = c;
      const int32_t solved = anhyst_play_map_solve_q31(&c, any_code(), gap);
      const int32_t applied = at % 2 == 0 ? any_code() : solved / 4096 * 4096;
      const int32_t force = anhyst_play_map_commit_q31(&c, applied, gap);
      CHECK(force >= 0);
      anhyst_play_map_q31 again = before;
      const int32_t low = anhyst_play_map_solve_q31(&again, 0, gap);
      const int32_t high = anhyst_play_map_solve_q31(&again, ANHYST_Q31_MAX, gap);
      const double reached = fmin(fmax((double)applied, (double)low), (double)high);
      const double next =
          anhyst_play_map_solve_q31(&again, force < ANHYST_Q31_MAX - 64 ? force + 64 : force, gap);
      const double last = anhyst_play_map_solve_q31(&again, force > 64 ? force - 64 : 0, gap);
      keep_largest(&worst, fmax(last - reached, reached - next));
      const double value = anhyst_map_value_q31(&made.map, force, gap);
      keep_largest(&beyond, fabs(c.play - value) - c.law.radius);
    }
  }
  CHECK_BELOW("current at the force that was found", worst, 2048.0);
  CHECK_BELOW("play beyond its radius, units in the last place", beyond, 16.0);
}

static void solved_current_gives_exactly_the_demand(void)
{
  anhyst_play_map_q31 c = start_with_any_block(6, 3, 900);
  for (int at = 0; at < SIGNALS; at++) {
    const int32_t demand = any_code();
    const int32_t gap = any_code();
    const int32_t current = anhyst_play_map_solve_q31(&c, demand, gap);
    CHECK(c.flags ==
          (demand < 0 ? ANHYST_DEMAND_LIMITED : 0U) + (gap < 0 ? ANHYST_GAP_LIMITED : 0U));
    CHECK(anhyst_play_map_commit_q31(&c, current, gap) == (demand > 0 ? demand : 0));
  }
}

static void limits_are_applied_and_flagged(void)
{
  make_play(&made, 5, 2, 2000);
  made.fixed[ANHYST_WORD_PLAY_CURRENT_LOW] = -10;
  made.fixed[ANHYST_WORD_PLAY_CURRENT_HIGH] = 1000;
  set_checksums(&made);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_OK);
  for (int at = 0; at < SIGNALS; at++) {
    const int32_t demand = at < EDGE_COUNT ? edge_number(at) : any_code();
    const int32_t current = anhyst_play_map_solve_q31(&c, demand, any_code());
    CHECK(current >= -10 * 65536 && current <= 1000 * 65536);
    CHECK(((c.flags & ANHYST_CURRENT_LIMITED) != 0U) == (c.at.current != current));
    anhyst_play_map_commit_q31(&c, at % 3 == 0 ? edge_number(at) : current,
                               edge_number((7 * at) % EDGE_COUNT));
  }
}

static void commit_adds_range_flags(void)
{
  const int32_t most = 1000 * 65536;
  make_play(&made, 5, 2, 2000);
  made.fixed[ANHYST_WORD_PLAY_CURRENT_HIGH] = 1000;
  set_checksums(&made);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_OK);
  anhyst_play_map_commit_q31(&c, most + 65536, 0); /* a converter may round up to this current */
  CHECK(c.flags == 0U);
  anhyst_play_map_commit_q31(&c, most + 65537, 0);
  CHECK(c.flags == ANHYST_CURRENT_LIMITED);
  anhyst_play_map_solve_q31(&c, -1, 5);
  CHECK((c.flags & ~(unsigned)ANHYST_CURRENT_LIMITED) == ANHYST_DEMAND_LIMITED);
  anhyst_play_map_commit_q31(&c, 0, -5);
  CHECK((c.flags & ~(unsigned)ANHYST_CURRENT_LIMITED) ==
        (ANHYST_DEMAND_LIMITED | ANHYST_GAP_LIMITED));
  anhyst_play_map_commit_q31(&c, 0, 5);
  CHECK(c.flags == 0U);
}

static void block_with_a_flipped_bit_is_refused(void)
{
  start_with_any_block(3, 2, 1000);
  for (int word = 0; word < made.count; word++) {
    for (int bit = 0; bit < 16; bit++) {
      anhyst_play_map_q31 c;
      const int16_t right = made.fixed[word];
      made.fixed[word] = (int16_t)(uint16_t)((uint16_t)right ^ (1U << bit));
      CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_BAD_PARAMETER);
      made.fixed[word] = right;
    }
  }
}

/* Sets a word, updates the checksum, and returns whether the block is rejected without a change. */
static int is_block_refused(int word, int16_t value)
{
  anhyst_play_map_q31 c;
  anhyst_play_map_q31 untouched;
  const int16_t right = made.fixed[word];
  memset(&c, 0x5A, sizeof c);
  untouched = c;
  made.fixed[word] = value;
  set_checksums(&made);
  const int refused = anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_BAD_PARAMETER;
  made.fixed[word] = right;
  set_checksums(&made);
  return refused && memcmp(&c, &untouched, sizeof c) == 0;
}

static void invalid_blocks_are_refused(void)
{
  anhyst_play_map_q31 c = start_with_any_block(3, 2, 1000);
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, (uint16_t)(made.count - 1U)) ==
        ANHYST_BAD_PARAMETER);
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, 0) == ANHYST_BAD_PARAMETER);
  CHECK(is_block_refused(ANHYST_WORD_KIND, ANHYST_KIND_CELLS));
  CHECK(is_block_refused(ANHYST_WORD_LAYOUT, ANHYST_BLOCK_LAYOUT + 1));
  CHECK(is_block_refused(ANHYST_WORD_LENGTH, (int16_t)(made.count - 1)));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_FORCE_SEGMENTS, 4));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_FORCE_SEGMENTS, 9));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_GAP_SEGMENTS, -1));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_CURRENT, FIRST + 1));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_HALF, FIRST));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_STEEPNESS, 16383));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_SHIFT, 10));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_SHIFT, -1));
  CHECK(is_block_refused(ANHYST_WORD_PLAY_DEMAND_LOW, -1));
  made.fixed[ANHYST_WORD_PLAY_CURRENT_LOW] = 5;
  CHECK(is_block_refused(ANHYST_WORD_PLAY_CURRENT_HIGH, 4));
}

static void invalid_tables_are_refused(void)
{
  start_with_any_block(0, 0, 1000);
  const int16_t valid[] = {0, 5, 0, 5, 0, 0, 0, 0};
  const int16_t wrong[] = {6, -32767 - 1, 6, -1, -1, 6, -1, 6};
  memcpy(made.fixed + FIRST, valid, sizeof valid);
  set_checksums(&made);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_OK);
  for (int i = 0; i < 8; i++) {
    CHECK(is_block_refused(FIRST + i, wrong[i]));
  }
  CHECK(is_block_refused(FIRST + 4, 6)); /* a half-width that falls more than the map rises */
  const int16_t high[] = {32762, 32767, 32762, 32767, 5, 0, 5, 0};
  memcpy(made.fixed + FIRST, high, sizeof high);
  set_checksums(&made);
  CHECK(anhyst_play_map_init_q31(&c, made.fixed, made.count) == ANHYST_OK);
  CHECK(is_block_refused(FIRST + 5, 1)); /* a branch beyond the range of the format */
}

int main(void)
{
  solve_matches_the_law();
  commit_finds_the_force_of_any_current();
  solved_current_gives_exactly_the_demand();
  limits_are_applied_and_flagged();
  commit_adds_range_flags();
  block_with_a_flipped_bit_is_refused();
  invalid_blocks_are_refused();
  invalid_tables_are_refused();
  return verdict();
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of the map with one play, in fixed point. The oracle is the same law in double, its tables
   read by the map that test_fixed_map.c holds against exact arithmetic. */
#include "anhyst/compensator/play_map.h"

#include "check.h"
#include "edges.h"
#include "maps.h"

static int16_t entries[MOST_COLUMNS * MOST_ROWS];
static int16_t halves[MOST_COLUMNS * MOST_ROWS];

static const double FULL = 2147483648.0;

/* Half-widths of any kind that a map allows: no steeper than it, and within the format. */
static void fill_halves(const anhyst_map_q31 *map)
{
  const int columns = (1 << map->force_segments) + 1;
  const int count = columns * ((1 << map->gap_segments) + 1);
  for (int i = 0; i < count; i++) {
    const int32_t at = map->entries[i];
    const int32_t room = 32767 - (at < 0 ? -at : at);
    const int32_t rise = i % columns == 0 ? 0 : at - map->entries[i - 1];
    int32_t half = i % columns == 0 ? any_within(0, room) : halves[i - 1] + any_within(-rise, rise);
    half = half > room ? room : half;
    halves[i] = (int16_t)(half < 0 ? 0 : half);
  }
}

static anhyst_play_law_q31 any_law(uint16_t n, uint16_t m, int32_t step)
{
  anhyst_play_law_q31 law;
  law.map = any_map(entries, n, m, step);
  fill_halves(&law.map);
  law.half.entries = halves;
  law.half.force_segments = n;
  law.half.gap_segments = m;
  /* 1/(4*radius) to 16 bits, and the radius that goes with it. */
  law.steepness.mantissa = (int16_t)any_within(16384, 32767);
  law.steepness.shift = (int16_t)any_within(1, 8);
  const double steepness = ldexp((double)law.steepness.mantissa, law.steepness.shift - 16);
  law.radius = (int32_t)fmin(FULL - 1.0, floor(FULL / (4.0 * steepness)));
  return law;
}

static double half_share(const anhyst_play_law_q31 *law, double over)
{
  return fmin(fmax(over / (double)law->radius, -1.0), 1.0);
}

static void a_solve_is_the_law(void)
{
  double worst = 0.0;
  for (int i = 0; i < 200; i++) {
    const anhyst_play_law_q31 law = any_law((uint16_t)(i % 9), (uint16_t)(i % 5), 65536 >> (i % 9));
    anhyst_play_map_q31 c;
    CHECK(anhyst_play_map_init_q31(&c, &law, ANHYST_Q31_MIN, ANHYST_Q31_MAX) == ANHYST_OK);
    for (int at = 0; at < SIGNALS; at++) {
      const int32_t force = at < EDGE_COUNT && at % 2 == 0 ? edge(at) : any_code();
      const int32_t gap = any_code();
      const int32_t value = anhyst_map_value_q31(&law.map, force, gap);
      const int32_t half = anhyst_map_value_q31(&law.half, force, gap);
      c.play = at % 3 == 0 ? any_code() : any_within(value / 2, value / 2 + ANHYST_Q31_MAX / 2);
      const int32_t before = c.play;
      const double right = value + half * half_share(&law, (double)value - before);
      const double got = anhyst_play_map_solve_q31(&c, force, gap);
      keep_worst(&worst, fabs(got - right) - half * ldexp(1.0, -15));
      CHECK(c.play == before);
    }
  }
  CHECK_BELOW("solve beyond 2^-15 of half, units in the last place", worst, 4.0);
}

/* What the play is after a commit must have led to the current that was applied. */
static void a_commit_finds_the_force_of_any_current(void)
{
  double worst = 0.0;
  double beyond = 0.0;
  for (int i = 0; i < 200; i++) {
    const anhyst_play_law_q31 law = any_law((uint16_t)(i % 9), (uint16_t)(i % 5), 65536 >> (i % 9));
    anhyst_play_map_q31 c;
    CHECK(anhyst_play_map_init_q31(&c, &law, ANHYST_Q31_MIN, ANHYST_Q31_MAX) == ANHYST_OK);
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
      keep_worst(&worst, fmax(last - reached, reached - next));
      const double value = anhyst_map_value_q31(&law.map, force, gap);
      keep_worst(&beyond, fabs(c.play - value) - law.radius);
    }
  }
  CHECK_BELOW("current at the force that was found", worst, 262144.0);
  CHECK_BELOW("play beyond its radius", beyond, 0.0);
}

static void what_was_solved_gives_the_demand_to_the_bit(void)
{
  const anhyst_play_law_q31 law = any_law(6, 3, 900);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, &law, ANHYST_Q31_MIN, ANHYST_Q31_MAX) == ANHYST_OK);
  for (int at = 0; at < SIGNALS; at++) {
    const int32_t demand = any_code();
    const int32_t gap = any_code();
    const int32_t current = anhyst_play_map_solve_q31(&c, demand, gap);
    CHECK((c.flags != 0U) == (demand < 0));
    CHECK(anhyst_play_map_commit_q31(&c, current, gap) == (demand > 0 ? demand : 0));
  }
}

static void limits_hold_and_show(void)
{
  const anhyst_play_law_q31 law = any_law(5, 2, 2000);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, &law, -1000, 1000) == ANHYST_OK);
  for (int at = 0; at < SIGNALS; at++) {
    const int32_t current = anhyst_play_map_solve_q31(&c, any_code(), any_code());
    CHECK(current >= -1000 && current <= 1000);
    CHECK(((c.flags & ANHYST_CURRENT_LIMITED) != 0U) == (c.wanted != c.current));
  }
}

static void invalid_laws_are_refused(void)
{
  const anhyst_play_law_q31 valid = any_law(3, 2, 1000);
  anhyst_play_map_q31 c;
  CHECK(anhyst_play_map_init_q31(&c, &valid, 0, 1) == ANHYST_OK);
  CHECK(anhyst_play_map_init_q31(&c, &valid, 1, 0) == ANHYST_BAD_PARAMETER);
  anhyst_play_law_q31 law = valid;
  law.radius = ANHYST_PLAY_LEAST_RADIUS - 1;
  CHECK(anhyst_play_law_check_q31(&law) == ANHYST_BAD_PARAMETER);
  law = valid;
  law.half.entries = 0;
  CHECK(anhyst_play_law_check_q31(&law) == ANHYST_BAD_PARAMETER);
  law = valid;
  law.half.force_segments = 2;
  CHECK(anhyst_play_law_check_q31(&law) == ANHYST_BAD_PARAMETER);
  law = valid;
  law.steepness.shift = 17;
  CHECK(anhyst_play_law_check_q31(&law) == ANHYST_BAD_PARAMETER);
  const int16_t map[] = {0, 5, 0, 5};
  const int16_t below_zero[] = {-1, 0, 0, 0};
  const int16_t steeper[] = {0, 6, 0, 0};
  const int16_t falling[] = {6, 0, 0, 0};
  const int16_t beyond[] = {32767, 32763, 0, 0};
  const int16_t *const wrong[] = {below_zero, steeper, falling, beyond};
  for (int i = 0; i < 4; i++) {
    const anhyst_play_law_q31 bad = {{map, 0, 0}, {wrong[i], 0, 0}, 1000, {16384, 1}};
    CHECK(anhyst_play_law_check_q31(&bad) == ANHYST_BAD_PARAMETER);
  }
}

int main(void)
{
  a_solve_is_the_law();
  a_commit_finds_the_force_of_any_current();
  what_was_solved_gives_the_demand_to_the_bit();
  limits_hold_and_show();
  invalid_laws_are_refused();
  return verdict();
}

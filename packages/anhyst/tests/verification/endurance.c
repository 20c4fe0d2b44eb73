/* SPDX-License-Identifier: Apache-2.0 */
/* Long runs and faults of a compiled compensator of any law; docs/reliability.md states the number
 * of runs. Signals are 16-bit codes; limits are those of the block. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "magnet_parameters.h"

#include "check.h"

enum { WORDS = MAGNET_PARAMETERS_WORDS, LAST = 32767, SETTLE = 2000, HELD = 300 };
enum { STEP = 16 };                /* rounding of the converter, codes; tolerance of currents */
enum { MOVED_AT_REST = 4 * STEP }; /* tolerance, codes of the current */

static const int16_t *const words = magnet_parameters;
static int16_t faulty[WORDS];
static uint64_t seed;

static uint32_t drawn(uint32_t below)
{
  seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
  return (uint32_t)(seed >> 33) % below;
}

static anhyst_compensator fresh(void)
{
  anhyst_compensator c;
  CHECK(anhyst_compensator_init(&c, &MAGNET_KERNEL, words, WORDS) == ANHYST_OK);
  return c;
}

static int16_t between(int16_t low, int16_t high, double part)
{
  return (int16_t)lround(low + part * (high - low));
}

static int16_t demand_at(double part)
{
  return between(words[ANHYST_WORD_DEMAND_LOW], words[ANHYST_WORD_DEMAND_HIGH], part);
}

static int is_within(const int16_t *block, int16_t current)
{
  return current >= block[ANHYST_WORD_CURRENT_LOW] && current <= block[ANHYST_WORD_CURRENT_HIGH];
}

/* Runs one tick with a 12-bit converter; returns the current. */
static int16_t tick(anhyst_compensator *c, int16_t demand, int16_t gap)
{
  const int16_t current = anhyst_compensator_solve_q15(c, demand, gap);
  const int32_t coarse = (current + (current < LAST - 8 ? 8 : 0)) & ~15;
  anhyst_compensator_commit_q15(c, (int16_t)coarse, gap);
  return current;
}

/* Applies small steps and jumps of demand and gap, and commits the solved or other currents. */
static int16_t anything(anhyst_compensator *c)
{
  static int16_t demand;
  static int16_t gap;
  const uint32_t kind = drawn(8);
  if (kind == 0U) {
    demand = (int16_t)(drawn(65536) - 32768U);
    gap = (int16_t)drawn(32768);
  } else {
    demand = (int16_t)(demand + (int16_t)drawn(1001) - 500);
  }
  const int16_t current = anhyst_compensator_solve_q15(c, demand, gap);
  const int16_t other = (int16_t)(drawn(65536) - 32768U);
  anhyst_compensator_commit_q15(c, kind == 1U ? other : (int16_t)(current & ~15), gap);
  return current;
}

/* Demands the highest, the lowest and a middle force; then the state no longer depends on the
 * history. */
static void wipe(anhyst_compensator *c)
{
  const int32_t length = anhyst_conditioning_length(c);
  for (int32_t i = 0; i <= length; i++) {
    anhyst_compensator_commit_q15(c, anhyst_conditioning_q15(c, i), 0);
  }
  const double way[] = {1.0, 0.0, 0.6, 0.3};
  for (size_t leg = 0; leg < HELD * sizeof way / sizeof *way; leg++) {
    (void)tick(c, demand_at(way[leg / HELD]), 0);
  }
}

/* Holds a demand after a rise or a descent: first without noise until eddy currents have decayed,
 * then with noise of demand and gap of up to four codes.
 *
 * Returns the largest change of the current, at the middle of the noise, from its value before it.
 */
static double codes_moved_at_rest(double from, long ticks)
{
  anhyst_compensator c = fresh();
  const int16_t demand = demand_at(0.4);
  double worst = 0.0;
  wipe(&c);
  for (int i = 0; i < HELD; i++) {
    (void)tick(&c, demand_at(from), 16004);
  }
  for (int i = 0; i <= HELD; i++) {
    (void)tick(&c, demand_at(from + (0.4 - from) * i / HELD), 16004);
  }
  for (int i = 0; i < SETTLE; i++) { /* eddy currents decay */
    (void)tick(&c, demand, 16004);
  }
  anhyst_compensator here = c;
  const int16_t first = anhyst_compensator_solve_q15(&here, demand, 16004);
  for (long i = 0; i < ticks; i++) {
    const int16_t noisy = (int16_t)(demand + (int16_t)drawn(9) - 4);
    (void)tick(&c, noisy, (int16_t)(16000U + drawn(9)));
    here = c;
    keep_largest(&worst, abs(anhyst_compensator_solve_q15(&here, demand, 16004) - first));
  }
  return worst;
}

/* Noise must not move the iron to its anhysteretic curve: every law has a dead band. */
static void noise_at_rest_moves_little(long ticks)
{
  const double rise = codes_moved_at_rest(0.0, ticks / 2);
  const double descent = codes_moved_at_rest(1.0, ticks / 2);
  CHECK_BELOW("codes of the current that noise moves after a rise", rise, MOVED_AT_REST);
  CHECK_BELOW("codes of the current that noise moves after a descent", descent, MOVED_AT_REST);
}

/* After any number of ticks a start-up gives the state of a new compensator, and an inner loop
 * closes. */
static void a_long_past_is_wiped_out(long ticks)
{
  anhyst_compensator old = fresh();
  anhyst_compensator new = fresh();
  for (long i = 0; i < ticks; i++) {
    CHECK(is_within(words, anything(&old)));
  }
  wipe(&old);
  wipe(&new);
  double worst = 0.0;
  double open = 0.0;
  for (int i = 0; i < 400; i++) {
    const int16_t demand = demand_at(0.5 + 0.15 * sin(i * 0.157079632679));
    const int16_t current = tick(&old, demand, 0);
    keep_largest(&worst, abs(current - tick(&new, demand, 0)));
    if (i % 40 == 0) {
      static int16_t before;
      keep_largest(&open, i >= 80 ? abs(current - before) : 0);
      before = current;
    }
  }
  CHECK_BELOW("codes of the current that the past moves", worst, STEP);
  CHECK_BELOW("codes by which an inner loop stays open", open, STEP);
}

/* Inverts each bit of the state and of the solved values, one at a time, except the address of the
 * block. */
static void any_bit_of_the_state_may_turn(void)
{
  const size_t first = offsetof(anhyst_compensator, memory);
  anhyst_compensator right = fresh();
  wipe(&right);
  double worst = 0.0;
  long tried = 0;
  for (size_t bit = 8 * first; bit < 8 * sizeof right; bit++, tried++) {
    anhyst_compensator c = fresh();
    for (int i = 0; i < 20; i++) {
      (void)anything(&c);
    }
    ((unsigned char *)&c)[bit / 8] ^= (unsigned char)(1U << bit % 8U);
    for (int i = 0; i < 100; i++) {
      CHECK(is_within(words, anything(&c)));
    }
    anhyst_compensator_demagnetise(&c);
    wipe(&c);
    anhyst_compensator there = right;
    keep_largest(&worst, abs(tick(&c, demand_at(0.5), 0) - tick(&there, demand_at(0.5), 0)));
  }
  CHECK_BELOW("bits of the state that were tried", -tried, -600);
  CHECK_BELOW("codes of the current after a start-up", worst, STEP);
}

static void set_checksum(int16_t *block)
{
  uint32_t sum = 0xFFFFFFFFUL;
  for (int i = 0; i < WORDS; i++) {
    if (i != ANHYST_WORD_CRC && i != ANHYST_WORD_CRC + 1) {
      sum ^= (uint16_t)block[i];
      for (int bit = 0; bit < 16; bit++) {
        sum = (sum & 1U) != 0U ? (sum >> 1) ^ 0xEDB88320UL : sum >> 1;
      }
    }
  }
  sum ^= 0xFFFFFFFFUL;
  block[ANHYST_WORD_CRC] = (int16_t)(uint16_t)sum;
  block[ANHYST_WORD_CRC + 1] = (int16_t)(uint16_t)(sum >> 16);
}

/* Checks blocks with one changed bit: they are refused. With a corrected checksum they are refused
 * or give currents within their limits, from the start and after a swap in any state, and back. */
static void any_bit_of_the_block_may_turn(void)
{
  long refused = 0;
  long sealed = 0;
  long outside = 0;
  for (int bit = 0; bit < 16 * WORDS; bit++) {
    memcpy(faulty, words, sizeof faulty);
    faulty[bit / 16] = (int16_t)(faulty[bit / 16] ^ (1 << bit % 16));
    refused += anhyst_block_check(&MAGNET_KERNEL, faulty, WORDS) != ANHYST_OK;
    set_checksum(faulty);
    anhyst_compensator c;
    if (anhyst_compensator_init(&c, &MAGNET_KERNEL, faulty, WORDS) != ANHYST_OK) {
      sealed++;
      continue;
    }
    for (int i = 0; i < 60; i++) {
      const int16_t *block = i / 20 % 2 == 0 ? faulty : words;
      if (i > 0 && i % 20 == 0) {
        anhyst_compensator_swap(&c, block);
      }
      outside += !is_within(block, anything(&c));
    }
  }
  CHECK(refused == 16L * WORDS);
  CHECK(outside == 0);
  CHECK_BELOW("of bits of the block, refused with a right checksum", -sealed, -500);
}

int main(int argc, char **argv)
{
  const long ticks = argc > 1 ? atol(argv[1]) : 10000000L;
  seed = argc > 2 ? (uint64_t)atol(argv[2]) : 20U;
  noise_at_rest_moves_little(ticks);
  a_long_past_is_wiped_out(ticks / 10);
  any_bit_of_the_state_may_turn();
  any_bit_of_the_block_may_turn();
  return verdict();
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the compensator and the check of a block, for one number format. The including file
   defines before: entry, signal, FORMAT(name), word_of(value, one), HALF_WIDTH.

   The law is linear and records how it is called. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "check.h"

#define WORDS 80 /* words of the block: a head and five tables of two entries */

typedef FORMAT(anhyst_compensator) compensator_type;
typedef FORMAT(anhyst_kernel) law_type;

/* ---- law for which the field equals the flux ---- */

static int field_calls;
static int flux_calls;
static int worst_stage; /* the highest stage in a call of `field` */

static number linear_field(compensator_type *c)
{
  field_calls++;
  worst_stage = c->stage == ANHYST_STAGE_AHEAD ? ANHYST_STAGE_AHEAD : worst_stage;
  c->next.memory.full.x = c->flux;
  return c->flux;
}

/* The coefficients are 1/4 for the flux and 1/4 for the field. */
static number linear_flux(compensator_type *c, number current)
{
  flux_calls++;
  c->next.memory.full.x = 2 * current;
  return 2 * current;
}

static int linear_is_valid(const entry *words)
{
  (void)words;
  return 1;
}

static void linear_transfer(compensator_type *c, const entry *words, number flux)
{
  (void)words;
  c->memory.full.x = flux;
}

static const law_type straight = {.kind = ANHYST_KIND_FULL,
                                  .field = linear_field,
                                  .flux = linear_flux,
                                  .valid = linear_is_valid,
                                  .carry = linear_transfer};

/* ---- its block ---- */

/* CRC-32 of bytes by polynomial division, as in textbooks. */
static uint32_t compute_crc(const entry *words)
{
  uint32_t crc = 0xFFFFFFFFU;
  for (size_t i = 0; i < WORDS; i++) {
    uint64_t bits = 0;
    if (i == ANHYST_WORD_CRC || i == ANHYST_WORD_CRC + 1) {
      continue;
    }
    memcpy(&bits, &words[i], sizeof(entry)); /* this machine is little-endian */
    for (size_t bit = 0; bit < 8 * sizeof(entry); bit++) {
      const uint32_t top = (crc ^ (uint32_t)(bits >> bit)) & 1U;
      crc = (crc >> 1) ^ (top != 0U ? 0xEDB88320U : 0U);
    }
  }
  return ~crc;
}

static void set_checksum(entry *words)
{
  const uint32_t crc = compute_crc(words);
  words[ANHYST_WORD_CRC] = integer_word(crc & 0xFFFFU);
  words[ANHYST_WORD_CRC + 1] = integer_word(crc >> 16);
}

static void table(entry *words, int word, int at, double low, double high, double one)
{
  words[word] = integer_word((uint32_t)at);
  words[at] = word_of(low, one);
  words[at + 1] = word_of(high, one);
}

/* Demand, current and flux are at most 0.9; the flux is twice the current. */
static void make_block(entry *words)
{
  memset(words, 0, WORDS * sizeof *words);
  words[ANHYST_WORD_MAGIC] = integer_word(ANHYST_BLOCK_MAGIC_LOW);
  words[ANHYST_WORD_MAGIC + 1] = integer_word(ANHYST_BLOCK_MAGIC_HIGH);
  words[ANHYST_WORD_LAYOUT] = ANHYST_BLOCK_LAYOUT;
  words[ANHYST_WORD_KIND] = ANHYST_KIND_FULL;
  words[ANHYST_WORD_LENGTH] = WORDS;
  words[ANHYST_WORD_POWER] = 1;
  words[ANHYST_WORD_DEMAND_LOW] = word_of(-0.9, 32768.0);
  words[ANHYST_WORD_DEMAND_HIGH] = word_of(0.9, 32768.0);
  words[ANHYST_WORD_CURRENT_LOW] = word_of(-0.125, 32768.0);
  words[ANHYST_WORD_CURRENT_HIGH] = word_of(0.125, 32768.0);
  words[ANHYST_WORD_FLUX_LIMIT] = word_of(1.0, 16384.0);
  words[ANHYST_WORD_ROOT_KNEE] = 5;
  words[ANHYST_WORD_CONDITION_CYCLES] = 2;
  words[ANHYST_WORD_CONDITION_TICKS] = 5;
  table(words, ANHYST_WORD_GAP_GAIN, 64, 0.49, 0.4, 65536.0);
  table(words, ANHYST_WORD_GAP_OFFSET, 66, 0.0, 0.0, 32768.0);
  table(words, ANHYST_WORD_GAP_BIAS, 68, 0.0, 0.0, 65536.0);
  table(words, ANHYST_WORD_GAP_FLUX_ARM, 70, 0.25, 0.25, 65536.0);
  table(words, ANHYST_WORD_GAP_FIELD_ARM, 72, 0.25, 0.25, 65536.0);
  make_scales(words);
  set_checksum(words);
}

static void flip_bit(entry *word, unsigned bit)
{
  uint64_t bits = 0;
  memcpy(&bits, word, sizeof *word);
  bits ^= (uint64_t)1 << bit;
  memcpy(word, &bits, sizeof *word);
}

/* ---- claims ---- */

static void block_with_a_flipped_bit_is_refused(void)
{
  entry words[WORDS]; /* a sanitizer detects a read beyond the end */
  compensator_type c;
  int accepted = 0;
  make_block(words);
  CHECK(FORMAT(anhyst_block_check)(&straight, words, WORDS) == ANHYST_OK);
  CHECK(FORMAT(anhyst_block_check)(&straight, words, WORDS - 1) == ANHYST_BAD_PARAMETER);
  CHECK(FORMAT(anhyst_block_check)(&straight, words, 0) == ANHYST_BAD_PARAMETER);
  for (unsigned i = 0; i < WORDS; i++) {
    for (unsigned bit = 0; bit < 8 * sizeof(entry); bit++) {
      flip_bit(&words[i], bit);
      accepted += FORMAT(anhyst_block_check)(&straight, words, WORDS) == ANHYST_OK;
      flip_bit(&words[i], bit);
    }
  }
  CHECK_BELOW("damaged blocks accepted", accepted, 0);
  CHECK(FORMAT(anhyst_compensator_init_sized)(&c, sizeof c + 4U, &straight, words, WORDS) ==
        ANHYST_BAD_SIZE);
  CHECK(FORMAT(anhyst_compensator_init)(&c, &straight, words, WORDS) == ANHYST_OK);
}

static entry block[WORDS];

static compensator_type start_compensator(void)
{
  compensator_type c;
  make_block(block);
  CHECK(FORMAT(anhyst_compensator_init)(&c, &straight, block, WORDS) == ANHYST_OK);
  return c;
}

/* Counts the calls of the law in a solve and in the commit of its current. */
static void commit_of_solved_current_needs_no_search(void)
{
  compensator_type c = start_compensator();
  for (int limited = 0; limited <= 1; limited++) {
    const signal demand = limited ? FULL_DEMAND : FULL_DEMAND / 8;
    field_calls = flux_calls = 0;
    const signal current = SOLVE(&c, demand, GAP);
    CHECK(field_calls == 1 && flux_calls == 0);
    CHECK(((c.flags & ANHYST_CURRENT_LIMITED) != 0U) == limited);
    CHECK(c.stage == ANHYST_STAGE_AHEAD);
    COMMIT(&c, current, GAP);
    CHECK(field_calls == 1 && flux_calls == limited);
    CHECK(c.stage == ANHYST_STAGE_HERE && c.memory.full.x == c.flux_applied);
  }
  (void)SOLVE(&c, FULL_DEMAND / 8, GAP);
  flux_calls = 0;
  COMMIT(&c, FULL_CURRENT / 100, GAP); /* another current */
  CHECK(flux_calls == 1);
  const signal current = SOLVE(&c, FULL_DEMAND / 8, GAP);
  COMMIT(&c, current, GAP + GAP / 2); /* another gap */
  CHECK(flux_calls == 2);
}

/* Calls the functions in any order, and compares the results with the table of stage.h. */
static void stages_follow_the_table(void)
{
  compensator_type c = start_compensator();
  int stage = ANHYST_STAGE_UNKNOWN;
  uint32_t random = 1;
  int wrong = 0;
  worst_stage = 0;
  for (int i = 0; i < 20000; i++) {
    random = random * 1664525U + 1013904223U;
    const signal part = (signal)((double)(FULL_DEMAND) * ((double)(random >> 8) / 8388608.0 - 1.0));
    switch (random >> 29) {
    case 0:
    case 1:
    case 2:
      (void)SOLVE(&c, part, GAP);
      stage = ANHYST_STAGE_AHEAD;
      break;
    case 3:
    case 4:
      COMMIT(&c, CONDITIONING(&c, (int32_t)(random >> 20) % 25), GAP);
      stage = ANHYST_STAGE_HERE;
      break;
    case 5:
      COMMIT(&c, SOLVE(&c, part, GAP), GAP);
      stage = ANHYST_STAGE_HERE;
      break;
    case 6:
      FORMAT(anhyst_compensator_swap)(&c, block);
      stage = ANHYST_STAGE_UNKNOWN;
      break;
    default:
      FORMAT(anhyst_compensator_demagnetise)(&c);
      stage = ANHYST_STAGE_UNKNOWN;
      break;
    }
    wrong += c.stage != stage || (c.flags & ANHYST_FLAG_BUSY) != 0U;
  }
  CHECK_BELOW("wrong stages", wrong, 0);
  CHECK(worst_stage == 0); /* a search of a field does not start at an uncommitted step */
}

static uint16_t flags_of_solve(compensator_type *c, signal demand, signal gap)
{
  (void)SOLVE(c, demand, gap);
  return (uint16_t)(c->flags & ~ANHYST_UNCOMMITTED);
}

static uint16_t flags_of_commit(compensator_type *c, signal applied, signal gap)
{
  (void)SOLVE(c, FULL_DEMAND / 8, GAP);
  COMMIT(c, applied, gap);
  return (uint16_t)(c->flags & ~ANHYST_UNCOMMITTED);
}

static void signals_out_of_range_raise_flags(void)
{
  compensator_type c = start_compensator();
  CHECK(flags_of_solve(&c, FULL_DEMAND / 8, GAP) == 0U);
  CHECK(flags_of_solve(&c, FULL_DEMAND / 8, GAP_LOW) == 0U);
  CHECK(flags_of_solve(&c, FULL_DEMAND / 8, GAP_HIGH) == 0U);
  CHECK(flags_of_solve(&c, FULL_DEMAND / 8, GAP_BELOW) == ANHYST_GAP_LIMITED);
  CHECK((flags_of_solve(&c, FULL_DEMAND, GAP) & ANHYST_DEMAND_LIMITED) != 0U);
  CHECK(flags_of_commit(&c, FULL_CURRENT / 9, GAP) == 0U);
  CHECK(flags_of_commit(&c, CURRENT_LIMIT, GAP) == 0U); /* exactly at the limit */
  CHECK(flags_of_commit(&c, FULL_CURRENT / 7, GAP) == ANHYST_CURRENT_LIMITED);
  CHECK(flags_of_commit(&c, -(FULL_CURRENT / 7), GAP) == ANHYST_CURRENT_LIMITED);
  CHECK(flags_of_commit(&c, FULL_CURRENT / 9, GAP_BELOW) == ANHYST_GAP_LIMITED);
  COMMIT(&c, FULL_CURRENT / 9, GAP); /* without a solve, only the flags of the commit */
  CHECK(c.flags == 0U);
  format_claims(&c);
}

static void conditioning_keeps_the_limits(void)
{
  compensator_type c = start_compensator();
  const int32_t length = FORMAT(anhyst_conditioning_length)(&c);
  int wrong = 0;
  CHECK(length == 20);
  for (int32_t tick = 0; tick < length; tick++) {
    const signal current = CONDITIONING(&c, tick);
    wrong += current > CURRENT_LIMIT || current < -(CURRENT_LIMIT);
  }
  CHECK_BELOW("ticks beyond the limits", wrong, 0);
  CHECK(CONDITIONING(&c, 5) == CURRENT_LIMIT);
  CHECK(!(CONDITIONING(&c, -1) > 0) && !(CONDITIONING(&c, length) > 0));
}

/* The expected output after a commit is the demand. */
static void output_is_the_demand(void)
{
  compensator_type c = start_compensator();
  double worst = 0.0;
  for (int i = -20; i <= 20; i++) {
    const signal demand = (signal)((double)(FULL_DEMAND) * 0.02 * i);
    const signal current = SOLVE(&c, demand, GAP);
    if ((c.flags & ~ANHYST_UNCOMMITTED) == 0U) {
      COMMIT(&c, current, GAP);
      keep_largest(&worst, fabs((double)(OUTPUT(&c) - demand)) / (double)(FULL_DEMAND));
      FORMAT(anhyst_compensator_swap)(&c, block);
      keep_largest(&worst, fabs((double)(OUTPUT(&c) - demand)) / (double)(FULL_DEMAND));
    }
  }
  CHECK_BELOW("output minus demand, of full scale", worst, 1e-4);
}

/* Each solve without a commit sets the flag in the next solve, and in no other. */
static void missing_commit_is_flagged(void)
{
  compensator_type c = start_compensator();
  for (int i = 0; i < 20; i++) {
    const int is_forgotten = i % 3 == 0;
    const signal current = SOLVE(&c, FULL_DEMAND / 8, GAP);
    CHECK(((c.flags & ANHYST_UNCOMMITTED) != 0U) == (i > 0 && (i - 1) % 3 == 0));
    if (!is_forgotten) {
      COMMIT(&c, current, GAP);
    }
  }
}

/* The tick-by-tick start-up gives the same currents, and reports its end. */
static void conditioning_per_tick_gives_the_sequence(void)
{
  compensator_type c = start_compensator();
  for (int round = 0; round < 2; round++) {
    for (int32_t tick = 0; tick < 20; tick++) {
      const signal current = SIGNALS(anhyst_conditioning_step)(&c);
      CHECK(!(current < CONDITIONING(&c, tick)) && !(current > CONDITIONING(&c, tick)));
      COMMIT(&c, current, GAP);
      CHECK((c.flags & ANHYST_CONDITIONING) != 0U);
    }
    CHECK(!(SIGNALS(anhyst_conditioning_step)(&c) > 0));
    CHECK((c.flags & ANHYST_CONDITIONING) == 0U);
    FORMAT(anhyst_compensator_demagnetise)(&c);
  }
}

static void current_mismatch_is_detected(void)
{
  compensator_type c = start_compensator();
  COMMIT(&c, FULL_CURRENT / 10, GAP);
  CHECK(SIGNALS(anhyst_compensator_follows)(&c, FULL_CURRENT / 10, FULL_CURRENT / 100));
  CHECK(SIGNALS(anhyst_compensator_follows)(&c, FULL_CURRENT / 11, FULL_CURRENT / 100));
  CHECK(!SIGNALS(anhyst_compensator_follows)(&c, 0, FULL_CURRENT / 100));
  CHECK(!SIGNALS(anhyst_compensator_follows)(&c, -(FULL_CURRENT / 10), FULL_CURRENT / 100));
}

/* Iron without layers or a lag needs one commit after missed ticks. With a lag, each missed tick
   needs one, up to 64 commits. */
static void missed_ticks_are_committed_with_a_lag(void)
{
  compensator_type c = start_compensator();
  flux_calls = 0;
  SIGNALS(anhyst_compensator_commit_after)(&c, FULL_CURRENT / 20, GAP, 7);
  CHECK(flux_calls == 1);
  table(block, ANHYST_WORD_GAP_LAG_ARM, 74, 0.1, 0.1, 65536.0);
  set_checksum(block);
  CHECK(FORMAT(anhyst_compensator_init)(&c, &straight, block, WORDS) == ANHYST_OK);
  flux_calls = 0;
  SIGNALS(anhyst_compensator_commit_after)(&c, FULL_CURRENT / 20, GAP, 7);
  CHECK(flux_calls == 7);
  flux_calls = 0;
  SIGNALS(anhyst_compensator_commit_after)(&c, FULL_CURRENT / 20, GAP, 65535U);
  CHECK(flux_calls == 64);
  flux_calls = 0;
  SIGNALS(anhyst_compensator_commit_after)(&c, FULL_CURRENT / 20, GAP, 0);
  CHECK(flux_calls == 1);
}

/* A lag requires more current while the flux rises, and no more current at rest. */
static void lag_needs_current_while_the_flux_changes(void)
{
  compensator_type c = start_compensator();
  const double still = (double)SOLVE(&c, FULL_DEMAND / 16, GAP) / (double)(FULL_CURRENT);
  table(block, ANHYST_WORD_GAP_LAG_ARM, 74, 0.1, 0.1, 65536.0);
  set_checksum(block);
  CHECK(FORMAT(anhyst_compensator_init)(&c, &straight, block, WORDS) == ANHYST_OK);
  for (int i = 0; i < 4; i++) {
    const signal current = SOLVE(&c, FULL_DEMAND / 16, GAP);
    const double more = (double)current / (double)(FULL_CURRENT)-still;
    COMMIT(&c, current, GAP);
    if (i == 0) { /* 0.1 in addition to 0.25 for the flux and 0.25 for the field */
      CHECK_BELOW("current of a lag", fabs(more / still - 0.2), 1e-3);
    } else {
      CHECK_BELOW("current of a lag at rest", fabs(more), 1e-6);
    }
  }
}

/* Restoring a saved state restores output, flux and hysteresis state. Any damage and any other
   block are rejected. */
static void saved_memory_is_restored(void)
{
  static FORMAT(anhyst_saved_memory) saved;
  compensator_type c = start_compensator();
  COMMIT(&c, FULL_CURRENT / 10, GAP);
  const signal output = OUTPUT(&c);
  FORMAT(anhyst_compensator_save)(&c, &saved);
  compensator_type other = start_compensator();
  CHECK(FORMAT(anhyst_compensator_restore)(&other, &saved) == ANHYST_OK);
  CHECK(!(OUTPUT(&other) < output) && !(OUTPUT(&other) > output));
  CHECK(memcmp(&other.memory, &c.memory, sizeof c.memory) == 0);
  CHECK(other.stage == ANHYST_STAGE_UNKNOWN && other.flags == 0U);
  int accepted = 0;
  for (size_t i = 0; i < sizeof saved.word / sizeof saved.word[0]; i++) {
    for (unsigned bit = 0; bit < 16U; bit++) {
      saved.word[i] ^= (uint16_t)(1U << bit);
      accepted += FORMAT(anhyst_compensator_restore)(&other, &saved) == ANHYST_OK;
      saved.word[i] ^= (uint16_t)(1U << bit);
    }
  }
  CHECK_BELOW("damaged memories accepted", accepted, 0);
  block[ANHYST_WORD_MODEL] = 1;
  set_checksum(block);
  CHECK(FORMAT(anhyst_compensator_init)(&other, &straight, block, WORDS) == ANHYST_OK);
  CHECK(FORMAT(anhyst_compensator_restore)(&other, &saved) == ANHYST_BAD_PARAMETER);
}

int main(void)
{
  block_with_a_flipped_bit_is_refused();
  commit_of_solved_current_needs_no_search();
  stages_follow_the_table();
  signals_out_of_range_raise_flags();
  conditioning_keeps_the_limits();
  output_is_the_demand();
  missing_commit_is_flagged();
  conditioning_per_tick_gives_the_sequence();
  current_mismatch_is_detected();
  missed_ticks_are_committed_with_a_lag();
  lag_needs_current_while_the_flux_changes();
  saved_memory_is_restored();
  return verdict();
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "block.h"

#include "checksum.h"
#include "lookup.h"

static uint32_t checksum(const int16_t *words, uint16_t length)
{
  uint32_t sum = ANHYST_CHECKSUM_START;
  for (uint16_t i = 0; i < length; i++) {
    if (i != ANHYST_WORD_CRC && i != ANHYST_WORD_CRC + 1) {
      sum = anhyst_checksum_add(sum, (uint16_t)words[i]);
    }
  }
  return sum ^ 0xFFFFFFFFUL;
}

int anhyst_table_inside(const int16_t *words, int16_t first, int16_t entries)
{
  return first >= ANHYST_BLOCK_LEAST_WORDS && entries > 0 &&
         (int32_t)first + entries <= words[ANHYST_WORD_LENGTH];
}

int anhyst_table_rises(const int16_t *words, int16_t first, int16_t entries, int16_t least,
                       int16_t steepest)
{
  if (!anhyst_table_inside(words, first, entries) || words[first] < least) {
    return 0;
  }
  for (int16_t i = 1; i < entries; i++) {
    const int32_t rise = (int32_t)words[first + i] - words[first + i - 1];
    if (rise < 0 || rise > steepest) {
      return 0;
    }
  }
  return 1;
}

int anhyst_over_gap_is_valid(const int16_t *words, int16_t word, int16_t least)
{
  const int16_t first = words[word];
  const int16_t entries = (int16_t)((1 << words[ANHYST_WORD_GAP_SEGMENTS]) + 1);
  if (!anhyst_table_inside(words, first, entries)) {
    return 0;
  }
  for (int16_t i = 0; i < entries; i++) {
    const int32_t change = i == 0 ? 0 : (int32_t)words[first + i] - words[first + i - 1];
    if (words[first + i] < least || change > ANHYST_Q15_MAX || change < -ANHYST_Q15_MAX) {
      return 0;
    }
  }
  return 1;
}

/* The 32 bits of a number of two words. */
static uint32_t double_word(const int16_t *words, int16_t word)
{
  return (uint32_t)(uint16_t)words[word] | ((uint32_t)(uint16_t)words[word + 1] << 16);
}

/* Singles above 0 stand in the order of their bits: exponent, then fraction. */
#define SINGLE_LEAST ((uint32_t)(127 - 60) << 23) /* 2^-60 */
#define SINGLE_MOST ((uint32_t)(127 + 60) << 23)  /* 2^60 */
#define SINGLE_ONE ((uint32_t)1 << 23)            /* the lowest digit of the exponent */

int anhyst_single_is_valid(const int16_t *words, int16_t word)
{
  const uint32_t bits = double_word(words, word);
  return bits >= SINGLE_LEAST && bits <= SINGLE_MOST;
}

/* The digits of a single, 2^23..2^24 - 1. */
static int32_t digits_of(uint32_t single)
{
  return (int32_t)((single & (SINGLE_ONE - 1U)) | SINGLE_ONE);
}

int32_t anhyst_in_unit(int32_t a, const int16_t *before, const int16_t *words, int16_t word)
{
  const uint32_t of = double_word(before, word);
  const uint32_t to = double_word(words, word);
  const int32_t numerator = digits_of(of);
  const int32_t denominator = digits_of(to);
  int16_t shift = (int16_t)((int16_t)(of >> 23) - (int16_t)(to >> 23));
  int32_t part;
  if (of == to) {
    return a;
  }
  if (numerator < denominator) {
    part = anhyst_share(a, anhyst_ratio(numerator, denominator));
  } else {
    part = anhyst_share(a, anhyst_ratio(numerator, 2 * denominator));
    shift = (int16_t)(shift + 1);
  }
  if (shift >= 0) {
    return anhyst_shl_q31(part, (uint16_t)(shift < 31 ? shift : 31));
  }
  return part >> (shift > -31 ? -shift : 31);
}

uint16_t anhyst_block_misfit(const int16_t *words, const int16_t *scales)
{
  for (uint16_t i = 0; i < ANHYST_SCALE_WORDS; i++) {
    if (words[ANHYST_WORD_SCALE_DEMAND + i] != scales[i]) {
      return (uint16_t)(ANHYST_WORD_SCALE_DEMAND + (i & ~1U));
    }
  }
  return 0;
}

static int head_is_valid(const int16_t *words, uint16_t capacity)
{
  return (uint16_t)words[ANHYST_WORD_MAGIC] == ANHYST_BLOCK_MAGIC_LOW &&
         (uint16_t)words[ANHYST_WORD_MAGIC + 1] == ANHYST_BLOCK_MAGIC_HIGH &&
         words[ANHYST_WORD_LAYOUT] == ANHYST_BLOCK_LAYOUT &&
         anhyst_within(words[ANHYST_WORD_LENGTH], ANHYST_BLOCK_LEAST_WORDS,
                       ANHYST_BLOCK_MOST_WORDS) &&
         (uint16_t)words[ANHYST_WORD_LENGTH] <= capacity;
}

static int common_is_valid(const int16_t *words)
{
  return anhyst_within(words[ANHYST_WORD_POWER], 1, 2) &&
         words[ANHYST_WORD_DEMAND_LOW] <= words[ANHYST_WORD_DEMAND_HIGH] &&
         words[ANHYST_WORD_CURRENT_LOW] <= words[ANHYST_WORD_CURRENT_HIGH] &&
         anhyst_within(words[ANHYST_WORD_CURRENT_SHIFT], 0, 8) &&
         anhyst_within(words[ANHYST_WORD_FLUX_LIMIT], 1, 16384) &&
         anhyst_within(words[ANHYST_WORD_FLUX_SHIFT], 0, 6) &&
         anhyst_within(words[ANHYST_WORD_GAP_SEGMENTS], 0, 6) &&
         anhyst_within(words[ANHYST_WORD_CONDITION_CYCLES], 0, 64) &&
         words[ANHYST_WORD_CONDITION_TICKS] >= 2 &&
         anhyst_within(words[ANHYST_WORD_ROOT_KNEE], 2, 8) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_GAIN, 1) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_OFFSET, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_BIAS, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_FLUX_ARM, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_FIELD_ARM, 1);
}

anhyst_status anhyst_block_check(const anhyst_kernel *kernel, const int16_t *words,
                                 uint16_t capacity)
{
  if (capacity < ANHYST_BLOCK_LEAST_WORDS || !head_is_valid(words, capacity) ||
      (uint16_t)words[ANHYST_WORD_KIND] != kernel->kind) {
    return ANHYST_BAD_PARAMETER;
  }
  if (checksum(words, (uint16_t)words[ANHYST_WORD_LENGTH]) != double_word(words, ANHYST_WORD_CRC) ||
      !common_is_valid(words) || !kernel->valid(words)) {
    return ANHYST_BAD_PARAMETER;
  }
  return ANHYST_OK;
}

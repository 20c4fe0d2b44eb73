/* SPDX-License-Identifier: Apache-2.0 */
#include "block.h"

/* CRC-32 (IEEE 802.3, reflected) of one word, low byte first, without a table. */
static uint32_t checksum_word(uint32_t sum, uint16_t word)
{
  sum ^= word;
  for (uint16_t bit = 0; bit < 16U; bit++) {
    sum = (sum & 1U) != 0U ? (sum >> 1) ^ 0xEDB88320UL : sum >> 1;
  }
  return sum;
}

static uint32_t checksum(const int16_t *words, uint16_t length)
{
  uint32_t sum = 0xFFFFFFFFUL;
  for (uint16_t i = 0; i < length; i++) {
    if (i != ANHYST_WORD_CRC && i != ANHYST_WORD_CRC + 1) {
      sum = checksum_word(sum, (uint16_t)words[i]);
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

int anhyst_over_gap_sound(const int16_t *words, int16_t word, int16_t least)
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

static int head_sound(const int16_t *words, uint16_t capacity)
{
  return (uint16_t)words[ANHYST_WORD_MAGIC] == ANHYST_BLOCK_MAGIC_LOW &&
         (uint16_t)words[ANHYST_WORD_MAGIC + 1] == ANHYST_BLOCK_MAGIC_HIGH &&
         words[ANHYST_WORD_LAYOUT] == ANHYST_BLOCK_LAYOUT &&
         anhyst_within(words[ANHYST_WORD_LENGTH], ANHYST_BLOCK_LEAST_WORDS,
                       ANHYST_BLOCK_MOST_WORDS) &&
         (uint16_t)words[ANHYST_WORD_LENGTH] <= capacity;
}

static int common_sound(const int16_t *words)
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
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_GAIN, 1) &&
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_OFFSET, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_BIAS, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_FLUX_ARM, -ANHYST_Q15_MAX) &&
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_FIELD_ARM, 1);
}

anhyst_status anhyst_block_check(const anhyst_kernel *kernel, const int16_t *words,
                                 uint16_t capacity)
{
  if (capacity < ANHYST_BLOCK_LEAST_WORDS || !head_sound(words, capacity) ||
      (uint16_t)words[ANHYST_WORD_KIND] != kernel->kind) {
    return ANHYST_BAD_PARAMETER;
  }
  const uint32_t stated = (uint32_t)(uint16_t)words[ANHYST_WORD_CRC] |
                          ((uint32_t)(uint16_t)words[ANHYST_WORD_CRC + 1] << 16);
  if (checksum(words, (uint16_t)words[ANHYST_WORD_LENGTH]) != stated || !common_sound(words) ||
      !kernel->sound(words)) {
    return ANHYST_BAD_PARAMETER;
  }
  return ANHYST_OK;
}

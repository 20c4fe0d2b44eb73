/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the check of a parameter block, for every number format. ../block.c, block_f32.c and
   block_f64.c include it after the types of their format. */

#include "../checksum.h"

/* Returns the CRC-32 of all words except the checksum's own, each word low byte first. */
static uint32_t compute_checksum(const entry *words, int32_t length)
{
  uint32_t sum = ANHYST_CHECKSUM_START;
  for (int32_t i = 0; i < length; i++) {
    if (i != ANHYST_WORD_CRC && i != ANHYST_WORD_CRC + 1) {
      for (uint16_t half = 0; half < HALVES_PER_WORD; half++) {
        sum = anhyst_checksum_add(sum, half_word(words[i], half));
      }
    }
  }
  return ~sum;
}

static int is_checksum_right(const entry *words)
{
  const uint32_t sum = compute_checksum(words, block_length(words));
  return equals_unsigned(words[ANHYST_WORD_CRC], (uint16_t)(sum & 0xFFFFU)) &&
         equals_unsigned(words[ANHYST_WORD_CRC + 1], (uint16_t)(sum >> 16));
}

/* Returns whether a header is valid for a kind of block. Reads at most `capacity` words. */
static int is_header_valid(const entry *words, uint32_t capacity, uint16_t kind)
{
  return capacity >= (uint32_t)ANHYST_BLOCK_LEAST_WORDS &&
         equals_unsigned(words[ANHYST_WORD_MAGIC], ANHYST_BLOCK_MAGIC_LOW) &&
         equals_unsigned(words[ANHYST_WORD_MAGIC + 1], ANHYST_BLOCK_MAGIC_HIGH) &&
         is_integer(words[ANHYST_WORD_LAYOUT], ANHYST_BLOCK_LAYOUT, ANHYST_BLOCK_LAYOUT) &&
         is_integer(words[ANHYST_WORD_LENGTH], ANHYST_BLOCK_LEAST_WORDS, MAX_BLOCK_WORDS) &&
         (uint32_t)block_length(words) <= capacity &&
         equals_unsigned(words[ANHYST_WORD_KIND], kind);
}

static int are_limits_valid(const entry *words, int16_t low, int16_t high)
{
  return is_in_range(words[low], -ENTRY_ONE, words[high]) &&
         is_in_range(words[high], words[low], ENTRY_ONE);
}

/* Returns whether the table of the eddy-current lag over the gap is valid, or does not exist. The
   sum of the lag coefficient and the flux coefficient saturates. */
static int is_lag_valid(const entry *words)
{
  if (words[ANHYST_WORD_GAP_LAG_ARM] == 0) {
    return words[ANHYST_WORD_LAG_LEAKY] == 0 && words[ANHYST_WORD_LAG_KEEP] == 0;
  }
  return is_table_over_gap(words, ANHYST_WORD_GAP_LAG_ARM, 0) &&
         is_in_range(words[ANHYST_WORD_LAG_LEAKY], 0, ENTRY_ONE) &&
         is_in_range(words[ANHYST_WORD_LAG_KEEP], 0, ENTRY_ONE);
}

static int are_common_words_valid(const entry *words)
{
  return is_integer(words[ANHYST_WORD_POWER], 1, 2) &&
         are_limits_valid(words, ANHYST_WORD_DEMAND_LOW, ANHYST_WORD_DEMAND_HIGH) &&
         are_limits_valid(words, ANHYST_WORD_CURRENT_LOW, ANHYST_WORD_CURRENT_HIGH) &&
         is_integer(words[ANHYST_WORD_CURRENT_SHIFT], 0, MAX_CURRENT_SHIFT) &&
         is_in_range(words[ANHYST_WORD_FLUX_LIMIT], MIN_WEIGHT, MAX_FLUX_LIMIT) &&
         is_integer(words[ANHYST_WORD_FLUX_SHIFT], 0, MAX_FLUX_SHIFT) &&
         is_integer(words[ANHYST_WORD_GAP_SEGMENTS], 0, 6) &&
         is_integer(words[ANHYST_WORD_CONDITION_CYCLES], 0, 64) &&
         is_integer(words[ANHYST_WORD_CONDITION_TICKS], 2, 32767) &&
         is_integer(words[ANHYST_WORD_ROOT_KNEE], 2, 8) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_GAIN, MIN_WEIGHT) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_OFFSET, -MAX_ENTRY) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_BIAS, -MAX_ENTRY) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_FLUX_ARM, -MAX_ENTRY) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_FIELD_ARM, MIN_WEIGHT) && is_lag_valid(words) &&
         are_scales_valid(words);
}

static anhyst_status check_block(const kernel_type *kernel, const entry *words, uint32_t capacity)
{
  const int is_valid = is_header_valid(words, capacity, kernel->kind) && is_checksum_right(words) &&
                       are_common_words_valid(words) && kernel->valid(words);
  return is_valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

static uint16_t find_scale_mismatch(const entry *words, const entry *scales)
{
  for (uint16_t i = 0; i < ANHYST_SCALE_WORDS; i++) {
    if (!(words[ANHYST_WORD_SCALE_DEMAND + i] == scales[i])) {
      return (uint16_t)(ANHYST_WORD_SCALE_DEMAND + (i & ~1U));
    }
  }
  return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the parameter block of a map with a play operator, for every number format. The
   operations of a format (../play_map.c or play_map_real.h) and map.h are included before. */

static int is_checksum_right(const entry *words, uint16_t length)
{
  uint32_t sum = ANHYST_CHECKSUM_START;
  for (uint16_t i = 0; i < length; i++) {
    if (i != (uint16_t)ANHYST_WORD_CRC && i != (uint16_t)(ANHYST_WORD_CRC + 1)) {
      sum = add_word_to_checksum(sum, words[i]);
    }
  }
  return is_word_equal(words[ANHYST_WORD_CRC], (uint16_t)(~sum & 0xFFFFUL)) &&
         is_word_equal(words[ANHYST_WORD_CRC + 1], (uint16_t)(~sum >> 16));
}

/* Reads an exponent. Returns largest + 1 if the word is not an integer of 0..largest. */
static uint16_t read_exponent(entry word, uint16_t largest)
{
  uint16_t exponent = 0;
  while (exponent <= largest && !is_word_equal(word, exponent)) {
    exponent++;
  }
  return exponent;
}

/* Returns the number of entries of each table. Returns 0 if header, table sizes, table positions
   and checksum are not consistent. */
static uint16_t read_entry_count(const entry *words, uint16_t capacity)
{
  if (capacity < (uint16_t)ANHYST_BLOCK_LEAST_WORDS) {
    return 0;
  }
  const uint16_t n =
      read_exponent(words[ANHYST_WORD_PLAY_FORCE_SEGMENTS], ANHYST_MAP_FORCE_SEGMENTS);
  const uint16_t m = read_exponent(words[ANHYST_WORD_PLAY_GAP_SEGMENTS], ANHYST_MAP_GAP_SEGMENTS);
  if (n > ANHYST_MAP_FORCE_SEGMENTS || m > ANHYST_MAP_GAP_SEGMENTS) {
    return 0;
  }
  const uint16_t entries = (uint16_t)((((uint32_t)1U << n) + 1U) * (((uint32_t)1U << m) + 1U));
  const uint16_t half = (uint16_t)(ANHYST_BLOCK_LEAST_WORDS + entries);
  const uint16_t length = (uint16_t)(half + entries);
  const int is_valid =
      length <= capacity && is_word_equal(words[ANHYST_WORD_MAGIC], ANHYST_BLOCK_MAGIC_LOW) &&
      is_word_equal(words[ANHYST_WORD_MAGIC + 1], ANHYST_BLOCK_MAGIC_HIGH) &&
      is_word_equal(words[ANHYST_WORD_LAYOUT], ANHYST_BLOCK_LAYOUT) &&
      is_word_equal(words[ANHYST_WORD_KIND], ANHYST_KIND_PLAY) &&
      is_word_equal(words[ANHYST_WORD_LENGTH], length) &&
      is_word_equal(words[ANHYST_WORD_PLAY_CURRENT], ANHYST_BLOCK_LEAST_WORDS) &&
      is_word_equal(words[ANHYST_WORD_PLAY_HALF], half) && is_checksum_right(words, length);
  return is_valid ? entries : 0U;
}

/* Returns whether half-widths are not negative, and both branches rise and stay in the format. */
static int are_branches_rising(const law_type *law, uint16_t entries)
{
  const size_t last_column = columns_of(&law->map);
  size_t column = 0;
  for (uint16_t i = 0; i < entries; i++) {
    const number value = law->map.entries[i];
    const number half = law->half[i];
    if (!(half >= 0 && value + half <= MAX_ENTRY && value - half >= -MAX_ENTRY)) {
      return 0;
    }
    if (column > 0U) {
      const number rise = value - law->map.entries[i - 1U];
      const number half_rise = half - law->half[i - 1U];
      if (half_rise > rise || -half_rise > rise) {
        return 0;
      }
    }
    column = column < last_column ? column + 1U : 0U;
  }
  return 1;
}

static anhyst_status init_play_map(play_type *c, const entry *words, uint16_t capacity)
{
  play_type initial = {0};
  const uint16_t entries = read_entry_count(words, capacity);
  if (entries == 0U) {
    return ANHYST_BAD_PARAMETER;
  }
  initial.law.map.entries = words + ANHYST_BLOCK_LEAST_WORDS;
  initial.law.half = initial.law.map.entries + entries;
  initial.low = word_to_current(words[ANHYST_WORD_PLAY_CURRENT_LOW]);
  initial.high = word_to_current(words[ANHYST_WORD_PLAY_CURRENT_HIGH]);
  initial.tolerated_low = subtract(initial.low, current_tolerance(words));
  initial.tolerated_high = add(initial.high, current_tolerance(words));
  if (!read_scales(&initial.law, words) || !is_map_valid(&initial.law.map) ||
      !are_branches_rising(&initial.law, entries) || !is_finite(initial.low) ||
      !is_finite(initial.high) || initial.low > initial.high) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  return ANHYST_OK;
}

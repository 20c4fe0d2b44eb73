/* SPDX-License-Identifier: Apache-2.0 */
/* Template: checks of the words of a parameter block, for every number format. A law includes
   ../formats/block_fixed.h or block_real.h with operations on a word. Checks return 0 for NaN. */

/* Returns the length of a block in words. Requires a valid header. */
static inline int32_t block_length(const entry *words)
{
  return (int32_t)words[ANHYST_WORD_LENGTH];
}

static inline int is_in_range(entry word, entry low, entry high)
{
  return word >= low && word <= high;
}

/* Returns whether a table of a given first word and length is in the block, after the header. */
static inline int is_table_in_block(const entry *words, entry first, int32_t entries)
{
  return entries > 0 && entries <= block_length(words) &&
         is_integer(first, ANHYST_BLOCK_LEAST_WORDS, block_length(words) - entries);
}

/* Returns whether a table is in the block, starts at or above `least`, ends at or below ENTRY_ONE,
   never falls, and rises by at most max_rise between adjacent entries. */
static inline int is_table_rising(const entry *words, entry first, int32_t entries, entry least,
                                  entry max_rise)
{
  if (!is_table_in_block(words, first, entries)) {
    return 0;
  }
  const entry *table = words + (int32_t)first;
  if (!is_in_range(table[0], least, ENTRY_ONE) ||
      !is_in_range(table[entries - 1], least, ENTRY_ONE)) {
    return 0;
  }
  for (int32_t i = 1; i < entries; i++) {
    if (!(table[i] >= table[i - 1] && (number)table[i] - table[i - 1] <= max_rise)) {
      return 0;
    }
  }
  return 1;
}

/* Returns whether a word is the index of a table over the gap with entries of at least `least`. */
static inline int is_table_over_gap(const entry *words, int16_t word, entry least)
{
  const int32_t entries = ((int32_t)1 << (int32_t)words[ANHYST_WORD_GAP_SEGMENTS]) + 1;
  if (!is_table_in_block(words, words[word], entries)) {
    return 0;
  }
  const entry *table = words + (int32_t)words[word];
  for (int32_t i = 0; i < entries; i++) {
    if (!(table[i] >= least && is_entry_valid(table[i], table[i > 0 ? i - 1 : 0]))) {
      return 0;
    }
  }
  return 1;
}

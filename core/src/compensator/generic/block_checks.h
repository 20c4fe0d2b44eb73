/* SPDX-License-Identifier: Apache-2.0 */
/* Template: checks of the words of a parameter block, for every format. A law includes
   ../formats/block_fixed.h or block_real.h, which define the operations on a word.
   Every check is false for a word that is not a number. */

/* Length of a block whose head is valid, words. */
static inline int32_t length_of(const entry *words) { return (int32_t)words[ANHYST_WORD_LENGTH]; }

/* Whether a word is a number of low..high. */
static inline int is_in_range(entry word, entry low, entry high)
{
  return word >= low && word <= high;
}

/* Whether a table with this number of entries lies after the head of the block and inside it. */
static inline int is_table_inside(const entry *words, entry first, int32_t entries)
{
  return entries > 0 && entries <= length_of(words) &&
         is_integer(first, ANHYST_BLOCK_LEAST_WORDS, length_of(words) - entries);
}

/* Whether a table is inside the block, begins at the least value or above, ends at ENTRY_ONE or
   below, never falls, and rises by at most `steepest` from entry to entry. */
static inline int is_table_rising(const entry *words, entry first, int32_t entries, entry least,
                                  entry steepest)
{
  if (!is_table_inside(words, first, entries)) {
    return 0;
  }
  const entry *table = words + (int32_t)first;
  if (!is_in_range(table[0], least, ENTRY_ONE) ||
      !is_in_range(table[entries - 1], least, ENTRY_ONE)) {
    return 0;
  }
  for (int32_t i = 1; i < entries; i++) {
    if (!(table[i] >= table[i - 1] && (number)table[i] - table[i - 1] <= steepest)) {
      return 0;
    }
  }
  return 1;
}

/* Whether the word names a table over the gap whose entries are all at least `least`. */
static inline int is_table_over_gap(const entry *words, int16_t word, entry least)
{
  const int32_t entries = ((int32_t)1 << (int32_t)words[ANHYST_WORD_GAP_SEGMENTS]) + 1;
  if (!is_table_inside(words, words[word], entries)) {
    return 0;
  }
  const entry *table = words + (int32_t)words[word];
  for (int32_t i = 0; i < entries; i++) {
    if (!(table[i] >= least && is_entry_after(table[i], table[i > 0 ? i - 1 : 0]))) {
      return 0;
    }
  }
  return 1;
}

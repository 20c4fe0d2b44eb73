/* SPDX-License-Identifier: Apache-2.0 */
/* Words of a floating-point block, for ../generic/block_checks.h. Include after f32.h or f64.h. */
#ifndef ANHYST_BLOCK_REAL_H
#define ANHYST_BLOCK_REAL_H

#define ENTRY_ONE ((entry)1)
#define ENTRY_LEAST ((entry)1e-30) /* the smallest weight above 0 */
#define ENTRY_MOST ((entry)1e9)
#define FLUX_LIMIT_MOST ((entry)1)
#define MAX_CURRENT_SHIFT 0
#define MAX_FLUX_SHIFT 0
#define MAX_BLOCK_WORDS ANHYST_BLOCK_MOST_REAL_WORDS
#define WORD_HALVES                                                                                \
  ((uint16_t)(sizeof(entry) / sizeof(uint16_t))) /* pieces of 16 bits in a word                    \
                                                  */

/* Bits of a word, 16 at a time from the lowest on, whatever the order of bytes in memory. */
static inline uint16_t bits_of(entry word, uint16_t half)
{
  union {
    entry word;
    bits_type bits;
  } both;
  both.word = word;
  return (uint16_t)(both.bits >> (16U * half));
}

/* Whether a word is an integer of low..high. */
static inline int is_integer(entry word, int32_t low, int32_t high)
{
  return word >= (entry)low && word <= (entry)high && word == (entry)(int32_t)word;
}

/* Whether a word is exactly this unsigned integer, bit by bit. */
static inline int is_unsigned(entry word, uint16_t value)
{
  for (uint16_t half = 0; half < WORD_HALVES; half++) {
    if (bits_of(word, half) != bits_of((entry)value, half)) {
      return 0;
    }
  }
  return 1;
}

/* Whether an entry of a table is a number that one of a block can be, given the one before. */
static inline int is_entry_after(entry word, entry before)
{
  (void)before;
  return word >= -ENTRY_MOST && word <= ENTRY_MOST;
}

/* Whether the word begins a single within 2^-60..2^60. */
static inline int is_single(const entry *words, int32_t word)
{
  return words[word] >= (entry)8.67361738e-19 && words[word] <= (entry)1.152921504606847e18 &&
         words[word + 1] == (entry)0;
}

/* Whether the scales of the signals can be computed with. The range of the gap is empty if nothing
   depends on the gap. */
static inline int are_scales(const entry *words)
{
  const entry low = words[ANHYST_WORD_SCALE_GAP_LOW];
  const entry high = words[ANHYST_WORD_SCALE_GAP_HIGH];
  return is_single(words, ANHYST_WORD_SCALE_DEMAND) &&
         is_single(words, ANHYST_WORD_SCALE_CURRENT) && low >= -ENTRY_MOST && high <= ENTRY_MOST &&
         (low == high || high - low >= (entry)8.67361738e-19);
}

/* A number of the memory, counted in the unit at this word of the block before, in the unit of
   another block. Both blocks are valid. The same unit gives the same number. */
static inline number in_unit(number a, const entry *before, const entry *words, int32_t word)
{
  return before[word] == words[word] ? a : a * (before[word] / words[word]);
}

#include "block_checks.h"
#endif

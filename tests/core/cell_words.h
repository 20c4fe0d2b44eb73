/* SPDX-License-Identifier: Apache-2.0 */
/* The words of a play-cell block with known curves, for the tests of the law. */
#ifndef TEST_CELL_WORDS_H
#define TEST_CELL_WORDS_H

#include <math.h>
#include <stdint.h>

#include "anhyst/compensator/layout.h"

/* 64 narrow segments on each side of zero up to a field of 1/2, 32 wide ones beyond. */
enum { CELLS = 3, BITS = 6, OUTER = 32, STRIDE = (2 << BITS) + 2 * OUTER + 1 };
static const double THRESHOLDS[CELLS + 1] = {0.0, 0.05, 0.11, 0.2};
static const double WEIGHTS[CELLS + 1] = {0.1, 0.3, 0.35, 0.2};
static const double WIDTH = 0.2;
static const double AIR = 0.1; /* h, the flux of a field of 1 without iron */
static int16_t words[1024];

static inline double curve(int cell, double play) { return WEIGHTS[cell] * tanh(play / WIDTH); }

/* Returns the field at an entry of a row. */
static inline double field_at_entry(int column)
{
  const int middle = STRIDE / 2;
  const double from_middle = (column - middle) / 128.0;
  const double beyond = fabs(from_middle) - 0.5;
  return beyond > 0.0 ? copysign(0.5 + 2.0 * beyond, from_middle) : from_middle;
}

/* Sets the words that the law reads. */
static inline void fill_cell_words(void)
{
  const int16_t thresholds = ANHYST_BLOCK_LEAST_WORDS;
  const int16_t rows = (int16_t)(thresholds + CELLS);
  words[ANHYST_WORD_CURRENT_LOW] = -32767;
  words[ANHYST_WORD_CURRENT_HIGH] = 32767;
  words[ANHYST_WORD_CELLS_AIR] = (int16_t)lround(AIR * 16384.0);
  words[ANHYST_WORD_CELLS_COUNT] = CELLS;
  words[ANHYST_WORD_CELLS_SEGMENTS] = BITS;
  words[ANHYST_WORD_CELLS_ZONE] = 1;
  words[ANHYST_WORD_CELLS_THRESHOLDS] = thresholds;
  words[ANHYST_WORD_CELLS_ROWS] = rows;
  for (int cell = 0; cell < CELLS; cell++) {
    words[thresholds + cell] = (int16_t)lround(THRESHOLDS[cell + 1] * 32768.0);
  }
  for (int i = 0; i < STRIDE; i++) {
    const double x = field_at_entry(i);
    double sum = 0.0;
    for (int cell = 0; cell <= CELLS; cell++) {
      sum += curve(cell, x - THRESHOLDS[cell]);
      words[rows + cell * STRIDE + i] = (int16_t)lround(sum * 32767.0);
    }
  }
}

/* Returns the value of a word of the block in floating point. */
static inline double word_as_number(int word)
{
  switch (word) {
  case ANHYST_WORD_CELLS_AIR:
  case ANHYST_WORD_SOLID_OWN:
    return words[word] / 65536.0;
  case ANHYST_WORD_SOLID_HOLD:
    return ldexp(words[word], words[ANHYST_WORD_SOLID_HOLD_SHIFT]) / 65536.0;
  case ANHYST_WORD_SOLID_HOLD_SHIFT:
    return 0.0;
  case ANHYST_WORD_SOLID_SURFACE:
  case ANHYST_WORD_SOLID_LAMINATED:
  case ANHYST_WORD_SOLID_SECOND:
  case ANHYST_WORD_SOLID_THIRD:
  case ANHYST_WORD_CURRENT_LOW:
  case ANHYST_WORD_CURRENT_HIGH:
    return words[word] / 32768.0;
  default:
    return words[word] / (word >= ANHYST_BLOCK_LEAST_WORDS ? 32768.0 : 1.0);
  }
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* A path of the law of cells: its rows, what is known at its start, and how m is made up; cells.c
   follows it. Inside, everything is q30, x and plays in the direction of the path. */
#ifndef ANHYST_CELLS_PATH_H
#define ANHYST_CELLS_PATH_H

#include "anhyst/compensator/compensator.h"
#include "block.h"
#include "lookup.h"

#define ONE ANHYST_Q30_ONE

/* A rising path. Cell 0 has no width, and moves always. */
typedef struct {
  const int16_t *thresholds; /* of the cells from 1 on */
  const int16_t *rows;
  const int32_t *plays;
  int16_t stride;  /* entries of a row */
  uint16_t bits;   /* it has 2^bits segments */
  int16_t cells;   /* besides cell 0 */
  int32_t x;       /* where it begins */
  int32_t falling; /* -1 where all is mirrored, otherwise 0 */
  int16_t moved;   /* the cells below this one moved here the other way, or have not been left */
  int16_t active;  /* the cells below this one move */
  int32_t frozen;  /* bit i: what cell i rests with was counted while it rose */
  int32_t rest;    /* magnetisation of the cells that rest */
} path;

/* In the direction of a path, falling 0 or -1: -1 - a where it falls; -a could leave the range. */
static inline int32_t turned(int32_t a, int32_t falling)
{
  return (int32_t)((uint32_t)a ^ (uint32_t)falling);
}

/* Within -1 .. 1. */
static inline int32_t inside(int32_t a) { return anhyst_clamp(a, -ONE, ONE - 1); }

/* Half-width of the play of a cell. */
static inline int32_t width(const path *along, int16_t cell)
{
  return (int32_t)along->thresholds[cell - 1] * 32768;
}

/* The magnetisation of so many moving cells where the field is x, -1 <= x < 1. */
static inline int32_t moving(const path *along, int16_t cells, int32_t x)
{
  const int32_t fine = (x + ONE) >> (16U - along->bits); /* segment and 15 bits of its part */
  const anhyst_spot spot = {along->rows + (cells - 1) * along->stride + (fine >> 15),
                            fine & 0x7FFF};
  return anhyst_value_at(spot);
}

/* The magnetisation of a cell at rest: what it gave when the field had brought it there. Any value
   of a play that at_rest gives is within the rows. */
static inline int32_t alone(const path *along, int16_t cell, int32_t play)
{
  const int32_t x = play + width(along, cell);
  return moving(along, (int16_t)(cell + 1), x) - moving(along, cell, x);
}

/* The play of a cell that rests: within reach of the field, and of what any field within the rows
   can have made of it. */
static inline int32_t at_rest(const path *along, int16_t cell)
{
  const int32_t r = width(along, cell);
  if (cell < along->moved) {
    return along->x + r < ONE - r ? along->x + r : ONE - 1 - r;
  }
  const int32_t play = turned(along->plays[cell - 1], along->falling);
  const int32_t low = along->x < 2 * (r - ONE / 2) ? r - ONE : along->x - r;
  const int32_t high = along->x + r < ONE - r ? along->x + r : ONE - 1 - r;
  return anhyst_clamp(play, low, high);
}

/* The rows of a block and the widths of its plays. */
static inline void anhyst_cells_rows(path *along, const int16_t *words)
{
  along->thresholds = words + words[ANHYST_WORD_CELLS_THRESHOLDS];
  along->rows = words + words[ANHYST_WORD_CELLS_ROWS];
  along->cells = words[ANHYST_WORD_CELLS_COUNT];
  along->bits = (uint16_t)words[ANHYST_WORD_CELLS_SEGMENTS];
  along->stride = (int16_t)((1 << along->bits) + 1);
}

/* A path that goes on from a memory, in the direction which that had; what rests is summed up where
   the memory does not say which cells move. */
void anhyst_cells_begin(path *along, const int16_t *words, const anhyst_memory *from,
                        const int32_t *plays);

/* As anhyst_kernel says of them. */
int anhyst_cells_is_valid(const int16_t *words);
void anhyst_cells_carry(const int16_t *before, const int16_t *words, int32_t flux,
                        anhyst_memory *memory, int32_t *plays);
void anhyst_cells_keep(const int16_t *words, const anhyst_memory *from, const anhyst_memory *to,
                       int32_t *plays);

#endif

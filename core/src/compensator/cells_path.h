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
  const int16_t *thresholds; /* half-widths of the cells from 1 on */
  const int16_t *rows;
  const int16_t *row; /* of the cells that move */
  const int32_t *plays;
  int32_t inner;   /* half-width of the zone around 0 where segments are narrow */
  int stride;      /* entries of a row */
  int outer;       /* wide segments on each side */
  unsigned narrow; /* a part of 2^-15 of a segment: 2^this */
  unsigned wide;
  int cells;        /* besides cell 0 */
  int active;       /* the cells below this one move */
  int moved;        /* those below this one moved the other way until here, ... */
  anhyst_spot left; /* ... which is this place of the first row */
  int32_t frozen;   /* bit i: what cell i rests with was counted while it rose */
  int32_t rest;     /* magnetisation of the cells that rest */
  int32_t falling;  /* -1 where all is mirrored, otherwise 0 */
  int32_t low;      /* field where the last of them joined, or the step began */
  int32_t x;
  const int16_t *segment; /* of the row, the one that holds x where the path ends */
} cell_path;

/* In the direction of a path, falling 0 or -1: -1 - a where it falls; -a could leave the range. */
static inline int32_t turned(int32_t a, int32_t falling)
{
  return (int32_t)((uint32_t)a ^ (uint32_t)falling);
}

/* Within -1 .. 1. */
static inline int32_t inside(int32_t a) { return anhyst_sat_q30(a); }

/* Half-width of the play of a cell. */
static inline int32_t width(const cell_path *along, int cell)
{
  return (int32_t)along->thresholds[cell - 1] * 32768;
}

/* Entries from a row to that of so many cells more; a block has no more words than fit. */
static inline int rows_on(const cell_path *along, int cells) { return cells * along->stride; }

static inline const int16_t *row_of(const cell_path *along, int cells)
{
  return along->rows + rows_on(along, cells - 1);
}

/* Whether x lies in the zone of narrow segments. */
static inline int is_near(const cell_path *along, int32_t x)
{
  return (uint32_t)x + (uint32_t)along->inner < 2U * (uint32_t)along->inner;
}

/* A part of 2^-15 of the segment that holds x is 2^this. */
static inline unsigned fineness(const cell_path *along, int32_t x)
{
  return is_near(along, x) ? along->narrow : along->wide;
}

/* Where x falls on a row, -1 <= x < 1. Beyond the zone all is counted from the end of the row in
   wide segments, as many as a row of these alone would have. */
static inline anhyst_spot spot_on(const cell_path *along, const int16_t *row, int32_t x)
{
  const uint32_t zone = 2U * (uint32_t)along->inner;
  uint32_t way = (uint32_t)x + (uint32_t)ONE;
  uint32_t fine = 0; /* segment and 15 bits of its part */
  if (is_near(along, x)) {
    fine =
        (((uint32_t)x + (uint32_t)along->inner) >> along->narrow) + ((uint32_t)along->outer << 15);
  } else {
    way += x > 0 ? 2U * (uint32_t)ONE - zone : 0U;
    fine = way >> along->wide;
  }
  const anhyst_spot spot = {row + (fine >> 15), (int32_t)(fine & 0x7FFFU)};
  return spot;
}

/* What one row has beyond another at the same place; they differ by less than 1. */
static inline int32_t between(anhyst_spot of, const int16_t *other)
{
  const int32_t low = (int32_t)other[0] - of.at[0];
  const int32_t high = (int32_t)other[1] - of.at[1];
  return low * 32768 + (high - low) * of.part;
}

/* The magnetisation of a cell where the field had brought it: what its row has beyond the one
   before, of which this is the place. */
static inline int32_t beyond(const cell_path *along, anhyst_spot without)
{
  return between(without, without.at + along->stride);
}

/* The play of a cell that rests. */
static inline int32_t play_of(const cell_path *along, int cell)
{
  if (cell < along->moved) {
    return along->x + width(along, cell);
  }
  return turned(along->plays[cell - 1], along->falling);
}

/* The same, no further out than a field within the rows can have made it. */
static inline int32_t at_rest(const cell_path *along, int cell)
{
  const int32_t r = width(along, cell);
  return anhyst_clamp(play_of(along, cell), r - ONE, ONE - 1 - r);
}

/* Where a path the other way has left a cell, within the rows. */
static inline int32_t left_at(const cell_path *along, int cell)
{
  return inside(anhyst_sub_q31(play_of(along, cell), width(along, cell)));
}

/* The rows of a block and the widths of its plays. */
static inline void anhyst_cells_rows(cell_path *along, const int16_t *words)
{
  along->thresholds = words + words[ANHYST_WORD_CELLS_THRESHOLDS];
  along->rows = words + words[ANHYST_WORD_CELLS_ROWS];
  along->cells = words[ANHYST_WORD_CELLS_COUNT];
  const unsigned bits = (unsigned)words[ANHYST_WORD_CELLS_SEGMENTS];
  const unsigned halvings = (unsigned)words[ANHYST_WORD_CELLS_ZONE];
  along->inner = ONE >> halvings;
  along->wide = 15U - bits;
  along->narrow = along->wide - halvings;
  along->outer = (1 << bits) - (1 << (bits - halvings));
  along->stride = (2 << bits) + 2 * along->outer + 1;
}

/* Whether two memories have gone opposite ways. */
static inline int have_turned(const anhyst_memory *from, const anhyst_memory *to)
{
  return (from->p < 0) != (to->p < 0);
}

/* How many cells a memory says that move in its direction, all if more than there are; 0: it does
   not say. */
static inline int moving_cells(const cell_path *along, const anhyst_memory *from)
{
  const uint32_t size = from->p < 0 ? 0U - (uint32_t)from->p : (uint32_t)from->p;
  return size <= (uint32_t)along->cells ? (int)size : along->cells + 1;
}

/* The magnetisation of all cells at rest but cell 0, counted as if they had risen. */
int32_t anhyst_cells_at_rest(const int16_t *words, const int32_t *plays);

/* A path that goes on from a memory, in the direction which that had; what rests is summed up where
   the memory does not say which cells move. */
static inline void anhyst_cells_begin(cell_path *along, const int16_t *words,
                                      const anhyst_memory *from, const int32_t *plays)
{
  anhyst_cells_rows(along, words);
  along->plays = plays;
  along->active = moving_cells(along, from);
  along->falling = from->p < 0 ? -1 : 0;
  along->x = inside(turned(from->x, along->falling));
  along->moved = 0;
  along->left.at = along->rows;
  along->left.part = 0;
  along->frozen = from->turn;
  along->rest = along->active > along->cells ? 0 : inside(turned(from->y, along->falling));
  if (along->active == 0) {
    along->active = 1;
    along->frozen = -1;
    along->rest = anhyst_cells_at_rest(words, plays);
  }
  along->row = row_of(along, along->active);
}

int anhyst_cells_is_valid(const int16_t *words);

/* Takes over into the plays what a step leaves in them that turns where this memory stands. */
void anhyst_cells_keep(const int16_t *words, const anhyst_memory *from, int32_t *plays);

/* As anhyst_kernel says of them, for one memory. */
void anhyst_cells_carry(const int16_t *before, const int16_t *words, int32_t flux,
                        anhyst_memory *memory, int32_t *plays);
void anhyst_cells_start(const int16_t *words, const int32_t *plays, anhyst_memory *memory);

/* Whether a candidate stands on a segment: none does that was not found yet, nor one whose words
   were damaged. */
static inline int is_placed(const anhyst_candidate *at) { return at->fine - 1U < 15U; }

#if ANHYST_MEMORIES > 1
/* Solid iron: layers of the law. */
extern const anhyst_kernel anhyst_kernel_solid;
const anhyst_kernel *anhyst_cells_for_block(const int16_t *words);

/* Whether the words about layers are valid; those of the law must be. */
int anhyst_solid_is_valid(const int16_t *words);

/* Lets the law meet flux_arm*flux + field_arm*field = target, the target over 4; gives the flux.
   Where the fine of the candidate is not 0, it is one that leads on from the memory. */
int32_t anhyst_cells_meet(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                          const anhyst_arms *arms, int32_t target, anhyst_candidate *to);

/* Makes a candidate of where a memory stands; gives the flux there. */
int32_t anhyst_cells_stand(const int16_t *words, const anhyst_memory *memory, const int32_t *plays,
                           anhyst_candidate *at);

/* The flux where a candidate stands. */
int32_t anhyst_cells_flux_of(const int16_t *words, const anhyst_candidate *at);
#endif

#endif

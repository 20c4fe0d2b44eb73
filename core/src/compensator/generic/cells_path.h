/* SPDX-License-Identifier: Apache-2.0 */
/* A path of the law of play cells: its rows, its state, and the parts of the magnetisation.
   Template for one format; its arithmetic is included before (cells_fixed.h, cells_real.h).
   Fields and plays are in the direction of the path. */

/* A rising path. Cell 0 has no width and always moves. */
typedef struct {
  const entry *thresholds; /* half-widths of the cells from 1 on */
  const entry *rows;       /* for 1, 2, ... moving cells */
  const entry *row;        /* for the cells that move */
  const number *plays;
  number inner;  /* half-width of the zone around 0 with narrow segments */
  int centre;    /* entries of a row before that at the field 0 */
  int outer;     /* wide segments on each side */
  int stride;    /* entries of a row */
  grid narrow;   /* width of a segment in the zone */
  grid wide;     /* beyond it */
  int cells;     /* cells in addition to cell 0 */
  int active;    /* the cells below this one move */
  int moved;     /* the cells below this one moved in the other direction until the reversal */
  spot left;     /* the reversal point on the first row, in the other direction */
  int32_t risen; /* bit i: cell i came to rest while the field rose */
  number rest;   /* magnetisation of the cells that rest */
  int mirror;    /* -1: the path falls, and everything is mirrored; 0 */
  number low;    /* field where the last cell joined, or where the step began */
  number x;      /* field */
  const entry *segment; /* of the row, the one that contains x at the end of the path */
} cell_path;

/* Half-width of the play of a cell. */
static inline number half_width(const cell_path *along, int cell)
{
  return level_of(along->thresholds[cell - 1]);
}

/* Entries between a row and the one for that many more cells. */
static inline int rows_on(const cell_path *along, int cells) { return cells * along->stride; }

static inline const entry *row_of(const cell_path *along, int cells)
{
  return along->rows + rows_on(along, cells - 1);
}

/* Whether x is in the zone of narrow segments. */
static inline int is_near(const cell_path *along, number x)
{
  return is_around_zero(x, along->inner);
}

static inline grid grid_on(const cell_path *along, number x)
{
  return is_near(along, x) ? along->narrow : along->wide;
}

/* The spot of x on a row. Requires |x| < 1. */
static inline spot spot_on(const cell_path *along, const entry *row, number x)
{
  grid width = along->narrow;
  row += along->centre;
  if (!is_near(along, x)) {
    width = along->wide;
    row += x > 0 ? along->outer : -along->outer;
  }
  return spot_from(row, x, width);
}

/* The magnetisation of a cell whose play was moved by the field: its row minus the row before, of
   which this is the spot. */
static inline number beyond(const cell_path *along, spot without)
{
  return between(without, without.at + along->stride);
}

/* The play of a cell that rests. */
static inline number play_of(const cell_path *along, int cell)
{
  if (cell < along->moved) {
    return along->x + half_width(along, cell);
  }
  return mirrored(along->plays[cell - 1], along->mirror);
}

/* The same, limited to what a field within the rows can cause. */
static inline number play_at_rest(const cell_path *along, int cell)
{
  const number r = half_width(along, cell);
  return clamped(play_of(along, cell), r + FIELD_MIN, FIELD_MAX - r);
}

/* The field at which a path of the other direction left a cell, within the rows. */
static inline number left_at(const cell_path *along, int cell)
{
  return inside(difference(play_of(along, cell), half_width(along, cell)));
}

/* Sets the rows of a block and the half-widths of its plays. */
static inline void set_rows(cell_path *along, const entry *words)
{
  const unsigned bits = (unsigned)integer_of(words[ANHYST_WORD_CELLS_SEGMENTS]);
  const unsigned halvings = (unsigned)integer_of(words[ANHYST_WORD_CELLS_ZONE]);
  along->thresholds = words + integer_of(words[ANHYST_WORD_CELLS_THRESHOLDS]);
  along->rows = words + integer_of(words[ANHYST_WORD_CELLS_ROWS]);
  along->cells = integer_of(words[ANHYST_WORD_CELLS_COUNT]);
  along->inner = POWER_OF_HALF(halvings);
  along->wide = grid_of(bits);
  along->narrow = grid_of(bits + halvings);
  along->outer = (1 << bits) - (1 << (bits - halvings));
  along->centre = (1 << bits) + along->outer;
  along->stride = 2 * along->centre + 1;
}

/* Whether two memories moved in opposite directions. */
static inline int have_turned(const cells_memory *from, const cells_memory *to)
{
  return (from->active < 0) != (to->active < 0);
}

/* Number of moving cells that a memory states, all if that is more than there are; 0: unknown. */
static inline int moving_cells(const cell_path *along, const cells_memory *from)
{
  const uint32_t size = from->active < 0 ? 0U - (uint32_t)from->active : (uint32_t)from->active;
  return size <= (uint32_t)along->cells ? (int)size : along->cells + 1;
}

/* The magnetisation of all cells at rest except cell 0, as if they had risen. */
static number sum_at_rest(const cell_path *along)
{
  number total = 0;
  for (int cell = 1; cell <= along->cells; cell++) {
    const number x = inside(sum(play_of(along, cell), half_width(along, cell)));
    total = inside(total + beyond(along, spot_on(along, row_of(along, cell), x)));
  }
  return total;
}

/* Rows and plays of a path that rises and has left no cell. */
static inline void set_rested(cell_path *along, const entry *words, const number *plays)
{
  set_rows(along, words);
  along->plays = plays;
  along->moved = 0;
  along->mirror = 0;
}

/* Starts a path at a memory, in the direction of the memory. The cells at rest are summed if the
   memory does not state which cells move. */
static inline void begin_path(cell_path *along, const entry *words, const cells_memory *from,
                              const number *plays)
{
  set_rested(along, words, plays);
  along->active = moving_cells(along, from);
  along->risen = from->risen;
  along->left.at = along->rows;
  along->left.part = 0;
  if (along->active == 0) {
    along->active = 1;
    along->risen = -1;
    along->rest = sum_at_rest(along);
    along->x = inside(from->x);
  } else {
    along->mirror = from->active < 0 ? -1 : 0;
    along->x = inside(mirrored(from->x, along->mirror));
    along->rest = along->active > along->cells ? 0 : inside(mirrored(from->rest, along->mirror));
  }
  along->row = row_of(along, along->active);
}

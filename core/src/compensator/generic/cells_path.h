/* SPDX-License-Identifier: Apache-2.0 */
/* A path of the play-cell law: the table rows, the state, and the terms of the magnetisation.
   Template for one number format. A header with the arithmetic is included before (cells_fixed.h,
   cells_real.h). Fields and plays are mirrored if the field falls, so that every path rises. */

/* A path with rising field. Cell 0 has threshold 0 and is always active. */
typedef struct {
  const entry *thresholds; /* thresholds of cells 1, 2, ... */
  const entry *rows;       /* table rows for 1, 2, ... active cells */
  const entry *row;        /* table row of the present active cells */
  const number *plays;
  number zone_half_width;  /* half-width of the zone around zero field with narrow segments */
  int zero_index;          /* column of zero field in a table row */
  int wide_segments;       /* number of wide segments on each side of zero field */
  int stride;              /* number of entries in a table row */
  segment_grid zone_grid;  /* segment width in the zone */
  segment_grid wide_grid;  /* segment width outside the zone */
  int cells;               /* number of cells in addition to cell 0 */
  int active;              /* number of active cells, which have the lowest indices */
  int prior_active;        /* number of active cells before the last reversal */
  table_position reversal; /* reversal point in the first table row */
  int32_t stopped_on_rise; /* bit i: cell i came to rest while the field rose */
  number resting_m;        /* magnetisation of the cells at rest */
  int mirror;              /* 0 if the field rises; -1 if it falls: all numbers are mirrored */
  number last_activation;  /* field where the last cell became active, or where the step started */
  number x;                /* effective field */
  const entry *segment;    /* segment of the row that contains x at the end of the path */
} cell_path;

/* Returns the threshold of a cell, which is the half-width of the cell's play. */
static inline number half_width(const cell_path *path, int cell)
{
  return word_value(path->thresholds[cell - 1]);
}

/* Returns the number of entries between a table row and the row for more active cells. */
static inline int row_offset(const cell_path *path, int cells) { return cells * path->stride; }

static inline const entry *active_row(const cell_path *path, int cells)
{
  return path->rows + row_offset(path, cells - 1);
}

/* Returns whether x is in the zone of narrow segments. */
static inline int is_in_zone(const cell_path *path, number x)
{
  return is_around_zero(x, path->zone_half_width);
}

static inline segment_grid grid_at_field(const cell_path *path, number x)
{
  return is_in_zone(path, x) ? path->zone_grid : path->wide_grid;
}

/* Returns the position of the field x in a table row. Requires |x| < 1. */
static inline table_position locate_field(const cell_path *path, const entry *row, number x)
{
  segment_grid width = path->zone_grid;
  row += path->zero_index;
  if (!is_in_zone(path, x)) {
    width = path->wide_grid;
    row += x > 0 ? path->wide_segments : -path->wide_segments;
  }
  return locate_from_zero(row, x, width);
}

/* Returns the magnetisation of the next cell to become active: next row minus present row. */
static inline number cell_magnetisation(const cell_path *path, table_position position)
{
  return row_difference(position, position.segment + path->stride);
}

static inline number resting_play(const cell_path *path, int cell)
{
  if (cell < path->prior_active) {
    return path->x + half_width(path, cell);
  }
  return mirrored(path->plays[cell - 1], path->mirror);
}

/* Returns the play of a cell at rest, limited to values that a field within the table can cause. */
static inline number limited_resting_play(const cell_path *path, int cell)
{
  const number r = half_width(path, cell);
  return clamped(resting_play(path, cell), r + MIN_FIELD, MAX_FIELD - r);
}

/* Returns the field, within the table, at which a cell came to rest before the last reversal. */
static inline number stopping_field(const cell_path *path, int cell)
{
  return saturate(difference(resting_play(path, cell), half_width(path, cell)));
}

static inline void read_row_layout(cell_path *path, const entry *words)
{
  const unsigned bits = (unsigned)integer_of(words[ANHYST_WORD_CELLS_SEGMENTS]);
  const unsigned halvings = (unsigned)integer_of(words[ANHYST_WORD_CELLS_ZONE]);
  path->thresholds = words + integer_of(words[ANHYST_WORD_CELLS_THRESHOLDS]);
  path->rows = words + integer_of(words[ANHYST_WORD_CELLS_ROWS]);
  path->cells = integer_of(words[ANHYST_WORD_CELLS_COUNT]);
  path->zone_half_width = POWER_OF_HALF(halvings);
  path->wide_grid = grid_from_halvings(bits);
  path->zone_grid = grid_from_halvings(bits + halvings);
  path->wide_segments = (1 << bits) - (1 << (bits - halvings));
  path->zero_index = (1 << bits) + path->wide_segments;
  path->stride = 2 * path->zero_index + 1;
}

/* Returns whether the field moved in opposite directions at two states. */
static inline int have_reversed(const cells_memory *from, const cells_memory *to)
{
  return (from->active < 0) != (to->active < 0);
}

/* Returns the number of active cells of a state, at most the number of all cells; 0: unknown. */
static inline int count_active_cells(const cell_path *path, const cells_memory *from)
{
  const uint32_t size = from->active < 0 ? 0U - (uint32_t)from->active : (uint32_t)from->active;
  return size <= (uint32_t)path->cells ? (int)size : path->cells + 1;
}

/* Returns the magnetisation of all cells except cell 0, as if they had stopped on a rising path. */
static number sum_resting_cells(const cell_path *path)
{
  number total = 0;
  for (int cell = 1; cell <= path->cells; cell++) {
    const number x = saturate(sum(resting_play(path, cell), half_width(path, cell)));
    total =
        saturate(total + cell_magnetisation(path, locate_field(path, active_row(path, cell), x)));
  }
  return total;
}

/* Initialises a path with rising field and without a reversal. */
static inline void init_path(cell_path *path, const entry *words, const number *plays)
{
  read_row_layout(path, words);
  path->plays = plays;
  path->prior_active = 0;
  path->mirror = 0;
}

/* Starts a path at a stored state, in the direction of the last step. Sums the magnetisation of the
   cells at rest if the state does not contain the number of active cells. */
static inline void begin_path(cell_path *path, const entry *words, const cells_memory *from,
                              const number *plays)
{
  init_path(path, words, plays);
  path->active = count_active_cells(path, from);
  path->stopped_on_rise = from->stopped_on_rise;
  path->reversal.segment = path->rows;
  path->reversal.fraction = 0;
  if (path->active == 0) {
    path->active = 1;
    path->stopped_on_rise = -1;
    path->resting_m = sum_resting_cells(path);
    path->x = saturate(from->x);
  } else {
    path->mirror = from->active < 0 ? -1 : 0;
    path->x = saturate(mirrored(from->x, path->mirror));
    path->resting_m =
        path->active > path->cells ? 0 : saturate(mirrored(from->resting_m, path->mirror));
  }
  path->row = active_row(path, path->active);
}

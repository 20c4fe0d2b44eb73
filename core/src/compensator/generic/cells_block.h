/* SPDX-License-Identifier: Apache-2.0 */
/* The parameter block of the play-cell law: its checks, the plays after a reversal, the
   demagnetised state, and the transfer of a state to another block. Template for one number format;
   generic/cells_path.h is included before. */

/* Sets a state in which only cell 0 is active. */
static void init_cells(const entry *words, const number *plays, cells_memory *memory)
{
  cell_path path;
  init_path(&path, words, plays);
  memory->resting_m = sum_resting_cells(&path);
  memory->active = 1;
  memory->stopped_on_rise = -1;
  memory->last_activation = memory->x;
}

/* Stores the plays of the active cells, which come to rest if the path reverses at this state. */
static void store_active_plays(const entry *words, const cells_memory *from, number *plays)
{
  cell_path path;
  read_row_layout(&path, words);
  const int mirror = from->active < 0 ? -1 : 0;
  const number x = saturate(mirrored(from->x, mirror));
  const int moving = count_active_cells(&path, from);
  for (int cell = 1; cell < moving; cell++) {
    plays[cell - 1] = mirrored(x - half_width(&path, cell), mirror);
  }
}

static inline number segment_rise(const entry *segment)
{
  return word_value(segment[1]) - word_value(segment[0]);
}

/* Returns whether the entries of all table rows in a column differ by at most 1. */
static int are_column_entries_close(const cell_path *path, int column)
{
  number low = word_value(path->rows[column]);
  number high = low;
  for (int row = 1; row <= path->cells; row++) {
    const number level = word_value(path->rows[row * path->stride + column]);
    low = level < low ? level : low;
    high = level > high ? level : high;
  }
  return high - low <= MAX_ROW_DIFFERENCE;
}

/* Returns whether no table row falls, and all rows differ by at most 1 in every column. */
static int are_rows_valid(const entry *words)
{
  cell_path path;
  read_row_layout(&path, words);
  const int rows = path.cells + 1;
  if ((int32_t)rows * path.stride > MAX_BLOCK_WORDS) {
    return 0;
  }
  const int first = integer_of(words[ANHYST_WORD_CELLS_ROWS]);
  for (int row = 0; row < rows; row++) {
    if (!is_table_rising(words, (entry)(first + row * path.stride), path.stride, -ENTRY_ONE,
                         MAX_ENTRY)) {
      return 0;
    }
  }
  for (int column = 0; column < path.stride; column++) {
    if (!are_column_entries_close(&path, column)) {
      return 0;
    }
  }
  return 1;
}

/* Returns the largest rise of all table rows over a single segment, narrow or wide. */
static number largest_segment_rise(const cell_path *path, int is_narrow)
{
  number max_rise = 0;
  for (int cells = 1; cells <= path->cells + 1; cells++) {
    const entry *row = active_row(path, cells);
    for (int i = 0; i < path->stride - 1; i++) {
      const int is_inner = i >= path->wide_segments && i < path->stride - 1 - path->wide_segments;
      const number rise = segment_rise(row + i);
      max_rise = is_inner == is_narrow && rise > max_rise ? rise : max_rise;
    }
  }
  return max_rise;
}

/* Returns whether flux_arm*flux + field_arm*field rises on every segment by more than rounding. */
static int does_sum_rise_with_field(const entry *words, entry flux_arm, entry field_arm)
{
  cell_path path;
  read_row_layout(&path, words);
  for (int narrow = 0; narrow < 2 && flux_arm < 0; narrow++) {
    const number x = width_of(narrow != 0 ? path.zone_grid : path.wide_grid);
    const number flux =
        quarter(largest_segment_rise(&path, narrow)) + scaled(x, words[ANHYST_WORD_CELLS_AIR]);
    if (scaled(flux, (entry)(flux_arm - WEIGHT_ROUNDING)) +
            quarter(scaled(x, (entry)(field_arm - WEIGHT_ROUNDING))) <=
        MIN_SEGMENT_RISE) {
      return 0;
    }
  }
  return 1;
}

static int does_current_rise_with_field(const entry *words)
{
  const entry *flux_arm = words + integer_of(words[ANHYST_WORD_GAP_FLUX_ARM]);
  const entry *field_arm = words + integer_of(words[ANHYST_WORD_GAP_FIELD_ARM]);
  for (int i = 0; i <= (1 << integer_of(words[ANHYST_WORD_GAP_SEGMENTS])); i++) {
    if (!does_sum_rise_with_field(words, flux_arm[i], field_arm[i])) {
      return 0;
    }
  }
  return 1;
}

#if ANHYST_MEMORIES > 1
static int are_solid_layers_valid(const entry *words);
#endif

/* Returns whether the layers of a block are valid: the program has a state for each layer, and the
   flux rises with the field in each layer. Without layers, all words of the layers must be zero. */
static int are_layers_valid(const entry *words)
{
#if ANHYST_MEMORIES > 1
  if (words[ANHYST_WORD_SOLID_LAYERS] != 0) {
    return are_solid_layers_valid(words) &&
           does_sum_rise_with_field(words, words[ANHYST_WORD_SOLID_OWN], QUARTER_WEIGHT);
  }
#endif
  for (int i = ANHYST_WORD_SOLID_LAYERS; i <= ANHYST_WORD_SOLID_THIRD; i++) {
    if (words[i] != 0) {
      return 0;
    }
  }
  return 1;
}

static int is_cells_block_valid(const entry *words)
{
  if (!(is_weight_positive(words[ANHYST_WORD_CELLS_AIR]) &&
        is_integer(words[ANHYST_WORD_CELLS_COUNT], 1, ANHYST_CELLS) &&
        is_integer(words[ANHYST_WORD_CELLS_SEGMENTS], 2, 8) &&
        is_integer(words[ANHYST_WORD_CELLS_ZONE], 0, 5) &&
        is_integer(words[ANHYST_WORD_CELLS_THRESHOLDS], 0, MAX_BLOCK_WORDS) &&
        is_integer(words[ANHYST_WORD_CELLS_ROWS], 0, MAX_BLOCK_WORDS))) {
    return 0;
  }
  return words[ANHYST_WORD_CELLS_ZONE] <= words[ANHYST_WORD_CELLS_SEGMENTS] &&
         is_single_float(words, ANHYST_WORD_UNIT_FIELD) &&
         is_table_rising(words, words[ANHYST_WORD_CELLS_THRESHOLDS],
                         integer_of(words[ANHYST_WORD_CELLS_COUNT]), MIN_THRESHOLD, ENTRY_ONE) &&
         are_rows_valid(words) && does_current_rise_with_field(words) && are_layers_valid(words);
}

/* Sets the plays of all cells. The play of cell 0 and of unused cells is the field. */
static void collect_plays(const entry *words, const cells_memory *memory, const number *plays,
                          number *all_plays)
{
  cell_path path;
  begin_path(&path, words, memory, plays);
  for (int cell = 0; cell <= ANHYST_CELLS; cell++) {
    number play = path.x;
    if (cell > 0 && cell <= path.cells) {
      play =
          cell < path.active ? path.x - half_width(&path, cell) : limited_resting_play(&path, cell);
    }
    all_plays[cell] = saturate(mirrored(play, path.mirror));
  }
}

/* Returns the play for a threshold r, interpolated between cells with adjacent thresholds. */
static number interpolate_play(const cell_path *path, const number *all_plays, number r)
{
  int below = 0;
  while (below < path->cells && half_width(path, below + 1) <= r) {
    below++;
  }
  const number begin = below > 0 ? half_width(path, below) : 0;
  if (below == path->cells || r == begin) {
    return all_plays[below];
  }
  return interpolate_line(all_plays[below], all_plays[below + 1], r - begin,
                          half_width(path, below + 1) - begin);
}

/* Shifts field and plays along the field axis. Returns the residual of h*x + m = flux after the
   shift, divided by 4. The residual rises with the shift. */
static number shift_state(cell_path *path, const number *all_plays, number travel, entry air,
                          number flux, number *plays)
{
  path->x = saturate(round_to_coarse_grid(sum(all_plays[0], travel)));
  path->plays = plays;
  for (int cell = 1; cell <= path->cells; cell++) {
    plays[cell - 1] = round_to_coarse_grid(sum(all_plays[cell], travel));
    plays[cell - 1] = clamped(limited_resting_play(path, cell), path->x - half_width(path, cell),
                              path->x + half_width(path, cell));
  }
  const number m = row_value(locate_field(path, path->rows, path->x)) + sum_resting_cells(path);
  return quarter(m) + scaled(path->x, air) - quarter(flux);
}

/* Transfers a state to another block. Shifts all plays by the same field, so that the iron has the
   given flux under the new block. Then a constant demand does not start a new branch. The play of a
   new threshold is interpolated between the plays of the adjacent thresholds. */
static void transfer_state(const entry *old_words, const entry *words, number flux,
                           cells_memory *memory, number *plays)
{
  number old_plays[ANHYST_CELLS + 1];
  number all_plays[ANHYST_CELLS + 1] = {0};
  const cells_memory empty = {0, 0, 0, 0, 0};
  cell_path path;
  cell_path old_path;
  collect_plays(old_words, memory, plays, old_plays);
  read_row_layout(&old_path, old_words);
  init_path(&path, words, plays);
  for (int cell = 0; cell <= path.cells; cell++) {
    number r = 0;
    if (cell > 0) {
      /* NOLINTNEXTLINE(readability-suspicious-call-argument): from the new unit to the old one */
      r = convert_unit(half_width(&path, cell), words, old_words, ANHYST_WORD_UNIT_FIELD);
    }
    all_plays[cell] = saturate(convert_unit(interpolate_play(&old_path, old_plays, r), old_words,
                                            words, ANHYST_WORD_UNIT_FIELD));
  }
  number low = 2 * MIN_FIELD;
  number high = 2 * MAX_FIELD;
  for (int i = 0; i < TRANSFER_BISECTIONS; i++) {
    const number middle = low / 2 + high / 2;
    if (shift_state(&path, all_plays, middle, words[ANHYST_WORD_CELLS_AIR], flux, plays) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  *memory = empty;
  memory->x = path.x;
  init_cells(words, plays, memory);
}

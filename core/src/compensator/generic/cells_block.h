/* SPDX-License-Identifier: Apache-2.0 */
/* The parameter block of the law of play cells: its checks, the plays after a reversal, the start,
   and the transfer of a memory to another block. Template for one format; generic/cells.h is
   included before. */

/* Only cell 0 moves. */
static void start_memory(const entry *words, const number *plays, cells_memory *memory)
{
  cell_path along;
  set_rested(&along, words, plays);
  memory->rest = sum_at_rest(&along);
  memory->active = 1;
  memory->risen = -1;
  memory->joined = memory->x;
}

/* Sets the plays that a path leaves in the cells if it reverses at this memory. */
static void keep_plays(const entry *words, const cells_memory *from, number *plays)
{
  cell_path along;
  set_rows(&along, words);
  const int mirror = from->active < 0 ? -1 : 0;
  const number x = inside(mirrored(from->x, mirror));
  const int moved = moving_cells(&along, from);
  for (int cell = 1; cell < moved; cell++) {
    plays[cell - 1] = mirrored(x - half_width(&along, cell), mirror);
  }
}

/* The rise of a row on a segment. */
static inline number row_rise(const entry *segment)
{
  return level_of(segment[1]) - level_of(segment[0]);
}

/* Whether the entries of all rows in a column are within 1 of each other. */
static int rows_are_near(const cell_path *along, int column)
{
  number low = level_of(along->rows[column]);
  number high = low;
  for (int row = 1; row <= along->cells; row++) {
    const number level = level_of(along->rows[row * along->stride + column]);
    low = level < low ? level : low;
    high = level > high ? level : high;
  }
  return high - low <= LEVEL_MAX;
}

/* Whether no row falls, and no two rows differ by 1 anywhere. */
static int rows_are_valid(const entry *words)
{
  cell_path along;
  set_rows(&along, words);
  const int rows = along.cells + 1;
  if ((int32_t)rows * along.stride > MAX_BLOCK_WORDS) {
    return 0;
  }
  const int first = integer_of(words[ANHYST_WORD_CELLS_ROWS]);
  for (int row = 0; row < rows; row++) {
    if (!is_table_rising(words, (entry)(first + row * along.stride), along.stride, -ENTRY_ONE,
                         ENTRY_MOST)) {
      return 0;
    }
  }
  for (int column = 0; column < along.stride; column++) {
    if (!rows_are_near(&along, column)) {
      return 0;
    }
  }
  return 1;
}

/* The largest rise of a row on a segment, narrow or wide. */
static number steepest(const cell_path *along, int is_narrow)
{
  number most = 0;
  for (int cells = 1; cells <= along->cells + 1; cells++) {
    const entry *row = row_of(along, cells);
    for (int i = 0; i < along->stride - 1; i++) {
      const int is_inner = i >= along->outer && i < along->stride - 1 - along->outer;
      const number rise = row_rise(row + i);
      most = is_inner == is_narrow && rise > most ? rise : most;
    }
  }
  return most;
}

/* Whether more field needs more of what these arms make of field and flux on every segment, by more
   than the rounding of either arm can take away. */
static int rises_with(const entry *words, entry flux_arm, entry field_arm)
{
  cell_path along;
  set_rows(&along, words);
  for (int narrow = 0; narrow < 2 && flux_arm < 0; narrow++) {
    const number x = width_of(narrow != 0 ? along.narrow : along.wide);
    const number flux = quarter(steepest(&along, narrow)) + scaled(x, words[ANHYST_WORD_CELLS_AIR]);
    if (scaled(flux, (entry)(flux_arm - ARM_ROUNDING)) +
            quarter(scaled(x, (entry)(field_arm - ARM_ROUNDING))) <=
        RISE_MIN) {
      return 0;
    }
  }
  return 1;
}

/* Whether more field needs more current at every gap. */
static int current_rises(const entry *words)
{
  const entry *flux_arm = words + integer_of(words[ANHYST_WORD_GAP_FLUX_ARM]);
  const entry *field_arm = words + integer_of(words[ANHYST_WORD_GAP_FIELD_ARM]);
  for (int i = 0; i <= (1 << integer_of(words[ANHYST_WORD_GAP_SEGMENTS])); i++) {
    if (!rises_with(words, flux_arm[i], field_arm[i])) {
      return 0;
    }
  }
  return 1;
}

#if ANHYST_MEMORIES > 1
static int solid_is_valid(const entry *words);
#endif

/* Whether the program has memories for the layers of a block, and more field gives more flux in
   each of them. A block without layers has zeros in these words. */
static int layers_are_valid(const entry *words)
{
#if ANHYST_MEMORIES > 1
  if (words[ANHYST_WORD_SOLID_LAYERS] != 0) {
    return solid_is_valid(words) && rises_with(words, words[ANHYST_WORD_SOLID_OWN], QUARTER_WEIGHT);
  }
#endif
  for (int i = ANHYST_WORD_SOLID_LAYERS; i <= ANHYST_WORD_SOLID_LAMINATED; i++) {
    if (words[i] != 0) {
      return 0;
    }
  }
  return 1;
}

static int cells_is_valid(const entry *words)
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
         is_single(words, ANHYST_WORD_UNIT_FIELD) &&
         is_table_rising(words, words[ANHYST_WORD_CELLS_THRESHOLDS],
                         integer_of(words[ANHYST_WORD_CELLS_COUNT]), THRESHOLD_MIN, ENTRY_ONE) &&
         rows_are_valid(words) && current_rises(words) && layers_are_valid(words);
}

/* Sets the plays of all cells; the field for cell 0 and for cells that do not exist. */
static void find_plays(const entry *words, const cells_memory *memory, const number *plays,
                       number *stairs)
{
  cell_path along;
  begin_path(&along, words, memory, plays);
  for (int cell = 0; cell <= ANHYST_CELLS; cell++) {
    number play = along.x;
    if (cell > 0 && cell <= along.cells) {
      play = cell < along.active ? along.x - half_width(&along, cell) : play_at_rest(&along, cell);
    }
    stairs[cell] = inside(mirrored(play, along.mirror));
  }
}

/* The play of a cell of any half-width, on a straight line between its neighbours. */
static number play_between(const cell_path *along, const number *stairs, number r)
{
  int below = 0;
  while (below < along->cells && half_width(along, below + 1) <= r) {
    below++;
  }
  const number begin = below > 0 ? half_width(along, below) : 0;
  if (below == along->cells || r == begin) {
    return stairs[below];
  }
  return on_line(stairs[below], stairs[below + 1], r - begin, half_width(along, below + 1) - begin);
}

/* Moves field and plays by a travel along the field; returns the residual of h*x + m = flux there,
   over 4. It rises with the travel. */
static number carried_to(cell_path *along, const number *stairs, number travelled, entry air,
                         number flux, number *plays)
{
  along->x = inside(on_coarse_grid(sum(stairs[0], travelled)));
  along->plays = plays;
  for (int cell = 1; cell <= along->cells; cell++) {
    plays[cell - 1] = on_coarse_grid(sum(stairs[cell], travelled));
    plays[cell - 1] = clamped(play_at_rest(along, cell), along->x - half_width(along, cell),
                              along->x + half_width(along, cell));
  }
  const number m = value_at(spot_on(along, along->rows, along->x)) + sum_at_rest(along);
  return quarter(m) + scaled(along->x, air) - quarter(flux);
}

/* Transfers a memory to another block. All plays move along the field by the same travel, to the
   given flux under the new block, so that a constant demand is not reached over a branch. A play of
   another half-width is set between its neighbours. */
static void carry_memory(const entry *before, const entry *words, number flux, cells_memory *memory,
                         number *plays)
{
  number old[ANHYST_CELLS + 1];
  number stairs[ANHYST_CELLS + 1] = {0};
  const cells_memory none = {0, 0, 0, 0, 0};
  cell_path along;
  cell_path other;
  find_plays(before, memory, plays, old);
  set_rows(&other, before);
  set_rested(&along, words, plays);
  for (int cell = 0; cell <= along.cells; cell++) {
    number r = 0;
    if (cell > 0) {
      /* NOLINTNEXTLINE(readability-suspicious-call-argument): from the new unit to the old one */
      r = in_unit(half_width(&along, cell), words, before, ANHYST_WORD_UNIT_FIELD);
    }
    stairs[cell] =
        inside(in_unit(play_between(&other, old, r), before, words, ANHYST_WORD_UNIT_FIELD));
  }
  number low = 2 * FIELD_MIN;
  number high = 2 * FIELD_MAX;
  for (int i = 0; i < CARRY_HALVINGS; i++) {
    const number middle = low / 2 + high / 2;
    if (carried_to(&along, stairs, middle, words[ANHYST_WORD_CELLS_AIR], flux, plays) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  *memory = none;
  memory->x = along.x;
  start_memory(words, plays, memory);
}

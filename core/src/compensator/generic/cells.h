/* SPDX-License-Identifier: Apache-2.0 */
/* The law of cells in floating point: plays in the effective field, each with a curve of its own.

   Cell i keeps its play p within r of the field x and gives f(p); m is the sum. Along a rising path
   those that move are the first ones, all with p = x - r, and their sum is a row of a table over x;
   the others rest. The next cell joins where x reaches p + r. Everything happens on a path that
   rises: a falling one is mirrored. Rows are straight between their entries, so that what is
   solved for, flux_arm*(h*x + m) + field_arm*x = target, is solved in closed form on its segment.
   What rests is summed up anew at every turn, so that no rounding adds up, and each cell on the
   side where its path has left it: between their entries rows are not quite odd, so that counted on
   the other side the iron would jump as the path turns. */

/* Bits of all cells: they came to rest while the field rose. */
#define ALL_RISEN (((uint32_t)2 << (uint16_t)ANHYST_CELLS) - 1U)

/* A rising path. Cell 0 has no width, and moves always. */
typedef struct {
  const anhyst_cells_law_x *law;
  const ANHYST_REAL *plays;
  ANHYST_REAL x;
  ANHYST_REAL rest; /* magnetisation of the cells that rest */
  uint16_t active;  /* the cells below this one move */
  uint16_t moved;   /* those below this one moved the other way until here */
  uint32_t risen;   /* bit i: cell i came to rest while the field rose */
  int falling;      /* all is mirrored */
} cell_path;

/* What is solved for, in the direction of the path. */
typedef struct {
  ANHYST_REAL flux_arm;
  ANHYST_REAL field_arm;
  ANHYST_REAL target;
} equation;

static ANHYST_REAL facing(ANHYST_REAL a, int falling) { return falling ? -a : a; }

/* Half-width of the play of a cell. */
static ANHYST_REAL width(const cell_path *along, uint16_t cell)
{
  return along->law->thresholds[cell - 1U];
}

/* A field counted in segments: of a row, narrow ones around zero and wide ones beyond. */
static ANHYST_REAL place_of(const anhyst_cells_law_x *law, ANHYST_REAL x)
{
  const ANHYST_REAL beyond = anhyst_size_x(x) - law->inner;
  ANHYST_REAL place = x * (ANHYST_REAL)law->narrow / law->inner;
  if (beyond > R(0.0)) {
    place = (ANHYST_REAL)law->narrow + beyond * (ANHYST_REAL)law->wide / (law->reach - law->inner);
    place = x < R(0.0) ? -place : place;
  }
  return place + (ANHYST_REAL)(law->narrow + law->wide);
}

/* How many segments a row has. */
static uint16_t segments_of(const anhyst_cells_law_x *law)
{
  return (uint16_t)(2U * (law->narrow + law->wide));
}

static const ANHYST_REAL *row_of(const anhyst_cells_law_x *law, uint16_t cells)
{
  const uint32_t entries = (cells - 1U) * (segments_of(law) + 1U);
  return law->rows + entries;
}

/* The magnetisation of so many moving cells. */
static ANHYST_REAL moving(const cell_path *along, uint16_t cells, ANHYST_REAL x)
{
  const anhyst_cells_law_x *law = along->law;
  return anhyst_value_at_x(row_of(law, cells),
                           anhyst_spot_of_x(segments_of(law), place_of(law, x)));
}

/* The play of a cell that rests, as the field has left it at most. */
static ANHYST_REAL at_rest(const cell_path *along, uint16_t cell)
{
  const ANHYST_REAL r = width(along, cell);
  if (cell < along->moved) {
    return along->x + r;
  }
  return anhyst_limited_x(facing(along->plays[cell - 1U], along->falling), along->x - r,
                          along->x + r);
}

/* Whether a cell came to rest on a path of the opposite direction. */
static int opposes(const cell_path *along, uint16_t cell)
{
  const uint32_t rises = along->falling ? 0U : 1U;
  return ((along->risen >> cell) & 1U) != rises;
}

/* What a cell that rests gives, where the field had brought it: on the side on which it did. */
static ANHYST_REAL alone(const cell_path *along, uint16_t cell)
{
  const int against = opposes(along, cell);
  const ANHYST_REAL play = facing(at_rest(along, cell), against);
  const ANHYST_REAL x = play + width(along, cell);
  const ANHYST_REAL m = moving(along, (uint16_t)(cell + 1U), x) - moving(along, cell, x);
  return facing(m, against);
}

/* Lets all cells rest but cell 0. */
static void rest_all(cell_path *along)
{
  along->active = 1;
  along->rest = R(0.0);
  for (uint16_t cell = 1; cell <= along->law->cells; cell++) {
    along->rest += alone(along, cell);
  }
}

/* Leaves a path for the opposite one. */
static void turn(cell_path *along)
{
  const uint32_t moved = ((uint32_t)1 << along->active) - 1U;
  along->risen = along->falling ? (along->risen & ~moved) : (along->risen | moved);
  along->falling = !along->falling;
  along->x = -along->x;
  along->moved = along->active;
  rest_all(along);
}

/* A path that goes on from a memory, in the direction which that had. */
static cell_path begin(const anhyst_cells_law_x *law, const anhyst_cells_memory_x *from,
                       const ANHYST_REAL *plays)
{
  cell_path along;
  const ANHYST_REAL count = anhyst_size_x(from->active);
  along.law = law;
  along.plays = plays;
  along.moved = 0;
  along.risen = from->risen & ALL_RISEN;
  along.falling = from->active < R(0.0);
  along.x = facing(anhyst_limited_x(from->x, -law->reach, law->reach), along.falling);
  if (count >= R(1.0) && count <= (ANHYST_REAL)law->cells + R(1.0)) {
    along.active = (uint16_t)count;
    along.rest = facing(from->rest, along.falling);
  } else { /* not known: as if they had risen */
    along.risen = ALL_RISEN;
    rest_all(&along);
  }
  return along;
}

/* What is missing of the target where the field is x. */
static ANHYST_REAL missing_at(const cell_path *along, const equation *solve, ANHYST_REAL x)
{
  const ANHYST_REAL m = moving(along, along->active, x) + along->rest;
  return solve->target - (solve->flux_arm * (m + along->law->air * x) + solve->field_arm * x);
}

/* The field at the lower end of a segment. */
static ANHYST_REAL node(const cell_path *along, uint16_t segment)
{
  const anhyst_cells_law_x *law = along->law;
  const ANHYST_REAL from_middle = (ANHYST_REAL)segment - (ANHYST_REAL)(law->narrow + law->wide);
  const ANHYST_REAL beyond = anhyst_size_x(from_middle) - (ANHYST_REAL)law->narrow;
  if (beyond <= R(0.0)) {
    return from_middle * law->inner / (ANHYST_REAL)law->narrow;
  }
  const ANHYST_REAL x = law->inner + beyond * (law->reach - law->inner) / (ANHYST_REAL)law->wide;
  return from_middle < R(0.0) ? -x : x;
}

static uint16_t segment_of(const cell_path *along, ANHYST_REAL x)
{
  const anhyst_cells_law_x *law = along->law;
  return anhyst_spot_of_x(segments_of(law), place_of(law, x)).index;
}

/* Goes to the target between two places, on the row of the cells that move. */
static void go(cell_path *along, const equation *solve, ANHYST_REAL low, ANHYST_REAL high)
{
  uint16_t first = segment_of(along, low);
  uint16_t end = segment_of(along, high);
  while (first < end) {
    const uint16_t middle = (uint16_t)((first + end + 1U) / 2U);
    if (missing_at(along, solve, node(along, middle)) > R(0.0)) {
      first = middle;
    } else {
      end = (uint16_t)(middle - 1U);
    }
  }
  const ANHYST_REAL begin = node(along, first);
  const ANHYST_REAL beyond = node(along, (uint16_t)(first + 1U));
  const ANHYST_REAL missing = missing_at(along, solve, begin);
  const ANHYST_REAL rise = missing - missing_at(along, solve, beyond);
  const ANHYST_REAL part = rise > R(0.0) ? missing / rise : R(0.0);
  along->x = anhyst_limited_x(begin + part * (beyond - begin), low, high);
}

/* Lets cells join till the target is met. */
static void advance(cell_path *along, const equation *solve)
{
  const anhyst_cells_law_x *law = along->law;
  ANHYST_REAL low = along->x;
  ANHYST_REAL high = law->reach;
  while (along->active <= law->cells) {
    const uint16_t cell = along->active;
    const ANHYST_REAL joins =
        anhyst_limited_x(at_rest(along, cell) + width(along, cell), low, law->reach);
    if (!(missing_at(along, solve, joins) > R(0.0))) {
      high = joins;
      break;
    }
    along->rest -= alone(along, cell);
    along->active = (uint16_t)(cell + 1U);
    low = joins;
  }
  if (along->active > law->cells) {
    along->rest = R(0.0); /* none rests */
  }
  go(along, solve, low, high);
}

/* Solves from a memory on; returns m. */
static ANHYST_REAL meet(const anhyst_cells_law_x *law, const anhyst_cells_memory_x *from,
                        const ANHYST_REAL *plays, equation solve, anhyst_cells_memory_x *to)
{
  cell_path along = begin(law, from, plays);
  solve.target = facing(solve.target, along.falling);
  const ANHYST_REAL missing = missing_at(&along, &solve, along.x);
  const ANHYST_REAL size = anhyst_size_x(solve.target) + anhyst_size_x(solve.flux_arm) +
                           anhyst_size_x(solve.field_arm * along.x);
  /* Unless it is there already, or the target is no number. */
  if (anhyst_size_x(missing) > anhyst_noise_x(size)) {
    if (missing < R(0.0)) {
      turn(&along);
      solve.target = -solve.target;
    }
    advance(&along, &solve);
  }
  const ANHYST_REAL active = (ANHYST_REAL)along.active;
  to->x = facing(along.x, along.falling);
  to->rest = facing(along.rest, along.falling);
  to->active = facing(active, along.falling);
  to->risen = along.risen;
  const ANHYST_REAL m = moving(&along, along.active, along.x) + along.rest;
  return facing(m, along.falling);
}

static ANHYST_REAL cells_field(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                               const ANHYST_REAL *plays, ANHYST_REAL flux, anhyst_memory_x *to)
{
  const equation solve = {R(1.0), R(0.0), flux};
  (void)meet(parameters->cells, &from->cells, plays, solve, &to->cells);
  return to->cells.x;
}

static ANHYST_REAL cells_flux(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                              const ANHYST_REAL *plays, const anhyst_at_gap_x *arms,
                              ANHYST_REAL current, anhyst_memory_x *to)
{
  const equation solve = {arms->flux_arm, arms->field_arm, current - arms->bias};
  const ANHYST_REAL m = meet(parameters->cells, &from->cells, plays, solve, &to->cells);
  return m + parameters->cells->air * to->cells.x;
}

/* Whether more field needs more current at every gap, on the steepest segment of any row. */
static int current_rises(const anhyst_parameters_x *parameters)
{
  const anhyst_cells_law_x *law = parameters->cells;
  cell_path along;
  ANHYST_REAL steepest = R(0.0);
  along.law = law;
  for (uint16_t cells = 1; cells <= law->cells + 1U; cells++) {
    const ANHYST_REAL *row = row_of(law, cells);
    for (uint16_t i = 0; i < segments_of(law); i++) {
      const ANHYST_REAL x = node(&along, (uint16_t)(i + 1U)) - node(&along, i);
      const ANHYST_REAL slope = (row[i + 1U] - row[i]) / x;
      steepest = slope > steepest ? slope : steepest;
    }
  }
  for (uint16_t i = 0; i <= parameters->gap_segments; i++) {
    const anhyst_at_gap_x *row = parameters->gaps + i;
    if (!(row->field_arm + row->flux_arm * (law->air + steepest) > R(0.0))) {
      return 0;
    }
  }
  return 1;
}

static int rows_rise(const anhyst_cells_law_x *law)
{
  for (uint16_t cells = 1; cells <= law->cells + 1U; cells++) {
    if (!anhyst_rises_x(row_of(law, cells), segments_of(law), R(-1.0), R(1.0))) {
      return 0;
    }
  }
  return 1;
}

static int cells_is_valid(const anhyst_parameters_x *parameters)
{
  const anhyst_cells_law_x *law = parameters->cells;
  const ANHYST_REAL largest = R(1e12);
  return law != 0 && law->thresholds != 0 && law->rows != 0 && law->reach > R(0.0) &&
         law->reach <= largest && law->air > R(0.0) && law->air <= largest && law->cells >= 1U &&
         law->cells <= ANHYST_CELLS && law->inner > R(0.0) && law->inner <= law->reach &&
         law->narrow >= 4U && law->narrow <= 1024U && law->wide <= 1024U &&
         law->thresholds[0] > R(0.0) &&
         anhyst_rises_x(law->thresholds, (uint16_t)(law->cells - 1U), R(0.0), law->reach) &&
         rows_rise(law) && current_rises(parameters);
}

static void cells_keep(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                       const anhyst_memory_x *to, ANHYST_REAL *plays)
{
  const cell_path along = begin(parameters->cells, &from->cells, plays);
  if (from->cells.active * to->cells.active < R(0.0)) {
    for (uint16_t cell = 1; cell < along.active; cell++) {
      plays[cell - 1U] = facing(along.x - width(&along, cell), along.falling);
    }
  }
}

/* All cells come to rest where they are; under the other parameters they are clipped to widths of
   those, and what they give is summed up by the next step. */
static void cells_carry(const anhyst_parameters_x *before, anhyst_memory_x *memory,
                        ANHYST_REAL *plays)
{
  const anhyst_memory_x back = {{R(0.0), R(0.0), -memory->cells.active, R(0.0), R(0.0)}};
  cells_keep(before, memory, &back, plays);
  memory->cells.active = R(0.0);
  memory->cells.rest = R(0.0);
}

#if ANHYST_MEMORIES > 1
ANHYST_REAL anhyst_cells_stand_x(const anhyst_parameters_x *parameters,
                                 const anhyst_memory_x *memory, const ANHYST_REAL *plays,
                                 ANHYST_REAL *slope)
{
  const anhyst_cells_law_x *law = parameters->cells;
  const cell_path along = begin(law, &memory->cells, plays);
  const uint16_t segment = segment_of(&along, along.x);
  const ANHYST_REAL *row = row_of(law, along.active) + segment;
  const ANHYST_REAL width = node(&along, (uint16_t)(segment + 1U)) - node(&along, segment);
  *slope = width / (row[1] - row[0] + law->air * width);
  const ANHYST_REAL m = moving(&along, along.active, along.x) + along.rest;
  return facing(m + law->air * along.x, along.falling);
}
#endif

const anhyst_kernel_x anhyst_kernel_cells_x = {cells_field, cells_flux, cells_is_valid, cells_carry,
                                               cells_keep};

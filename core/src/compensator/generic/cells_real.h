/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the play-cell law in floating point, for generic/cells.h. cells_fixed.h describes
   the functions. Fields, plays and magnetisations are fractions on a grid of 2*NUMBER_EPS. Sums and
   differences of two of them are exact. Therefore, no errors accumulate in the sum of the cells at
   rest. */

typedef struct {
  number width; /* of a segment */
  number count; /* 1/width */
} grid;

/* A position on a table row. */
typedef struct {
  const entry *at; /* lower end of the segment */
  number part;     /* of the segment, 0..1 */
} spot;

#define GRID_STEP ((number)2 * NUMBER_EPS)
#define FIELD_MAX ((number)1 - GRID_STEP)
#define FIELD_MIN (GRID_STEP - (number)1)
#define WHOLE_SEGMENT ((number)1) /* as a part */

#define POWER_OF_HALF(n) ((number)1 / (number)(1L << (n)))

#define RESIDUAL_DEADBAND NUMBER_EPS

/* Rounds to the nearest multiple of GRID_STEP, which is the spacing of numbers in 2..4. Requires
   |a| < 1. */
static inline number round_to_grid(number a)
{
  const number shifted = a + (number)3;
  return shifted - (number)3;
}

static inline int integer_of(entry word) { return (int)word; }

/* Returns a, or -a for a mirror of -1. */
static inline number mirrored(number a, int mirror) { return mirror != 0 ? -a : a; }
static inline number clamped(number a, number low, number high) { return clamp(a, low, high); }
static inline int is_around_zero(number x, number half) { return x >= -half && x < half; }

/* Saturates to -1 .. 1; returns the lower end for NaN. */
static inline number saturate(number a) { return clamp(a, FIELD_MIN, FIELD_MAX); }
static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }
static inline number unsafe_sum(number a, number b) { return a + b; }
static inline number unsafe_difference(number a, number b) { return a - b; }
static inline number scaled(number a, entry weight) { return a * weight; }
static inline number quarter(number a) { return (number)0.25 * a; }
static inline number four_times(number a) { return (number)4 * a; }
static inline number word_value(entry word) { return round_to_grid(word); }

static inline number value_at(spot at)
{
  return round_to_grid(at.at[0] + at.part * (at.at[1] - at.at[0]));
}

static inline number between(spot position, const entry *other)
{
  const spot there = {other, position.part};
  return value_at(there) - value_at(position);
}

static inline grid grid_from_halvings(unsigned halvings)
{
  const number count = (number)(1L << halvings);
  const grid width = {(number)1 / count, count};
  return width;
}

static inline number width_of(grid width) { return width.width; }

static inline number segments_to_field(int segments, grid width)
{
  return (number)segments * width.width;
}

/* Rounds down to an integer. Requires |a| < 2^15. */
static inline int floor_of(number a)
{
  const int found = (int)a;
  return (number)found > a ? found - 1 : found;
}

static inline spot spot_from_zero(const entry *zero, number x, grid width)
{
  const number place = x * width.count;
  const int segment = floor_of(place);
  const spot at = {zero + segment, place - (number)segment};
  return at;
}

static inline number segment_begin(number x, grid width)
{
  return segments_to_field(floor_of(x * width.count), width);
}

static inline number part_at(number x, number begin, grid width)
{
  return (x - begin) * width.count;
}

/* Returns the field at a position on a segment, rounded down by up to 1.25 grid steps, so that it
   is below the upper end. */
static inline number field_at_part(number begin, grid width, number part)
{
  const number x = round_to_grid(begin + part * width.width - (number)0.75 * GRID_STEP);
  return x > begin ? x : begin;
}

static inline number limit_part(number part)
{
  return part < WHOLE_SEGMENT ? part : WHOLE_SEGMENT - NUMBER_EPS;
}

static inline number divide_to_part(number residual, number rise) { return residual / rise; }
static inline number rise_at_part(number rise, number part) { return rise * part; }

static inline int has_segment(const candidate *at)
{
  return at->of.cells.segment > 0 && at->of.cells.segment < MAX_BLOCK_WORDS &&
         at->of.cells.width > 0;
}

static inline grid candidate_grid(const candidate *at)
{
  const grid width = {at->of.cells.width, (number)1 / at->of.cells.width};
  return width;
}

static inline number candidate_begin(const candidate *at, number x)
{
  (void)x;
  return at->of.cells.begin;
}

static inline void set_segment(candidate *at, const entry *words, int segment, number begin,
                               grid width)
{
  at->of.cells.segment = segment;
  at->of.cells.begin = begin;
  at->of.cells.width = width.width;
  at->of.cells.rise = word_value(words[segment + 1]) - word_value(words[segment]);
}

static inline number quarter_rise(const candidate *at) { return quarter(at->of.cells.rise); }

static inline int is_rounding(number above, number below, grid width)
{
  (void)width;
  return above - below <= (number)4 * GRID_STEP;
}

/* Returns whether a flux is valid; 0 for NaN. */
static inline int is_flux_valid(number flux) { return flux > (number)-1 && flux < (number)1; }
static inline number inner_limit(const entry *words, int word) { return words[word]; }

#define MAX_ROW_DIFFERENCE ((number)1) /* maximum difference between two rows */
#define MIN_THRESHOLD GRID_STEP        /* smallest threshold of a cell */
/* Rounding error of a weight between two table entries. */
#define ARM_ROUNDING NUMBER_EPS
/* Minimum rise on a segment, larger than rounding errors. */
#define MIN_SEGMENT_RISE ((number)0.5 * NUMBER_EPS)
#define QUARTER_WEIGHT ((number)0.25)

#define TRANSFER_BISECTIONS 56

static inline int is_weight_positive(entry word) { return word > 0 && word <= (entry)0.5; }

static inline number interpolate_line(number low, number high, number numerator, number denominator)
{
  return low + (high - low) * (numerator / denominator);
}

/* Rounds to the nearest multiple of 2*GRID_STEP. Requires |a| < 2. */
static inline number round_to_coarse_grid(number a)
{
  const number shifted = a + (number)6;
  return shifted - (number)6;
}

#if ANHYST_MEMORIES > 1

#define MIN_SHARE ((number)0.001953125)

#define MIN_STIFFNESS ((number)1.52587890625e-5)
#define MAX_STIFFNESS ((number)32768)

static inline number read_own_slope(const entry *words)
{
  return four_times(words[ANHYST_WORD_SOLID_OWN]);
}
static inline number read_hold_slope(const entry *words) { return words[ANHYST_WORD_SOLID_HOLD]; }

static inline entry inner_share(entry surface, int layers)
{
  return ((entry)1 - surface) / (entry)layers;
}

static inline number multiply_by_share(number a, entry part) { return a * part; }
static inline number multiply_by_slope(number a, number slope) { return a * slope; }
static inline number own_field(number flux, number own) { return flux * own; }
static inline number divide_by_share(number a, entry share) { return a / share; }

static inline number law_stiffness(number width, number rise, number own)
{
  return clamp(quarter(width / rise) + own, MIN_STIFFNESS, MAX_STIFFNESS);
}

static inline number secant(number rise, number run)
{
  return clamp(rise / run, MIN_STIFFNESS, MAX_STIFFNESS);
}

/* Returns the field unchanged. In fixed point, large fields of a line are scaled down. */
static inline number to_coarse(number a) { return a; }
static inline number divide_slope_by_share(number stiff, entry share) { return stiff / share; }

static inline number slope_of_arm(entry field_arm, entry laminated)
{
  return (number)1 / (field_arm * ((entry)1 - laminated));
}

static inline number divide_weights(number numerator, number denominator)
{
  return numerator / denominator;
}

static inline number divide_slope_by_solid_part(number slope, entry laminated)
{
  return slope / ((number)1 - laminated);
}

static inline entry slope_share(number part, number other) { return part / (part + other); }

static inline int is_residual_small(number residual, number slope)
{
  return absolute(residual) <= NUMBER_EPS * ((number)256 + (number)16 * slope);
}

static inline number owed_flux(const entry *words, number residual, number most)
{
  return clamp(residual / words[ANHYST_WORD_SOLID_HOLD], -most, most);
}

/* Sets the arms of the equation own*f + x = field - falls*(f - flux), scaled to sizes of at most
   1/2. Returns its target, divided by 4. */
static inline number set_line(arms_type *arms, number field, number falls, number own, number flux)
{
  const number arm = falls + own;
  const number scale = (number)0.5 / ((number)1 + absolute(arm));
  arms->bias = 0;
  arms->flux_arm = scale * arm;
  arms->field_arm = scale;
  return quarter(scale * (field + falls * flux));
}

static inline int are_solid_words_valid(const entry *words)
{
  const entry hold = words[ANHYST_WORD_SOLID_HOLD];
  const entry own = words[ANHYST_WORD_SOLID_OWN];
  const entry surface = words[ANHYST_WORD_SOLID_SURFACE];
  const entry laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  return hold > 0 && hold <= (entry)16384 && own >= (entry)-0.5 && own <= 0 &&
         surface >= MIN_SHARE && surface <= (entry)1 - (entry)3 * MIN_SHARE && laminated >= 0 &&
         laminated < 1;
}
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the law of play cells in floating point, for generic/cells.h. Fields, plays and
   magnetisations are fractions on a grid of 2*NUMBER_EPS. Sums and differences of two of them are
   exact, so that nothing accumulates in the sum of the resting plays. */

typedef struct {
  number width; /* of a segment */
  number count; /* 1/width */
} grid;

/* A position in a table row. */
typedef struct {
  const entry *at; /* lower end of the segment */
  number part;     /* of the segment, 0..1 */
} spot;

#define GRID_STEP ((number)2 * NUMBER_EPS)
#define FIELD_MAX ((number)1 - GRID_STEP)
#define FIELD_MIN (GRID_STEP - (number)1)
#define WHOLE_SEGMENT ((number)1) /* as a part */

/* 2^-n */
#define POWER_OF_HALF(n) ((number)1 / (number)(1L << (n)))

/* A quarter of the largest residual that rounding alone can cause. */
#define RESIDUAL_DEADBAND NUMBER_EPS

/* The multiple of GRID_STEP nearest to a; |a| < 1. Numbers of 2..4 are that far apart. */
static inline number on_grid(number a)
{
  const number shifted = a + (number)3;
  return shifted - (number)3;
}

/* A word of a block that is an integer. */
static inline int integer_of(entry word) { return (int)word; }

/* a, or -a for a mirror of -1. */
static inline number mirrored(number a, int mirror) { return mirror != 0 ? -a : a; }

static inline number clamped(number a, number low, number high) { return within(a, low, high); }

/* Whether x is within -half .. half. */
static inline int is_around_zero(number x, number half) { return x >= -half && x < half; }

/* Saturates to -1 .. 1; the lower end for what is not a number. */
static inline number inside(number a) { return within(a, FIELD_MIN, FIELD_MAX); }

static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }
static inline number unsafe_sum(number a, number b) { return a + b; }
static inline number unsafe_difference(number a, number b) { return a - b; }

/* a times a weight. */
static inline number scaled(number a, entry weight) { return a * weight; }

static inline number quarter(number a) { return (number)0.25 * a; }
static inline number four_times(number a) { return (number)4 * a; }

/* The number of a word of a table. */
static inline number level_of(entry word) { return on_grid(word); }

static inline number value_at(spot at)
{
  return on_grid(at.at[0] + at.part * (at.at[1] - at.at[0]));
}

/* What one row has beyond another at the same position; they differ by less than 1. */
static inline number between(spot of, const entry *other)
{
  const spot there = {other, of.part};
  return value_at(there) - value_at(of);
}

/* Segments of this many halvings of 1.0. */
static inline grid grid_of(unsigned halvings)
{
  const number count = (number)(1L << halvings);
  const grid width = {(number)1 / count, count};
  return width;
}

static inline number width_of(grid width) { return width.width; }

/* The field at so many segments from zero. */
static inline number field_at(int segments, grid width) { return (number)segments * width.width; }

/* The largest integer that is not above a; |a| < 2^15. */
static inline int floor_of(number a)
{
  const int found = (int)a;
  return (number)found > a ? found - 1 : found;
}

/* The spot of a field on a row; the field 0 is at the pointer. */
static inline spot spot_from(const entry *zero, number x, grid width)
{
  const number place = x * width.count;
  const int segment = floor_of(place);
  const spot at = {zero + segment, place - (number)segment};
  return at;
}

/* Segments begin at multiples of their width. */
static inline number begin_of(number x, grid width)
{
  return field_at(floor_of(x * width.count), width);
}

/* The part of a segment before x, which lies on the segment. */
static inline number part_at(number x, number begin, grid width)
{
  return (x - begin) * width.count;
}

/* The field at a part of a segment, rounded down by up to 1.25 steps of the grid: before the end of
   the segment. */
static inline number place_in(number begin, grid width, number part)
{
  const number x = on_grid(begin + part * width.width - (number)0.75 * GRID_STEP);
  return x > begin ? x : begin;
}

/* The largest part below the whole segment, for a part that rounding made larger. */
static inline number inner_part(number part)
{
  return part < WHOLE_SEGMENT ? part : WHOLE_SEGMENT - NUMBER_EPS;
}

/* missing/rise; 0 <= missing < rise. */
static inline number ratio_part(number missing, number rise) { return missing / rise; }

/* The part of a rise that belongs to a part of its segment. */
static inline number rise_share(number rise, number part) { return rise * part; }

/* Where the segment of a candidate is, and how wide. */
static inline int is_placed(const candidate *at)
{
  return at->of.cells.segment > 0 && at->of.cells.segment < MAX_BLOCK_WORDS &&
         at->of.cells.width > 0;
}

static inline grid grid_at(const candidate *at)
{
  const grid width = {at->of.cells.width, (number)1 / at->of.cells.width};
  return width;
}

static inline number begin_at(const candidate *at, number x)
{
  (void)x;
  return at->of.cells.begin;
}

/* Sets the segment of a candidate: its word in the block, where it begins, its width, its rise. */
static inline void set_segment(candidate *at, const entry *words, int segment, number begin,
                               grid width)
{
  at->of.cells.segment = segment;
  at->of.cells.begin = begin;
  at->of.cells.width = width.width;
  at->of.cells.rise = level_of(words[segment + 1]) - level_of(words[segment]);
}

/* A quarter of what the row rises on the segment of a candidate. */
static inline number quarter_rise(const candidate *at) { return quarter(at->of.cells.rise); }

/* Whether a field is below another by no more than rounding. */
static inline int is_rounding(number above, number below, grid width)
{
  (void)width;
  return above - below <= (number)4 * GRID_STEP;
}

/* Whether a flux can be one; false for what is not a number. */
static inline int is_flux(number flux) { return flux > (number)-1 && flux < (number)1; }

/* A limit of the current. */
static inline number inner_limit(const entry *words, int word) { return words[word]; }

/* Parameter blocks. */

#define LEVEL_MAX ((number)1)               /* largest difference of two rows */
#define THRESHOLD_MIN GRID_STEP             /* smallest half-width of a play */
#define ARM_ROUNDING NUMBER_EPS             /* of a weight between two entries */
#define RISE_MIN ((number)0.5 * NUMBER_EPS) /* on a segment, more than rounding */
#define QUARTER_WEIGHT ((number)0.25)

/* Bisections of the transfer. */
#define CARRY_HALVINGS 56

static inline int is_weight_positive(entry word) { return word > 0 && word <= (entry)0.5; }

/* The point of a line from low to high at a part numerator/denominator. */
static inline number on_line(number low, number high, number numerator, number denominator)
{
  return low + (high - low) * (numerator / denominator);
}

/* The multiple of 2*GRID_STEP nearest to a; |a| < 2. */
static inline number on_coarse_grid(number a)
{
  const number shifted = a + (number)6;
  return shifted - (number)6;
}

#if ANHYST_MEMORIES > 1
/* Solid iron. */

/* Smallest share of a layer in the section. */
#define SHARE_MIN ((number)0.001953125)

/* Range of the slope of a segment. */
#define STIFFNESS_MIN ((number)1.52587890625e-5)
#define STIFFNESS_MAX ((number)32768)

static inline number own_of(const entry *words) { return four_times(words[ANHYST_WORD_SOLID_OWN]); }
static inline number hold_of(const entry *words) { return words[ANHYST_WORD_SOLID_HOLD]; }

/* The share of each of the inner layers. */
static inline entry inner_share(entry surface, int layers)
{
  return ((entry)1 - surface) / (entry)layers;
}

static inline number shared(number a, entry part) { return a * part; }
static inline number sloped(number a, number slope) { return a * slope; }
static inline number own_field(number flux, number own) { return flux * own; }
static inline number whole_of(number a, entry share) { return a / share; }

/* The slope of a segment with this rise, over 4, and the field of its own. */
static inline number law_stiffness(number width, number rise, number own)
{
  return within(quarter(width / rise) + own, STIFFNESS_MIN, STIFFNESS_MAX);
}

/* The slope between two positions; `run` is not 0. */
static inline number secant(number rise, number run)
{
  return within(rise / run, STIFFNESS_MIN, STIFFNESS_MAX);
}

/* Fixed point needs room for the large fields of a line. */
static inline number coarse(number a) { return a; }

static inline number per_share(number stiff, entry share) { return stiff / share; }

/* 1 over the field arm without the laminated part. */
static inline number slope_of_arm(entry field_arm, entry laminated)
{
  return (number)1 / (field_arm * ((entry)1 - laminated));
}

static inline number ratio(number numerator, number denominator) { return numerator / denominator; }

/* A slope divided by the part of the path that is not laminated. */
static inline number per_solid(number slope, entry laminated)
{
  return slope / ((number)1 - laminated);
}

/* The part of a slope in the sum of two. */
static inline entry part_of_slopes(number part, number other) { return part / (part + other); }

/* Whether the residual of an equation, a field, is no more than rounding and that of a flux. */
static inline int is_residual_small(number residual, number slope)
{
  return size_of(residual) <= NUMBER_EPS * ((number)256 + (number)16 * slope);
}

/* The flux that a residual leaves to a layer and deeper, limited. */
static inline number owed_flux(const entry *words, number residual, number most)
{
  return within(residual / words[ANHYST_WORD_SOLID_HOLD], -most, most);
}

/* Sets the arms of the equation own*f + x = field - falls*(f - flux), scaled below 1/2; returns its
   target, over 4. */
static inline number set_line(arms_type *arms, number field, number falls, number own, number flux)
{
  const number arm = falls + own;
  const number scale = (number)0.5 / ((number)1 + size_of(arm));
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
         surface >= SHARE_MIN && surface <= (entry)1 - (entry)3 * SHARE_MIN && laminated >= 0 &&
         laminated < 1;
}
#endif

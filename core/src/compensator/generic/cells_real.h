/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the play-cell law in floating point, for generic/cells.h. cells_fixed.h describes
   the functions. Fields, plays and magnetisations are fractions on a grid of 2*NUMBER_EPS. The sum
   or difference of two such fractions is exact: the sum of the cells at rest does not drift. */

typedef struct {
  number width; /* width of a segment */
  number count; /* 1/width */
} segment_grid;

/* Position in a table row. */
typedef struct {
  const entry *segment; /* lower end of the segment */
  number fraction;      /* position within the segment, 0..1 */
} table_position;

#define NUMBER_STEP ((number)2 * NUMBER_EPS)
#define MAX_FIELD ((number)1 - NUMBER_STEP)
#define MIN_FIELD (NUMBER_STEP - (number)1)
#define WHOLE_SEGMENT ((number)1) /* 1.0 as a fraction of a segment */

#define POWER_OF_HALF(n) ((number)1 / (number)(1L << (n)))

#define RESIDUAL_DEADBAND NUMBER_EPS

/* Rounds to a multiple of NUMBER_STEP, the spacing of numbers in 2..4. Requires |a| < 1. */
static inline number round_to_grid(number a)
{
  const number shifted = a + (number)3;
  return shifted - (number)3;
}

static inline int integer_of(entry word) { return (int)word; }

/* Returns a if mirror is 0, and -a if mirror is -1. */
static inline number mirrored(number a, int mirror) { return mirror != 0 ? -a : a; }
static inline number clamped(number a, number low, number high) { return clamp(a, low, high); }
static inline int is_around_zero(number x, number half) { return x >= -half && x < half; }

/* Limits a number to -1..1. Returns the lower limit for NaN. */
static inline number saturate(number a) { return clamp(a, MIN_FIELD, MAX_FIELD); }
static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }
static inline number unsafe_sum(number a, number b) { return a + b; }
static inline number unsafe_difference(number a, number b) { return a - b; }
static inline number scaled(number a, entry weight) { return a * weight; }
static inline number quarter(number a) { return (number)0.25 * a; }
static inline number four_times(number a) { return (number)4 * a; }
static inline number word_value(entry word) { return round_to_grid(word); }

static inline number row_value(table_position position)
{
  return round_to_grid(position.segment[0] +
                       position.fraction * (position.segment[1] - position.segment[0]));
}

static inline number row_difference(table_position position, const entry *other)
{
  const table_position other_position = {other, position.fraction};
  return row_value(other_position) - row_value(position);
}

static inline segment_grid grid_from_halvings(unsigned halvings)
{
  const number count = (number)(1L << halvings);
  const segment_grid width = {(number)1 / count, count};
  return width;
}

static inline number width_of(segment_grid width) { return width.width; }

static inline number segments_to_field(int segments, segment_grid width)
{
  return (number)segments * width.width;
}

/* Rounds down to an integer. Requires |a| < 2^15. */
static inline int floor_to_int(number a)
{
  const int found = (int)a;
  return (number)found > a ? found - 1 : found;
}

static inline table_position locate_from_zero(const entry *zero, number x, segment_grid width)
{
  const number scaled_field = x * width.count;
  const int segment = floor_to_int(scaled_field);
  const table_position position = {zero + segment, scaled_field - (number)segment};
  return position;
}

static inline number segment_begin(number x, segment_grid width)
{
  return segments_to_field(floor_to_int(x * width.count), width);
}

static inline number fraction_at(number x, number begin, segment_grid width)
{
  return (x - begin) * width.count;
}

/* Returns the field at a fraction of a segment, up to 1.25 steps too low, below the upper end. */
static inline number field_at_fraction(number begin, segment_grid width, number fraction)
{
  const number x = round_to_grid(begin + fraction * width.width - (number)0.75 * NUMBER_STEP);
  return x > begin ? x : begin;
}

static inline number limit_fraction(number fraction)
{
  return fraction < WHOLE_SEGMENT ? fraction : WHOLE_SEGMENT - NUMBER_EPS;
}

static inline number divide_to_fraction(number residual, number rise) { return residual / rise; }
static inline number multiply_rise(number rise, number fraction) { return rise * fraction; }

static inline int has_segment(const candidate *at)
{
  return at->of.cells.segment > 0 && at->of.cells.segment < MAX_BLOCK_WORDS &&
         at->of.cells.width > 0;
}

static inline segment_grid trial_grid(const candidate *trial)
{
  const segment_grid width = {trial->of.cells.width, (number)1 / trial->of.cells.width};
  return width;
}

static inline number trial_lower_end(const candidate *trial, number x)
{
  (void)x;
  return trial->of.cells.begin_field;
}

static inline void set_segment(candidate *trial, const entry *words, int segment, number begin,
                               segment_grid width)
{
  trial->of.cells.segment = segment;
  trial->of.cells.begin_field = begin;
  trial->of.cells.width = width.width;
  trial->of.cells.row_rise = word_value(words[segment + 1]) - word_value(words[segment]);
}

static inline number quarter_rise(const candidate *at) { return quarter(at->of.cells.row_rise); }

static inline int is_rounding_error(number above, number below, segment_grid width)
{
  (void)width;
  return above - below <= (number)4 * NUMBER_STEP;
}

/* Returns whether a flux is in -1..1. Returns 0 for NaN. */
static inline int is_flux_valid(number flux) { return flux > (number)-1 && flux < (number)1; }
static inline number internal_current_limit(const entry *words, int word) { return words[word]; }

#define MAX_ROW_DIFFERENCE ((number)1) /* maximum difference of two rows */
#define MIN_THRESHOLD NUMBER_STEP      /* smallest threshold of a play cell */
/* Rounding error of a weight that is interpolated between two table entries. */
#define WEIGHT_ROUNDING NUMBER_EPS
/* Smallest rise of a weighted sum over a segment that is not a rounding error. */
#define MIN_SEGMENT_RISE ((number)0.5 * NUMBER_EPS)
#define QUARTER_WEIGHT ((number)0.25)

#define TRANSFER_BISECTIONS 56

static inline int is_weight_positive(entry word) { return word > 0 && word <= (entry)0.5; }

static inline number interpolate_line(number low, number high, number numerator, number denominator)
{
  return low + (high - low) * (numerator / denominator);
}

/* Rounds to the nearest multiple of 2*NUMBER_STEP. Requires |a| < 2. */
static inline number round_to_coarse_grid(number a)
{
  const number shifted = a + (number)6;
  return shifted - (number)6;
}

#if ANHYST_MEMORIES > 1

#define MIN_AREA_FRACTION ((number)0.001953125)

#define MIN_FIELD_SLOPE ((number)1.52587890625e-5)
#define MAX_FIELD_SLOPE ((number)32768)

static inline number read_coupling_slope(const entry *words)
{
  return four_times(words[ANHYST_WORD_SOLID_OWN]);
}
static inline number read_diffusion_slope(const entry *words)
{
  return words[ANHYST_WORD_SOLID_HOLD];
}

static inline entry complement(entry f) { return (entry)1 - f; }
static inline number at_least_one_lsb(number slope) { return slope; }

static inline number times_fraction(number a, entry f) { return a * f; }
static inline number multiply_by_slope(number a, number slope) { return a * slope; }
static inline number coupling_field(number flux, number slope) { return flux * slope; }
static inline number divide_by_fraction(number a, entry fraction) { return a / fraction; }

static inline number segment_field_slope(number width, number rise, number coupling_slope)
{
  return clamp(quarter(width / rise) + coupling_slope, MIN_FIELD_SLOPE, MAX_FIELD_SLOPE);
}

static inline number secant_slope(number rise, number run)
{
  return clamp(rise / run, MIN_FIELD_SLOPE, MAX_FIELD_SLOPE);
}

/* Returns the field unchanged, because only fixed point needs a smaller scale. */
static inline number to_coarse_field(number a) { return a; }
static inline number divide_slope(number slope, entry fraction) { return slope / fraction; }

static inline number field_slope_of_current(entry field_arm, entry laminated)
{
  return (number)1 / (field_arm * ((entry)1 - laminated));
}

static inline number divide_weights(number numerator, number denominator)
{
  return numerator / denominator;
}

static inline number divide_slope_by_solid(number slope, entry laminated)
{
  return slope / ((number)1 - laminated);
}

static inline entry slope_fraction(number slope, number other) { return slope / (slope + other); }

static inline int is_residual_small(number residual, number slope)
{
  return absolute(residual) <= NUMBER_EPS * ((number)256 + (number)16 * slope);
}

static inline number outstanding_flux(number diffusion_slope, number residual, number most)
{
  return clamp(residual / diffusion_slope, -most, most);
}

/* Sets the coefficients of the equation coupling_slope*f + x = field - line_slope*(f - flux),
   scaled to at most 1/2 in size. Returns the target of the equation, divided by 4. */
static inline number set_load_line(arms_type *arms, number field, number line_slope,
                                   number coupling_slope, number flux)
{
  const number arm = line_slope + coupling_slope;
  const number scale = (number)0.5 / ((number)1 + absolute(arm));
  arms->bias = 0;
  arms->flux_arm = scale * arm;
  arms->field_arm = scale;
  return quarter(scale * (field + line_slope * flux));
}

static inline int are_solid_words_valid(const entry *words)
{
  const entry hold = words[ANHYST_WORD_SOLID_HOLD];
  const entry own = words[ANHYST_WORD_SOLID_OWN];
  const entry laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  return hold > 0 && hold <= (entry)16384 && own >= (entry)-0.5 && own <= 0 && laminated >= 0 &&
         laminated < 1;
}
#endif

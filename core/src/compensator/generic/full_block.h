/* SPDX-License-Identifier: Apache-2.0 */
/* Template: what the law of Jiles and Atherton requires of a block, and how a memory is brought
   from one block to another; for full.h. */

/* The largest slope of m in valid tables, as it may have been before their entries were rounded,
   which makes a segment steeper by up to TABLE_ROUNDING. No path is steeper than the ascending
   branch and the anhysteretic curve together. */
static slope steepest_slope(const entry *words)
{
  const table curve = curve_of(words);
  const int32_t segments = (int32_t)1 << (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const entry *rising_half = words + (int32_t)words[ANHYST_WORD_FULL_BRANCH] + segments;
  slope most = 0;
  for (int32_t i = 0; i < segments; i++) {
    const number y_rise = (number)rising_half[i + 1] - rising_half[i] - TABLE_ROUNDING;
    const number x_rise = (number)curve.at[i + 1] - curve.at[i] - TABLE_ROUNDING;
    const slope found =
        mixed_slope(slope_of(curve, y_rise > 0 ? y_rise : 0),
                    slope_of(curve, x_rise > 0 ? x_rise : 0), words[ANHYST_WORD_FULL_REVERSIBLE]);
    most = found > most ? found : most;
  }
  return most;
}

/* Whether more field needs more current at every gap: field_arm + flux_arm*(h + slope of m) is
   above zero by more than rounding between two entries of the tables over the gap can remove. */
static int does_current_rise(const entry *words)
{
  const int32_t gaps = (int32_t)1 << (uint16_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const entry *flux_arm = words + (int32_t)words[ANHYST_WORD_GAP_FLUX_ARM];
  const entry *field_arm = words + (int32_t)words[ANHYST_WORD_GAP_FIELD_ARM];
  const entry air = words[ANHYST_WORD_FULL_AIR];
  const slope steepest = steepest_slope(words);
  const number margin = sum_rounding(air, steepest);
  for (int32_t i = 0; i <= gaps; i++) {
    const number sum = air_sum(air, flux_arm[i], field_arm[i]);
    if (flux_arm[i] < 0 && !(slope_of_sum(sum, flux_arm[i], steepest) > margin)) {
      return 0;
    }
  }
  return 1;
}

static int is_valid(const entry *words)
{
  const entry n = words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const entry n_inverse = words[ANHYST_WORD_FULL_INVERSE_SEGMENTS];
  if (!is_integer(n, 3, MAX_SEGMENTS_EXPONENT) ||
      !is_integer(n_inverse, 3, MAX_SEGMENTS_EXPONENT)) {
    return 0;
  }
  const int32_t segments = (int32_t)1 << (uint16_t)n;
  const int32_t inverse_segments = (int32_t)1 << (uint16_t)n_inverse;
  return is_in_range(words[ANHYST_WORD_FULL_AIR], MIN_WEIGHT, MAX_ENTRY) &&
         is_in_range(words[ANHYST_WORD_FULL_REVERSIBLE], 0, ENTRY_ONE) &&
         is_in_range(words[ANHYST_WORD_FULL_PLAY], 0, ENTRY_ONE) &&
         is_in_range(words[ANHYST_WORD_FULL_RATE], MIN_WEIGHT, MAX_ENTRY) &&
         is_integer(words[ANHYST_WORD_FULL_RATE_SHIFT], 0, MAX_RATE_SHIFT) &&
         is_in_range(words[ANHYST_WORD_FULL_STEEPNESS], MIN_WEIGHT, MAX_ENTRY) &&
         is_integer(words[ANHYST_WORD_FULL_ITERATIONS], 2, 16) &&
         is_single(words, ANHYST_WORD_UNIT_FIELD) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_CURVE], segments + 1, 0,
                         max_rise((uint16_t)n)) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_BRANCH], 2 * segments + 1, -ENTRY_ONE,
                         max_rise((uint16_t)n)) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_INVERSE], inverse_segments + 1, 0,
                         ENTRY_ONE) &&
         does_current_rise(words);
}

/* A memory of another block. */
typedef struct {
  number x;
  number p;
  number equal_field; /* field at which the anhysteretic is y */
  number rest;        /* of y, by which the tables miss that */
} carried;

/* A field within the tables. */
static inline number within_tables(number x) { return clamped(x, -MAX_FIELD, MAX_FIELD); }

/* Moves a memory along the field and takes it for the start of a path. Returns the residual of
   h*x + m = flux there, over 4, which rises with the shift. */
static number carried_to(path *along, const entry *words, const carried *from, number shift,
                         number flux)
{
  number rise;
  along->x = within_tables(from->x + shift);
  along->p =
      clamped(within_tables(from->p + shift), along->x - along->play, along->x + along->play);
  const number pull = odd_value(curve_of(words), within_tables(from->equal_field + shift), &rise);
  along->y = within_tables(pull + from->rest);
  const number m = magnetisation(along->y, odd_value(curve_of(words), along->x, &rise),
                                 words[ANHYST_WORD_FULL_REVERSIBLE]);
  return scaled(along->x, words[ANHYST_WORD_FULL_AIR]) + scaled(m, QUARTER) -
         scaled(to_inner(flux), QUARTER);
}

/* The iron keeps its distance from the anhysteretic, in field, and so does its play. All move along
   the field to where they give the flux under the new block. The play turns here: a path that began
   under another law does not lead here under this one. */
static void carry(compensator *c, const entry *words, number flux)
{
  const entry *before = c->words;
  full_memory *memory = &c->memory.full;
  path along;
  carried from;
  number rise;
  begin(&along, before, memory, mirror_of(0));
  const number equal_field = odd_value(inverse_of(before), along.y, &rise);
  from.rest = along.y - odd_value(curve_of(before), equal_field, &rise);
  from.x = within_tables(convert_unit(along.x, before, words, ANHYST_WORD_UNIT_FIELD));
  from.p = within_tables(convert_unit(along.p, before, words, ANHYST_WORD_UNIT_FIELD));
  from.equal_field =
      within_tables(convert_unit(equal_field, before, words, ANHYST_WORD_UNIT_FIELD));
  begin(&along, words, memory, mirror_of(0));
  number low = -2 * UNIT;
  number high = 2 * UNIT;
  for (int16_t i = 0; i < BISECTIONS; i++) {
    const number middle = half_of(low + high);
    if (carried_to(&along, words, &from, middle, flux) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  memory->x = to_memory(along.x);
  memory->y = to_memory(along.y);
  memory->p = to_memory(along.p);
  memory->turn = memory->p;
  memory->level = memory->y;
}

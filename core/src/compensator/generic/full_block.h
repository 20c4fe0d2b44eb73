/* SPDX-License-Identifier: Apache-2.0 */
/* Template for full.h: checks of a block for the Jiles-Atherton law, and transfer of a state. */

/* Returns the largest slope of m over the field, which is the slope of the ascending branch and the
   anhysteretic curve together. Subtracts SEGMENT_RISE_ROUNDING from each rise, because the rounding
   of two entries can make a segment steeper by this amount. */
static slope steepest_slope(const entry *words)
{
  const table curve = curve_table(words);
  const int32_t segments = (int32_t)1 << (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const entry *rising_half = words + (int32_t)words[ANHYST_WORD_FULL_BRANCH] + segments;
  slope max_slope = 0;
  for (int32_t i = 0; i < segments; i++) {
    const number y_rise = (number)rising_half[i + 1] - rising_half[i] - SEGMENT_RISE_ROUNDING;
    const number x_rise = (number)curve.entries[i + 1] - curve.entries[i] - SEGMENT_RISE_ROUNDING;
    const slope found = total_m_slope(curve_slope(curve, y_rise > 0 ? y_rise : 0),
                                      curve_slope(curve, x_rise > 0 ? x_rise : 0),
                                      words[ANHYST_WORD_FULL_REVERSIBLE]);
    max_slope = found > max_slope ? found : max_slope;
  }
  return max_slope;
}

/* Returns whether the current rises with the field at every gap: field_arm + flux_arm*(h + slope of
   m) exceeds zero by more than the rounding errors between two entries of the gap tables. */
static int does_current_rise_with_field(const entry *words)
{
  const int32_t gaps = (int32_t)1 << (uint16_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const entry *flux_arm = words + (int32_t)words[ANHYST_WORD_GAP_FLUX_ARM];
  const entry *field_arm = words + (int32_t)words[ANHYST_WORD_GAP_FIELD_ARM];
  const entry air = words[ANHYST_WORD_FULL_AIR];
  const slope steepest = steepest_slope(words);
  const number margin = slope_rounding_error(air, steepest);
  for (int32_t i = 0; i <= gaps; i++) {
    const number sum = air_weight(air, flux_arm[i], field_arm[i]);
    if (flux_arm[i] < 0 && !(weighted_slope(sum, flux_arm[i], steepest) > margin)) {
      return 0;
    }
  }
  return 1;
}

static int is_block_valid(const entry *words)
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
         is_single_float(words, ANHYST_WORD_UNIT_FIELD) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_CURVE], segments + 1, 0,
                         max_segment_rise((uint16_t)n)) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_BRANCH], 2 * segments + 1, -ENTRY_ONE,
                         max_segment_rise((uint16_t)n)) &&
         is_table_rising(words, words[ANHYST_WORD_FULL_INVERSE], inverse_segments + 1, 0,
                         ENTRY_ONE) &&
         does_current_rise_with_field(words);
}

/* State under the old block, with fields in the unit of the new block. */
typedef struct {
  number x;
  number p;
  number anhysteretic_field; /* field at which the anhysteretic curve equals y */
  number inverse_error;      /* table error: y minus the curve at this field */
} old_state;

static inline number limit_to_tables(number x) { return clamped(x, -MAX_FIELD, MAX_FIELD); }

/* Shifts a state along the field axis and sets it as the start of a path. Returns the residual of
   h*x + m = flux, divided by 4. The residual rises with the shift. */
static number shift_state(branch_path *path, const entry *words, const old_state *from,
                          number shift, number flux)
{
  number rise;
  path->x = limit_to_tables(from->x + shift);
  path->p = clamped(limit_to_tables(from->p + shift), path->x - path->threshold,
                    path->x + path->threshold);
  const number anhysteretic_m =
      interpolate_odd(curve_table(words), limit_to_tables(from->anhysteretic_field + shift), &rise);
  path->y = limit_to_tables(anhysteretic_m + from->inverse_error);
  const number m = total_m(path->y, interpolate_odd(curve_table(words), path->x, &rise),
                           words[ANHYST_WORD_FULL_REVERSIBLE]);
  return scaled(path->x, words[ANHYST_WORD_FULL_AIR]) + scaled(m, QUARTER_WEIGHT) -
         scaled(to_internal(flux), QUARTER_WEIGHT);
}

/* Transfers the state to another block. The field, the play and the field at which the anhysteretic
   curve equals y are shifted by the same amount, until the iron has the given flux under the new
   block. The play reverses here, because the old path would not lead here under the new law. */
static void transfer_state(compensator *c, const entry *words, number flux)
{
  const entry *old_words = c->words;
  full_memory *memory = &c->memory.full;
  branch_path path;
  old_state from;
  number rise;
  init_branch_path(&path, old_words, memory, mirror_sign(0));
  const number anhysteretic_field = interpolate_odd(inverse_table(old_words), path.y, &rise);
  from.inverse_error = path.y - interpolate_odd(curve_table(old_words), anhysteretic_field, &rise);
  from.x = limit_to_tables(convert_unit(path.x, old_words, words, ANHYST_WORD_UNIT_FIELD));
  from.p = limit_to_tables(convert_unit(path.p, old_words, words, ANHYST_WORD_UNIT_FIELD));
  from.anhysteretic_field =
      limit_to_tables(convert_unit(anhysteretic_field, old_words, words, ANHYST_WORD_UNIT_FIELD));
  init_branch_path(&path, words, memory, mirror_sign(0));
  number low = -2 * ONE;
  number high = 2 * ONE;
  for (int16_t i = 0; i < TRANSFER_BISECTIONS; i++) {
    const number middle = half(low + high);
    if (shift_state(&path, words, &from, middle, flux) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  memory->x = to_stored(path.x);
  memory->y = to_stored(path.y);
  memory->p = to_stored(path.p);
  memory->reversal_play = memory->p;
  memory->reversal_y = memory->y;
}

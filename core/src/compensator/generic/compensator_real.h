/* SPDX-License-Identifier: Apache-2.0 */
/* Operations of a floating-point compensator, for compensator.h. Signals are in the units of the
   model. Internally, demand and current are fractions of full scale. */

/* Tolerance of a signal beyond a limit: 2^-15 of full scale. */
#define SIGNAL_TOLERANCE ((number)3.0517578125e-5)
#define DEMAND_TOLERANCE SIGNAL_TOLERANCE
#define CURRENT_TOLERANCE SIGNAL_TOLERANCE
/* Largest current for which a flux is computed, as a fraction of full scale. */
#define MAX_CURRENT ((number)2)

typedef struct {
  const entry *words; /* block words, advanced by the index of the segment */
  number fraction;    /* position within the segment, 0..1 */
} gap_position;

static number current_in_units(const compensator *c)
{
  return c->current * c->words[ANHYST_WORD_SCALE_CURRENT];
}

static void read_scales(compensator *c)
{
  const entry *words = c->words;
  const number range = words[ANHYST_WORD_SCALE_GAP_HIGH] - words[ANHYST_WORD_SCALE_GAP_LOW];
  c->per_demand = (number)1 / words[ANHYST_WORD_SCALE_DEMAND];
  c->per_current = (number)1 / words[ANHYST_WORD_SCALE_CURRENT];
  c->per_gap = range > (number)0 ? (number)1 / range : (number)0;
}

/* Returns a gap as a fraction of its range. Returns 0 if nothing depends on the gap. */
static number gap_fraction(const compensator *c, number gap)
{
  return (gap - c->words[ANHYST_WORD_SCALE_GAP_LOW]) * c->per_gap;
}

static int is_in_gap_range(number fraction)
{
  return fraction >= -SIGNAL_TOLERANCE && fraction <= (number)1 + SIGNAL_TOLERANCE;
}

static gap_position locate_gap(const entry *words, number fraction)
{
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const number position = clamp(fraction, (number)0, (number)1) * (number)segments;
  const int32_t index = position < (number)segments ? (int32_t)position : segments - 1;
  const gap_position found = {words + index, position - (number)index};
  return found;
}

static number interpolate_over_gap(gap_position position, entry first)
{
  const entry *entry_below = position.words + (int32_t)first;
  return entry_below[0] + (entry_below[1] - entry_below[0]) * position.fraction;
}

static number bias_from_table(number over_gap) { return over_gap; }
static number limit_bias(number bias) { return bias; }
static number add_coefficients(number a, number b) { return a + b; }
static number multiply(number a, number weight) { return a * weight; }
static number multiply_fraction(number a, number fraction) { return a * fraction; }
static number add(number a, number b) { return a + b; }
static number subtract(number a, number b) { return a - b; }
static number word_to_signal(number word) { return word; }

/* Returns whether |a| is at most 3e38. Returns 0 for NaN. */
static int is_finite(number a) { return absolute(a) <= (number)3e38; }

/* Returns the square root of a non-negative number, usually in 0..1. Below the knee, at
   2^(-2*knee), the function is linear. From the knee to 1, the relative error is below 1 ulp in
   single precision and 1e-14 in double precision. */
static number root_with_knee(number a, int32_t knee)
{
  const number steepness = (number)((int32_t)1 << knee);
  number scale = (number)0.5;
  if (a * steepness * steepness < (number)1) {
    return a * steepness;
  }
  /* Scales a to 1/4..1 by even powers of two, which is exact. The smallest knee is 2^-16. */
  if (a < (number)0.00390625) {
    a *= (number)256;
    scale *= (number)0.0625;
  }
  if (a < (number)0.0625) {
    a *= (number)16;
    scale *= (number)0.25;
  }
  if (a < (number)0.25) {
    a *= (number)4;
    scale *= (number)0.5;
  }
  /* The linear start value is within 3 %. Each Newton step doubles the number of correct digits. */
  number r = (number)0.686 * a + (number)0.343;
  r = (number)0.5 * (r + a / r);
  r = (number)0.5 * (r + a / r);
  return scale * (r + a / r);
}

static number output_to_flux(const entry *words, number above_offset, gap_position position)
{
  number relative_flux = above_offset;
  if (words[ANHYST_WORD_POWER] == (entry)2) {
    relative_flux = root_with_knee(above_offset > (number)0 ? above_offset : (number)0,
                                   (int32_t)words[ANHYST_WORD_ROOT_KNEE]);
  }
  return relative_flux * interpolate_over_gap(position, words[ANHYST_WORD_GAP_GAIN]);
}

static number flux_limit(const entry *words) { return words[ANHYST_WORD_FLUX_LIMIT]; }
static number limit_flux(number flux) { return clamp(flux, (number)-1, (number)1); }

static number to_internal_flux(const entry *words, number flux)
{
  (void)words;
  return flux;
}

static number flux_to_output(const entry *words, number flux, gap_position position)
{
  const number relative_flux = flux / interpolate_over_gap(position, words[ANHYST_WORD_GAP_GAIN]);
  if (words[ANHYST_WORD_POWER] == (entry)1) {
    return relative_flux;
  }
  const number flux_size = absolute(relative_flux);
  const number steepness = (number)((int32_t)1 << (int32_t)words[ANHYST_WORD_ROOT_KNEE]);
  return flux_size * steepness < (number)1 ? flux_size / steepness : flux_size * flux_size;
}

static number current_limit(const entry *words, int16_t word) { return words[word]; }

/* Convert the internal current to the result of a solve, and back. */
static number to_external_current(const entry *words, number current)
{
  (void)words;
  return current;
}

static number to_internal_current(const entry *words, number current)
{
  (void)words;
  return clamp(current, -MAX_CURRENT, MAX_CURRENT);
}

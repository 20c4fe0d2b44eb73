/* SPDX-License-Identifier: Apache-2.0 */
/* Operations of a floating-point compensator, for compensator.h. Signals are in the units of the
   model; inside, demand and current are fractions of full scale. */

#define FRACTION_CODE ((number)3.0517578125e-5) /* 2^-15: what a signal may pass a limit by */
#define DEMAND_CODE FRACTION_CODE
#define CURRENT_CODE FRACTION_CODE
#define CURRENT_MOST ((number)2) /* the largest current whose flux is searched, of full scale */

/* Where a gap falls in the tables over the gap. */
typedef struct {
  const entry *words; /* of the block, moved on to the segment */
  number part;        /* of the segment, 0..1 */
} place;

static number current_in_units(const compensator *c)
{
  return c->current * c->words[ANHYST_WORD_SCALE_CURRENT];
}

/* Finds the reciprocals of the scales of the block in use. */
static void take_scales(compensator *c)
{
  const entry *words = c->words;
  const number range = words[ANHYST_WORD_SCALE_GAP_HIGH] - words[ANHYST_WORD_SCALE_GAP_LOW];
  c->per_demand = (number)1 / words[ANHYST_WORD_SCALE_DEMAND];
  c->per_current = (number)1 / words[ANHYST_WORD_SCALE_CURRENT];
  c->per_gap = range > (number)0 ? (number)1 / range : (number)0;
}

/* A gap as a fraction of its range; 0 if nothing depends on the gap. */
static number gap_fraction(const compensator *c, number gap)
{
  return (gap - c->words[ANHYST_WORD_SCALE_GAP_LOW]) * c->per_gap;
}

static int is_in_gap_range(number fraction)
{
  return fraction >= -FRACTION_CODE && fraction <= (number)1 + FRACTION_CODE;
}

static place place_of(const entry *words, number fraction)
{
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const number at = within(fraction, (number)0, (number)1) * (number)segments;
  const int32_t index = at < (number)segments ? (int32_t)at : segments - 1;
  const place found = {words + index, at - (number)index};
  return found;
}

static number over_gap(place at, entry first)
{
  const entry *found = at.words + (int32_t)first;
  return found[0] + (found[1] - found[0]) * at.part;
}

static number bias_of(number over_gap) { return over_gap; }

static number bias_within(number bias) { return bias; }

static number arm_sum(number a, number b) { return a + b; }

static number product(number a, number weight) { return a * weight; }

static number sum_of(number a, number b) { return a + b; }

static number difference_of(number a, number b) { return a - b; }

static number signal_of(number word) { return word; }

/* Whether a is a number of at most 3e38. */
static int is_finite(number a) { return size_of(a) <= (number)3e38; }

/* Root of a number that is not negative, meant for 0..1. Below the knee, 2^(-2*knee), a straight
   line; from there to 1 a relative error below one unit in the last place of a float and 1e-14 in
   double precision. */
static number root(number a, int32_t knee)
{
  const number steepness = (number)((int32_t)1 << knee);
  number scale = (number)0.5;
  if (a * steepness * steepness < (number)1) {
    return a * steepness;
  }
  /* Into 1/4..1 by even powers of two, which are exact; the least knee is 2^-16. */
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
  /* A line within 3 % to begin with; each step doubles the digits. */
  number r = (number)0.686 * a + (number)0.343;
  r = (number)0.5 * (r + a / r);
  r = (number)0.5 * (r + a / r);
  return scale * (r + a / r);
}

/* What an output by this much beyond the offset needs as a flux. */
static number flux_for(const entry *words, number beyond, place at)
{
  number part = beyond;
  if (words[ANHYST_WORD_POWER] == (entry)2) {
    part = root(beyond > (number)0 ? beyond : (number)0, (int32_t)words[ANHYST_WORD_ROOT_KNEE]);
  }
  return part * over_gap(at, words[ANHYST_WORD_GAP_GAIN]);
}

static number flux_limit(const entry *words) { return words[ANHYST_WORD_FLUX_LIMIT]; }

static number flux_within(number flux) { return within(flux, (number)-1, (number)1); }

static number whole_flux(const entry *words, number flux)
{
  (void)words;
  return flux;
}

/* The output beyond the offset under a flux. */
static number output_beyond(const entry *words, number flux, place at)
{
  const number part = flux / over_gap(at, words[ANHYST_WORD_GAP_GAIN]);
  if (words[ANHYST_WORD_POWER] == (entry)1) {
    return part;
  }
  const number size = size_of(part);
  const number steepness = (number)((int32_t)1 << (int32_t)words[ANHYST_WORD_ROOT_KNEE]);
  return size * steepness < (number)1 ? size / steepness : size * size;
}

/* The limit of the inner current at this word of the block. */
static number current_limit(const entry *words, int16_t word) { return words[word]; }

/* The solved current from the inner one, and back. */
static number outer_current(const entry *words, number current)
{
  (void)words;
  return current;
}

static number inner_current(const entry *words, number current)
{
  (void)words;
  return within(current, -CURRENT_MOST, CURRENT_MOST);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in fixed point, made from generic/compensator.h. */
#include "formats/fixed.h"

#include "lookup.h"

#define DEMAND_TOLERANCE 0
/* Tolerance of an applied current beyond its limit: one LSB of a q15 code. */
#define CURRENT_TOLERANCE ((int32_t)65536)

/* Position of a gap in the tables that depend on the gap. */
typedef struct {
  const int16_t *words; /* block words, advanced by the index of the segment */
  int32_t fraction;     /* fraction of the segment below the gap, q15 */
} gap_position;

static void read_scales(anhyst_compensator *c) { (void)c; }

static int32_t gap_fraction(const anhyst_compensator *c, int32_t gap)
{
  (void)c;
  return gap;
}

static int is_in_gap_range(int32_t gap) { return gap >= 0; }

static gap_position locate_gap(const int16_t *words, int32_t gap)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const int32_t scaled_gap = (gap > 0 ? gap : 0) >> (16U - n);
  const gap_position position = {words + (scaled_gap >> 15), scaled_gap & 0x7FFF};
  return position;
}

/* Returns the interpolated, rounded entry of the table that starts at the block word `first`. */
static int16_t interpolate_over_gap(gap_position position, int16_t first)
{
  const int16_t *entry_below = position.words + first;
  return (
      int16_t)(entry_below[0] +
               ((((int32_t)entry_below[1] - entry_below[0]) * position.fraction + 0x4000) >> 15));
}

static int32_t bias_from_table(int16_t over_gap) { return (int32_t)over_gap * 16384; }

static int32_t limit_bias(int32_t bias)
{
  return anhyst_clamp(bias, -(ANHYST_Q30_ONE / 2), ANHYST_Q30_ONE / 2);
}

static int16_t add_coefficients(int16_t a, int16_t b) { return anhyst_add_q15(a, b); }
static int32_t multiply(int32_t a, int16_t weight) { return anhyst_scale(a, weight); }

/* Returns a*fraction for a fraction of at least 0; the result cannot overflow. */
static int32_t multiply_fraction(int32_t a, int16_t fraction)
{
  return anhyst_scale(a, fraction) * 2;
}

static int32_t add(int32_t a, int32_t b) { return anhyst_add_q31(a, b); }
static int32_t subtract(int32_t a, int32_t b) { return anhyst_sub_q31(a, b); }
static int32_t word_to_signal(int16_t word) { return (int32_t)word * 65536; }

static int is_finite(int32_t a)
{
  (void)a;
  return 1;
}

/* Returns the square root of a non-negative q31 as a q30. Below the knee, at 2^(-2*knee), the
   function is linear, because the infinite slope of the root would amplify the last bit of a demand
   near zero. Above the knee, the relative error is below 2e-9 plus 1 LSB. */
static int32_t root_with_knee(int32_t a, int16_t knee)
{
  if ((a >> (31 - 2 * knee)) == 0) {
    return (int32_t)((uint32_t)a << (knee - 1));
  }
  const unsigned shift = anhyst_headroom(a) & ~1U;            /* even, because the root halves it */
  const int32_t normalised = (int32_t)((uint32_t)a << shift); /* 2^29..2^31 - 1 */
  /* Linear start value within 5 %; each Newton step doubles the correct digits. r is root*2^15. */
  int32_t r = (normalised >> 17) + (normalised >> 19) + 12000;
  r = (r + (normalised >> 1) / r) >> 1;
  r = (r + (normalised >> 1) / r) >> 1;
  const int32_t quotient = (normalised >> 1) / r;
  const int32_t remainder = (normalised >> 1) - quotient * r;
  const int32_t refined_quotient = quotient * 32768 + (remainder * 32768) / r;
  return ((r * 16384) + (refined_quotient >> 1)) >> (shift >> 1);
}

/* Returns the square of a q30 in 0..1 as a q31: the inverse of the root. Error below 2^-15. */
static int32_t square_with_knee(int32_t a, int16_t knee)
{
  if ((a >> (30 - knee)) == 0) {
    return (a >> knee) * 2;
  }
  return anhyst_shl_q31(anhyst_scale(a, anhyst_sat_q15(a >> 15)), 2);
}

/* Returns the flux for an output above the offset, q30 divided by 2^(flux shift of the block). */
static int32_t output_to_flux(const int16_t *words, int32_t above_offset, gap_position position)
{
  const int32_t relative_flux =
      words[ANHYST_WORD_POWER] == 2
          ? root_with_knee(above_offset > 0 ? above_offset : 0, words[ANHYST_WORD_ROOT_KNEE])
          : above_offset >> 1;
  return anhyst_scale(relative_flux, interpolate_over_gap(position, words[ANHYST_WORD_GAP_GAIN]));
}

static int32_t flux_limit(const int16_t *words)
{
  return ((int32_t)words[ANHYST_WORD_FLUX_LIMIT] * 65536) >>
         (uint16_t)words[ANHYST_WORD_FLUX_SHIFT];
}

static int32_t limit_flux(int32_t flux)
{
  return anhyst_clamp(flux, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static int32_t to_internal_flux(const int16_t *words, int32_t flux)
{
  return anhyst_shl_q31(flux, (uint16_t)words[ANHYST_WORD_FLUX_SHIFT]);
}

static int32_t flux_to_output(const int16_t *words, int32_t flux, gap_position position)
{
  /* Shifts before the division, because the quotient alone may exceed 32 bits. */
  const int32_t flux_size = anhyst_abs_q31(flux) >> (uint16_t)words[ANHYST_WORD_FLUX_SHIFT];
  int32_t relative_flux = 0;
  if (flux_size > 0) {
    relative_flux =
        anhyst_quotient(flux_size, interpolate_over_gap(position, words[ANHYST_WORD_GAP_GAIN]));
  }
  if (words[ANHYST_WORD_POWER] == 2) {
    return square_with_knee(anhyst_clamp(relative_flux, 0, ANHYST_Q30_ONE - 1),
                            words[ANHYST_WORD_ROOT_KNEE]);
  }
  return anhyst_shl_q31(flux < 0 ? -relative_flux : relative_flux, 1);
}

/* An internal current is q30 divided by 2^n. The block states n (ANHYST_WORD_CURRENT_SHIFT). */
static uint16_t current_shift(const int16_t *words)
{
  return (uint16_t)(words[ANHYST_WORD_CURRENT_SHIFT] + 1);
}

static int32_t current_limit(const int16_t *words, int16_t word)
{
  return ((int32_t)words[word] * 65536) >> current_shift(words);
}

static int32_t to_external_current(const int16_t *words, int32_t current)
{
  return (int32_t)((uint32_t)current << current_shift(words));
}

static int32_t to_internal_current(const int16_t *words, int32_t current)
{
  return current >> current_shift(words);
}

#include "generic/compensator.h"

int32_t anhyst_root_q31(int32_t a) { return anhyst_shl_q31(root_with_knee(a > 0 ? a : 0, 8), 1); }

anhyst_status anhyst_compensator_init_sized(anhyst_compensator *c, size_t size,
                                            const anhyst_kernel *kernel, const int16_t *words,
                                            uint16_t capacity)
{
  if (size != sizeof *c) {
    return ANHYST_BAD_SIZE;
  }
  const anhyst_status status = anhyst_block_check(kernel, words, capacity);
  if (status == ANHYST_OK) {
    init_state(c, kernel, words);
  }
  return status;
}

void anhyst_compensator_demagnetise(anhyst_compensator *c) { demagnetise(c); }

void anhyst_compensator_swap(anhyst_compensator *c, const int16_t *words) { swap_block(c, words); }

int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap)
{
  solve_demand(c, demand, gap);
  return c->current;
}

/* Limits of the current are 16-bit codes, so that rounding to q15 does not exceed them. */
int16_t anhyst_compensator_solve_q15(anhyst_compensator *c, int16_t demand, int16_t gap)
{
  solve_demand(c, word_to_signal(demand), word_to_signal(gap));
  return (int16_t)((c->current + 0x8000) >> 16);
}

void anhyst_compensator_commit_q31(anhyst_compensator *c, int32_t applied, int32_t gap)
{
  commit_current(c, applied, gap);
}

/* Commits the solved current if it rounds to the applied code, otherwise the applied code. */
void anhyst_compensator_commit_q15(anhyst_compensator *c, int16_t applied, int16_t gap)
{
  const int32_t given = word_to_signal(applied);
  const uint32_t off = (uint32_t)c->current - (uint32_t)given + 0x8000U;
  commit_current(c, off < 0x10000U ? c->current : given, word_to_signal(gap));
}

int32_t anhyst_compensator_output_q31(const anhyst_compensator *c) { return model_output(c); }

int16_t anhyst_compensator_output_q15(const anhyst_compensator *c)
{
  return anhyst_round_q31(model_output(c));
}

int32_t anhyst_conditioning_length(const anhyst_compensator *c) { return conditioning_ticks(c); }

int16_t anhyst_conditioning_q15(const anhyst_compensator *c, int32_t tick)
{
  return conditioning_word(c, tick);
}

int32_t anhyst_conditioning_q31(const anhyst_compensator *c, int32_t tick)
{
  return word_to_signal(conditioning_word(c, tick));
}

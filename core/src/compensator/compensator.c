/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in fixed point; its text is generic/compensator.h. */
#include "formats/fixed.h"

#include "lookup.h"

#define DEMAND_CODE 0
#define CURRENT_CODE                                                                               \
  ((int32_t)65536) /* a q15 code: what an applied current may pass a limit by                      \
                    */

/* Where a gap falls in the tables over the gap. */
typedef struct {
  const int16_t *words; /* of the block, moved on to the segment */
  int32_t part;         /* of the segment, q15 */
} place;

static void take_scales(anhyst_compensator *c) { (void)c; }

static int32_t gap_fraction(const anhyst_compensator *c, int32_t gap)
{
  (void)c;
  return gap;
}

static int is_in_gap_range(int32_t gap) { return gap >= 0; }

static place place_of(const int16_t *words, int32_t gap)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const int32_t fine = (gap > 0 ? gap : 0) >> (16U - n);
  const place at = {words + (fine >> 15), fine & 0x7FFF};
  return at;
}

/* The entry of a table there, rounded; the word of the block names the table. */
static int16_t over_gap(place at, int16_t first)
{
  const int16_t *found = at.words + first;
  return (int16_t)(found[0] + ((((int32_t)found[1] - found[0]) * at.part + 0x4000) >> 15));
}

static int32_t bias_of(int16_t over_gap) { return (int32_t)over_gap * 16384; }

/* The nearest bias that a law takes. */
static int32_t bias_within(int32_t bias)
{
  return anhyst_clamp(bias, -(ANHYST_Q30_ONE / 2), ANHYST_Q30_ONE / 2);
}

static int16_t arm_sum(int16_t a, int16_t b) { return anhyst_add_q15(a, b); }

static int32_t product(int32_t a, int16_t weight) { return anhyst_scale(a, weight); }

static int32_t sum_of(int32_t a, int32_t b) { return anhyst_add_q31(a, b); }

static int32_t difference_of(int32_t a, int32_t b) { return anhyst_sub_q31(a, b); }

static int32_t signal_of(int16_t word) { return (int32_t)word * 65536; }

static int is_finite(int32_t a)
{
  (void)a;
  return 1;
}

/* Root of a q31 that is not negative, q30. Below the knee, 2^(-2k), a straight line: the infinite
   slope of the root would turn the last bit of a demand near zero into a jump of current. Beyond
   it, relative error below 2e-9 plus a unit in the last place. */
static int32_t root(int32_t a, int16_t knee)
{
  if ((a >> (31 - 2 * knee)) == 0) {
    return (int32_t)((uint32_t)a << (knee - 1));
  }
  const unsigned up = anhyst_headroom(a) & ~1U;      /* even, so that it halves */
  const int32_t full = (int32_t)((uint32_t)a << up); /* 2^29..2^31 - 1 */
  /* A line within 5 % to begin with; each step doubles the digits. r is the root times 2^15. */
  int32_t r = (full >> 17) + (full >> 19) + 12000;
  r = (r + (full >> 1) / r) >> 1;
  r = (r + (full >> 1) / r) >> 1;
  const int32_t quotient = (full >> 1) / r;
  const int32_t rest = (full >> 1) - quotient * r;
  const int32_t fine = quotient * 32768 + (rest * 32768) / r;
  return ((r * 16384) + (fine >> 1)) >> (up >> 1);
}

/* Square of a q30 within 0..1, as a q31; the inverse of root. Error below 2^-15, saturates. */
static int32_t square(int32_t a, int16_t knee)
{
  if ((a >> (30 - knee)) == 0) {
    return (a >> knee) * 2;
  }
  return anhyst_shl_q31(anhyst_scale(a, anhyst_sat_q15(a >> 15)), 2);
}

/* What an output by this much beyond the offset needs as a flux, q30 over
   2^ANHYST_WORD_FLUX_SHIFT. */
static int32_t flux_for(const int16_t *words, int32_t beyond, place at)
{
  const int32_t part = words[ANHYST_WORD_POWER] == 2
                           ? root(beyond > 0 ? beyond : 0, words[ANHYST_WORD_ROOT_KNEE])
                           : beyond >> 1;
  return anhyst_scale(part, over_gap(at, words[ANHYST_WORD_GAP_GAIN]));
}

static int32_t flux_limit(const int16_t *words)
{
  return ((int32_t)words[ANHYST_WORD_FLUX_LIMIT] * 65536) >>
         (uint16_t)words[ANHYST_WORD_FLUX_SHIFT];
}

static int32_t flux_within(int32_t flux)
{
  return anhyst_clamp(flux, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static int32_t whole_flux(const int16_t *words, int32_t flux)
{
  return anhyst_shl_q31(flux, (uint16_t)words[ANHYST_WORD_FLUX_SHIFT]);
}

/* The output beyond the offset under a flux. */
static int32_t output_beyond(const int16_t *words, int32_t flux, place at)
{
  /* Shifted first: the quotient alone may be beyond 32 bits. */
  const int32_t size = anhyst_abs_q31(flux) >> (uint16_t)words[ANHYST_WORD_FLUX_SHIFT];
  int32_t part = 0;
  if (size > 0) {
    part = anhyst_quotient(size, over_gap(at, words[ANHYST_WORD_GAP_GAIN]));
  }
  if (words[ANHYST_WORD_POWER] == 2) {
    return square(anhyst_clamp(part, 0, ANHYST_Q30_ONE - 1), words[ANHYST_WORD_ROOT_KNEE]);
  }
  return anhyst_shl_q31(flux < 0 ? -part : part, 1);
}

/* The inner current is q30 over 2^ANHYST_WORD_CURRENT_SHIFT. */
static uint16_t current_shift(const int16_t *words)
{
  return (uint16_t)(words[ANHYST_WORD_CURRENT_SHIFT] + 1);
}

static int32_t current_limit(const int16_t *words, int16_t word)
{
  return ((int32_t)words[word] * 65536) >> current_shift(words);
}

static int32_t outer_current(const int16_t *words, int32_t current)
{
  return (int32_t)((uint32_t)current << current_shift(words));
}

static int32_t inner_current(const int16_t *words, int32_t current)
{
  return current >> current_shift(words);
}

#include "generic/compensator.h"

int32_t anhyst_root_q31(int32_t a) { return anhyst_shl_q31(root(a > 0 ? a : 0, 8), 1); }

anhyst_status anhyst_compensator_init_sized(anhyst_compensator *c, size_t size,
                                            const anhyst_kernel *kernel, const int16_t *words,
                                            uint16_t capacity)
{
  if (size != sizeof *c) {
    return ANHYST_BAD_SIZE;
  }
  const anhyst_status status = anhyst_block_check(kernel, words, capacity);
  if (status == ANHYST_OK) {
    init(c, kernel, words);
  }
  return status;
}

void anhyst_compensator_demagnetise(anhyst_compensator *c) { demagnetise(c); }

void anhyst_compensator_swap(anhyst_compensator *c, const int16_t *words) { swap(c, words); }

int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap)
{
  solve(c, demand, gap);
  return c->current;
}

/* The limits of a current have 16 bits: there is room to round. */
int16_t anhyst_compensator_solve_q15(anhyst_compensator *c, int16_t demand, int16_t gap)
{
  solve(c, signal_of(demand), signal_of(gap));
  return (int16_t)((c->current + 0x8000) >> 16);
}

void anhyst_compensator_commit_q31(anhyst_compensator *c, int32_t applied, int32_t gap)
{
  commit(c, applied, gap);
}

/* What was solved is applied where that rounds to it. */
void anhyst_compensator_commit_q15(anhyst_compensator *c, int16_t applied, int16_t gap)
{
  const int32_t given = signal_of(applied);
  const uint32_t off = (uint32_t)c->current - (uint32_t)given + 0x8000U;
  commit(c, off < 0x10000U ? c->current : given, signal_of(gap));
}

int32_t anhyst_compensator_output_q31(const anhyst_compensator *c) { return output(c); }

int16_t anhyst_compensator_output_q15(const anhyst_compensator *c)
{
  return anhyst_round_q31(output(c));
}

int32_t anhyst_conditioning_length(const anhyst_compensator *c) { return conditioning_length(c); }

int16_t anhyst_conditioning_q15(const anhyst_compensator *c, int32_t tick)
{
  return conditioning(c, tick);
}

int32_t anhyst_conditioning_q31(const anhyst_compensator *c, int32_t tick)
{
  return signal_of(conditioning(c, tick));
}

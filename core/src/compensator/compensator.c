/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/compensator.h"

#include "lookup.h"

/* Where a gap falls in the tables over the gap. */
typedef struct {
  const int16_t *words; /* of the block, moved on to the segment */
  int32_t part;         /* of the segment, q15 */
} place;

static place gap_place(const int16_t *words, int32_t gap)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_GAP_SEGMENTS];
  const int32_t fine = (gap > 0 ? gap : 0) >> (16U - n);
  const place at = {words + (fine >> 15), fine & 0x7FFF};
  return at;
}

/* The entry of a table there, rounded; the word of the block names the table. */
static int16_t over_gap(place at, int16_t first)
{
  const int16_t *entry = at.words + first;
  return (int16_t)(entry[0] + ((((int32_t)entry[1] - entry[0]) * at.part + 0x4000) >> 15));
}

static anhyst_arms arms_at(const int16_t *words, place at)
{
  anhyst_arms arms;
  arms.bias = (int32_t)over_gap(at, words[ANHYST_WORD_GAP_BIAS]) * 16384;
  arms.flux_arm = over_gap(at, words[ANHYST_WORD_GAP_FLUX_ARM]);
  arms.field_arm = over_gap(at, words[ANHYST_WORD_GAP_FIELD_ARM]);
  return arms;
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

int32_t anhyst_root_q31(int32_t a) { return anhyst_shl_q31(root(a > 0 ? a : 0, 8), 1); }

/* Square of a q30 within 0..1, as a q31; the inverse of root. Error below 2^-15, saturates. */
static int32_t square(int32_t a, int16_t knee)
{
  if ((a >> (30 - knee)) == 0) {
    return (a >> knee) * 2;
  }
  return anhyst_shl_q31(anhyst_scale(a, anhyst_sat_q15(a >> 15)), 2);
}

/* The output at this gap without flux. */
static int32_t offset_at(const int16_t *words, place at)
{
  return (int32_t)over_gap(at, words[ANHYST_WORD_GAP_OFFSET]) * 65536;
}

/* The number of low..high nearest to a; sets a flag where that is another one. */
static inline int32_t limited(anhyst_compensator *c, int32_t a, int32_t low, int32_t high,
                              uint16_t flag)
{
  if (a >= low && a <= high) {
    return a;
  }
  c->flags |= flag;
  return a < low ? low : high;
}

/* What an output so far beyond the offset needs as a flux, q30 over 2^ANHYST_WORD_FLUX_SHIFT. */
static inline int32_t flux_for(const int16_t *words, int32_t beyond, place at)
{
  const int32_t part = words[ANHYST_WORD_POWER] == 2
                           ? root(beyond > 0 ? beyond : 0, words[ANHYST_WORD_ROOT_KNEE])
                           : beyond >> 1;
  return anhyst_scale(part, over_gap(at, words[ANHYST_WORD_GAP_GAIN]));
}

/* The demand at this gap as a flux, q30; at least 0 if it goes with a square. */
static int32_t flux_of(anhyst_compensator *c, int32_t demand, place at)
{
  const int16_t *words = c->words;
  const int32_t wanted =
      limited(c, demand, (int32_t)words[ANHYST_WORD_DEMAND_LOW] * 65536,
              (int32_t)words[ANHYST_WORD_DEMAND_HIGH] * 65536, ANHYST_DEMAND_LIMITED);
  const int32_t beyond = anhyst_sub_q31(wanted, offset_at(words, at));
  if (beyond < 0 && words[ANHYST_WORD_POWER] == 2) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  const unsigned up = (unsigned)words[ANHYST_WORD_FLUX_SHIFT];
  const int32_t limit = ((int32_t)words[ANHYST_WORD_FLUX_LIMIT] * 65536) >> up;
  const int32_t flux = flux_for(words, beyond, at);
  return (int32_t)((uint32_t)limited(c, flux, -limit, limit, ANHYST_FLUX_LIMITED) << up);
}

static const anhyst_kernel *kernel_for(const anhyst_kernel *kernel, const int16_t *words)
{
  return kernel->for_block != 0 ? kernel->for_block(words) : kernel;
}

anhyst_status anhyst_compensator_init(anhyst_compensator *c, const anhyst_kernel *kernel,
                                      const int16_t *words, uint16_t capacity)
{
  const anhyst_status status = anhyst_block_check(kernel, words, capacity);
  if (status != ANHYST_OK) {
    return status;
  }
  c->kernel = kernel_for(kernel, words);
  c->words = words;
  c->current = 0;
  c->flux = 0;
  c->flux_applied = 0;
  c->gap = 0;
  c->flags = 0;
  anhyst_compensator_demagnetise(c);
  return ANHYST_OK;
}

/* Forgets what was found last, which says nothing of another memory or block. */
static void forget(anhyst_compensator *c)
{
  c->stage = ANHYST_STAGE_UNKNOWN;
}

void anhyst_compensator_demagnetise(anhyst_compensator *c)
{
  const anhyst_memory demagnetised = {{0, 0, 0, 0, 0}};
  c->memory = demagnetised;
  for (uint16_t i = 0; i < ANHYST_CELLS; i++) {
    c->plays[i] = 0;
  }
  forget(c);
  if (c->kernel->start != 0) {
    c->kernel->start(c);
  }
}

int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap)
{
  const int16_t *words = c->words;
  c->flags = 0;
  c->gap = gap;
  const place at = gap_place(words, gap);
  c->arms = arms_at(words, at);
  c->flux = flux_of(c, demand, at);
  if (c->stage == ANHYST_STAGE_AHEAD) { /* of where nobody went */
    c->stage = ANHYST_STAGE_UNKNOWN;
  }
  const int32_t field = c->kernel->field(c);
  const int32_t inner = c->arms.bias + anhyst_scale(c->flux, c->arms.flux_arm) +
                        anhyst_scale(field, c->arms.field_arm);
  const unsigned up = (unsigned)words[ANHYST_WORD_CURRENT_SHIFT] + 1U;
  const int32_t reached =
      limited(c, inner, ((int32_t)words[ANHYST_WORD_CURRENT_LOW] * 65536) >> up,
              ((int32_t)words[ANHYST_WORD_CURRENT_HIGH] * 65536) >> up, ANHYST_CURRENT_LIMITED);
  c->current = (int32_t)((uint32_t)reached << up);
  c->stage = ANHYST_STAGE_AHEAD;
  return c->current;
}

/* The limits of a current have 16 bits: there is room to round. */
int16_t anhyst_compensator_solve_q15(anhyst_compensator *c, int16_t demand, int16_t gap)
{
  const int32_t current =
      anhyst_compensator_solve_q31(c, (int32_t)demand * 65536, (int32_t)gap * 65536);
  return (int16_t)((current + 0x8000) >> 16);
}

void anhyst_compensator_commit_q31(anhyst_compensator *c, int32_t applied, int32_t gap)
{
  const int16_t *words = c->words;
  const int same_gap = c->stage == ANHYST_STAGE_AHEAD && gap == c->gap;
  if (!same_gap) {
    c->arms = arms_at(words, gap_place(words, gap));
    c->gap = gap;
  }
  if (same_gap && applied == c->current && (c->flags & ANHYST_CURRENT_LIMITED) == 0U) {
    c->flux_applied = c->flux;
  } else {
    c->flux_applied = c->kernel->flux(c, applied >> (words[ANHYST_WORD_CURRENT_SHIFT] + 1));
  }
  if (c->kernel->keep != 0) {
    c->kernel->keep(c);
  }
  c->memory = c->next.memory;
  c->stage = ANHYST_STAGE_HERE;
}

/* What was solved is applied where that rounds to it. */
void anhyst_compensator_commit_q15(anhyst_compensator *c, int16_t applied, int16_t gap)
{
  const int32_t given = (int32_t)applied * 65536;
  const uint32_t off = (uint32_t)c->current - (uint32_t)given + 0x8000U;
  anhyst_compensator_commit_q31(c, off < 0x10000U ? c->current : given, (int32_t)gap * 65536);
}

int32_t anhyst_compensator_output_q31(const anhyst_compensator *c)
{
  const int16_t *words = c->words;
  const place at = gap_place(words, c->gap);
  const int32_t offset = offset_at(words, at);
  /* Shifted first: the quotient alone may be beyond 32 bits. */
  const int32_t magnitude =
      anhyst_abs_q31(c->flux_applied) >> (uint16_t)words[ANHYST_WORD_FLUX_SHIFT];
  int32_t part = 0;
  if (magnitude > 0) {
    part = anhyst_quotient(magnitude, over_gap(at, words[ANHYST_WORD_GAP_GAIN]));
  }
  if (words[ANHYST_WORD_POWER] == 2) {
    part = square(anhyst_clamp(part, 0, ANHYST_Q30_ONE - 1), words[ANHYST_WORD_ROOT_KNEE]);
  } else {
    part = anhyst_shl_q31(c->flux_applied < 0 ? -part : part, 1);
  }
  return anhyst_add_q31(part, offset);
}

void anhyst_compensator_swap(anhyst_compensator *c, const int16_t *words)
{
  const int32_t output = anhyst_compensator_output_q31(c);
  const place at = gap_place(words, c->gap);
  int32_t flux = anhyst_shl_q31(flux_for(words, anhyst_sub_q31(output, offset_at(words, at)), at),
                                (uint16_t)words[ANHYST_WORD_FLUX_SHIFT]);
  if (words[ANHYST_WORD_POWER] == 2 && c->flux_applied < 0) {
    flux = -flux;
  }
  flux = anhyst_clamp(flux, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  c->kernel = kernel_for(c->kernel, words);
  c->kernel->carry(c, words, flux);
  c->flux_applied = flux;
  c->words = words;
  forget(c);
}

int16_t anhyst_compensator_output_q15(const anhyst_compensator *c)
{
  return anhyst_round_q31(anhyst_compensator_output_q31(c));
}

int32_t anhyst_conditioning_length(const anhyst_compensator *c)
{
  return (int32_t)c->words[ANHYST_WORD_CONDITION_CYCLES] * 2 *
         c->words[ANHYST_WORD_CONDITION_TICKS];
}

int16_t anhyst_conditioning_q15(const anhyst_compensator *c, int32_t tick)
{
  const int32_t ramp = c->words[ANHYST_WORD_CONDITION_TICKS];
  const int32_t low = c->words[ANHYST_WORD_CURRENT_LOW];
  const int32_t span = c->words[ANHYST_WORD_CURRENT_HIGH] - low;
  if (tick < 0 || tick >= anhyst_conditioning_length(c)) {
    return 0;
  }
  const int32_t phase = tick % (2 * ramp);
  const int32_t way = phase < ramp ? phase : 2 * ramp - phase;
  return anhyst_sat_q15(low + (span * way) / ramp);
}

int32_t anhyst_conditioning_q31(const anhyst_compensator *c, int32_t tick)
{
  return (int32_t)anhyst_conditioning_q15(c, tick) * 65536;
}

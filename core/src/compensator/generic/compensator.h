/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the compensator, for every format. The few operations in which the formats differ come
   before it: ../compensator.c for fixed point, compensator_real.h for floating point. The stages of
   the candidate are those of stage.h. */
#include "anhyst/numeric/port.h"

/* The number of low..high nearest to a. Sets a flag if `a` is beyond a limit by more than `code`.
 */
static inline number limited(compensator *c, number a, number low, number high, number code,
                             uint16_t flag)
{
  if (a >= low && a <= high) {
    return a;
  }
  if (!(difference_of(a, high) <= code && difference_of(low, a) <= code)) {
    c->flags |= flag;
  }
  return a > high ? high : low;
}

/* Begins a call with these flags. In a debug build it marks the compensator as busy, and an
   assertion fails if it is already. */
static inline void enter(compensator *c, uint16_t flags)
{
#if ANHYST_HAS_ASSERT
  ANHYST_ASSERT((c->flags & ANHYST_FLAG_BUSY) == 0U);
  c->flags = (uint16_t)(flags | ANHYST_FLAG_BUSY);
#else
  c->flags = flags;
#endif
}

static inline void leave(compensator *c)
{
#if ANHYST_HAS_ASSERT
  c->flags &= (uint16_t)~ANHYST_FLAG_BUSY;
#else
  (void)c;
#endif
}

/* Where the gap falls in the tables; remembers the gap and flags one out of range. */
static place take_gap(compensator *c, number gap)
{
  const number fraction = gap_fraction(c, gap);
  c->gap = gap;
  if (!is_in_gap_range(fraction)) {
    c->flags |= ANHYST_GAP_LIMITED;
  }
  return place_of(c->words, fraction);
}

/* How the current is made up in this tick. Iron with a lag asks for more current as long as its
   flux rises, in proportion to the rise in a tick: at rest what bias and arm get cancels. */
static arms_type arms_at(const compensator *c, place at)
{
  const entry *words = c->words;
  arms_type arms;
  arms.bias = bias_of(over_gap(at, words[ANHYST_WORD_GAP_BIAS]));
  arms.flux_arm = over_gap(at, words[ANHYST_WORD_GAP_FLUX_ARM]);
  arms.field_arm = over_gap(at, words[ANHYST_WORD_GAP_FIELD_ARM]);
  if (words[ANHYST_WORD_GAP_LAG_ARM] > 0) {
    const entry lag = over_gap(at, words[ANHYST_WORD_GAP_LAG_ARM]);
    arms.flux_arm = arm_sum(arms.flux_arm, lag);
    arms.bias = bias_within(arms.bias - product(c->flux_applied, lag));
  }
  return arms;
}

/* The output at this gap without flux. */
static number offset_at(const entry *words, place at)
{
  return signal_of(over_gap(at, words[ANHYST_WORD_GAP_OFFSET]));
}

/* The demand at this gap as a flux; at least 0 if it goes with a square. */
static number flux_of(compensator *c, number demand, place at)
{
  const entry *words = c->words;
  const number low = signal_of(words[ANHYST_WORD_DEMAND_LOW]);
  const number high = signal_of(words[ANHYST_WORD_DEMAND_HIGH]);
  const number accepted = limited(c, demand, low, high, DEMAND_CODE, ANHYST_DEMAND_LIMITED);
  const number beyond = difference_of(accepted, offset_at(words, at));
  const number limit = flux_limit(words);
  if (beyond < 0 && words[ANHYST_WORD_POWER] == 2) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  const number flux =
      limited(c, flux_for(words, beyond, at), -limit, limit, 0, ANHYST_FLUX_LIMITED);
  return whole_flux(words, flux);
}

static const kernel_type *kernel_for(const kernel_type *kernel, const entry *words)
{
  return kernel->for_block != 0 ? kernel->for_block(words) : kernel;
}

static void demagnetise(compensator *c)
{
  const memory_type demagnetised = {{0, 0, 0, 0, 0}};
  c->memory = demagnetised;
  c->conditioned = 0;
  for (uint16_t i = 0; i < ANHYST_CELLS; i++) {
    c->plays[i] = 0;
  }
  c->stage = ANHYST_STAGE_UNKNOWN;
  if (c->kernel->start != 0) {
    c->kernel->start(c);
  }
}

/* Starts with a valid block. */
static void init(compensator *c, const kernel_type *kernel, const entry *words)
{
  c->kernel = kernel_for(kernel, words);
  c->words = words;
  take_scales(c);
  c->current = 0;
  c->applied = 0;
  c->flux = 0;
  c->flux_applied = 0;
  c->gap = 0;
  c->flags = 0;
  demagnetise(c);
}

static void solve(compensator *c, number demand, number gap)
{
  const entry *words = c->words;
  enter(c, 0);
  const place at = take_gap(c, gap);
  c->arms = arms_at(c, at);
  c->flux = flux_of(c, demand, at);
  if (c->stage == ANHYST_STAGE_AHEAD) { /* of a step that nobody took */
    c->stage = ANHYST_STAGE_UNKNOWN;
    c->flags |= ANHYST_UNCOMMITTED;
  }
  const number field = c->kernel->field(c);
  const number needed =
      c->arms.bias + product(c->flux, c->arms.flux_arm) + product(field, c->arms.field_arm);
  const number current =
      limited(c, needed, current_limit(words, ANHYST_WORD_CURRENT_LOW),
              current_limit(words, ANHYST_WORD_CURRENT_HIGH), 0, ANHYST_CURRENT_LIMITED);
  c->stage = ANHYST_STAGE_AHEAD;
  c->current = outer_current(words, current);
  leave(c);
}

/* What was solved is committed by a copy, unless a limit of the current was in the way: its flux is
   searched here. A law has its candidate at the limit then, so that this search is short. Leaves
   the memory alone if the applied current is not a number. */
static void commit(compensator *c, number applied, number gap)
{
  const entry *words = c->words;
  const int is_ahead = c->stage == ANHYST_STAGE_AHEAD;
  const int is_at_gap = is_ahead && gap == c->gap;
  const int is_solved =
      is_at_gap && applied == c->current && (c->flags & ANHYST_CURRENT_LIMITED) == 0U;
  enter(c, (uint16_t)(c->flags & (is_ahead ? 0xFFFFU : ANHYST_CONDITIONING)));
  (void)limited(c, applied, signal_of(words[ANHYST_WORD_CURRENT_LOW]),
                signal_of(words[ANHYST_WORD_CURRENT_HIGH]), CURRENT_CODE, ANHYST_CURRENT_LIMITED);
  if (!is_at_gap) {
    c->arms = arms_at(c, take_gap(c, gap));
  }
  if (!is_finite(applied)) {
    c->stage = ANHYST_STAGE_UNKNOWN;
    leave(c);
    return;
  }
  c->flux_applied = is_solved ? c->flux : c->kernel->flux(c, inner_current(words, applied));
  if (c->kernel->keep != 0) {
    c->kernel->keep(c);
  }
  c->memory = c->next.memory;
  c->applied = applied;
  c->stage = ANHYST_STAGE_HERE;
  leave(c);
}

static number output(const compensator *c)
{
  const place at = place_of(c->words, gap_fraction(c, c->gap));
  return sum_of(output_beyond(c->words, c->flux_applied, at), offset_at(c->words, at));
}

/* Both blocks state the same scales. */
static void swap(compensator *c, const entry *words)
{
  const number before = output(c);
  const place at = place_of(words, gap_fraction(c, c->gap));
  enter(c, 0);
  number flux = whole_flux(words, flux_for(words, difference_of(before, offset_at(words, at)), at));
  if (words[ANHYST_WORD_POWER] == 2 && c->flux_applied < 0) {
    flux = -flux;
  }
  flux = flux_within(flux);
  c->kernel = kernel_for(c->kernel, words);
  c->kernel->carry(c, words, flux);
  c->flux_applied = flux;
  c->words = words;
  take_scales(c);
  c->stage = ANHYST_STAGE_UNKNOWN;
  leave(c);
}

static int32_t conditioning_length(const compensator *c)
{
  return (int32_t)c->words[ANHYST_WORD_CONDITION_CYCLES] * 2 *
         (int32_t)c->words[ANHYST_WORD_CONDITION_TICKS];
}

/* The current of a tick of the start-up as a word of the block. */
static entry conditioning(const compensator *c, int32_t tick)
{
  const int32_t ramp = (int32_t)c->words[ANHYST_WORD_CONDITION_TICKS];
  const number low = c->words[ANHYST_WORD_CURRENT_LOW];
  const number span = c->words[ANHYST_WORD_CURRENT_HIGH] - low;
  if (tick < 0 || tick >= conditioning_length(c)) {
    return 0;
  }
  const int32_t phase = tick % (2 * ramp);
  const int32_t climbed = phase < ramp ? phase : 2 * ramp - phase;
  return (entry)(low + (span * (number)climbed) / (number)ramp);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the compensator, for every number format. The operations that depend on the format are
   included before: ../compensator.c for fixed point, compensator_real.h for floating point. stage.h
   defines the stages of a trial step. */
#include "anhyst/numeric/port.h"

/* Limits a to low..high. Sets a flag if a exceeds a limit by more than the tolerance. */
static inline number clamp_and_flag(compensator *c, number a, number low, number high,
                                    number tolerance, uint16_t flag)
{
  if (a >= low && a <= high) {
    return a;
  }
  if (!(subtract(a, high) <= tolerance && subtract(low, a) <= tolerance)) {
    c->flags |= flag;
  }
  return a > high ? high : low;
}

/* Sets the flags at the start of a call. A debug build also marks the compensator as busy, and an
   assertion fails if the compensator is already busy. */
static inline void begin_call(compensator *c, uint16_t flags)
{
#if ANHYST_HAS_ASSERT
  ANHYST_ASSERT((c->flags & ANHYST_FLAG_BUSY) == 0U);
  c->flags = (uint16_t)(flags | ANHYST_FLAG_BUSY);
#else
  c->flags = flags;
#endif
}

static inline void end_call(compensator *c)
{
#if ANHYST_HAS_ASSERT
  c->flags &= (uint16_t)~ANHYST_FLAG_BUSY;
#else
  (void)c;
#endif
}

/* Stores the gap, sets a flag if it is out of range, and returns the position in the gap tables. */
static gap_position store_gap(compensator *c, number gap)
{
  const number fraction = gap_fraction(c, gap);
  c->gap = gap;
  if (!is_in_gap_range(fraction)) {
    c->flags |= ANHYST_GAP_LIMITED;
  }
  return locate_gap(c->words, fraction);
}

/* Returns the coefficients of the current for this tick. With an eddy-current lag, the current
   contains a term that is proportional to the change of the flux per tick. A ring with leakage flux
   replaces a fraction of the previous flux by the flux inside the ring. At constant flux, the
   changes of bias and flux coefficient cancel. */
static arms_type current_coefficients(const compensator *c, gap_position position)
{
  const entry *words = c->words;
  arms_type arms;
  arms.bias = bias_from_table(interpolate_over_gap(position, words[ANHYST_WORD_GAP_BIAS]));
  arms.flux_arm = interpolate_over_gap(position, words[ANHYST_WORD_GAP_FLUX_ARM]);
  arms.field_arm = interpolate_over_gap(position, words[ANHYST_WORD_GAP_FIELD_ARM]);
  if (words[ANHYST_WORD_GAP_LAG_ARM] > 0) {
    const entry lag = interpolate_over_gap(position, words[ANHYST_WORD_GAP_LAG_ARM]);
    const number lead = multiply_fraction(c->ring_lead, words[ANHYST_WORD_LAG_LEAKY]);
    arms.flux_arm = add_coefficients(arms.flux_arm, lag);
    arms.bias = limit_bias(arms.bias - multiply(add(c->flux_applied, lead), lag));
  }
  return arms;
}

static number gap_offset(const entry *words, gap_position position)
{
  return word_to_signal(interpolate_over_gap(position, words[ANHYST_WORD_GAP_OFFSET]));
}

/* Returns the flux for a demand; it is not negative if the output is proportional to its square. */
static number demand_to_flux(compensator *c, number demand, gap_position position)
{
  const entry *words = c->words;
  const number low = word_to_signal(words[ANHYST_WORD_DEMAND_LOW]);
  const number high = word_to_signal(words[ANHYST_WORD_DEMAND_HIGH]);
  const number accepted =
      clamp_and_flag(c, demand, low, high, DEMAND_TOLERANCE, ANHYST_DEMAND_LIMITED);
  const number above_offset = subtract(accepted, gap_offset(words, position));
  const number limit = flux_limit(words);
  if (above_offset < 0 && words[ANHYST_WORD_POWER] == 2) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  const number flux = clamp_and_flag(c, output_to_flux(words, above_offset, position), -limit,
                                     limit, 0, ANHYST_FLUX_LIMITED);
  return to_internal_flux(words, flux);
}

static const kernel_type *select_kernel(const kernel_type *kernel, const entry *words)
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

static void init_state(compensator *c, const kernel_type *kernel, const entry *words)
{
  c->kernel = select_kernel(kernel, words);
  c->words = words;
  read_scales(c);
  c->current = 0;
  c->applied = 0;
  c->flux = 0;
  c->flux_applied = 0;
  c->ring_lead = 0;
  c->gap = 0;
  c->flags = 0;
  demagnetise(c);
}

static void solve_demand(compensator *c, number demand, number gap)
{
  const entry *words = c->words;
  begin_call(c, 0);
  const gap_position position = store_gap(c, gap);
  c->arms = current_coefficients(c, position);
  c->flux = demand_to_flux(c, demand, position);
  if (c->stage == ANHYST_STAGE_AHEAD) { /* a trial step that was not committed */
    c->stage = ANHYST_STAGE_UNKNOWN;
    c->flags |= ANHYST_UNCOMMITTED;
  }
  const number field = c->kernel->field(c);
  const number needed =
      c->arms.bias + multiply(c->flux, c->arms.flux_arm) + multiply(field, c->arms.field_arm);
  const number current =
      clamp_and_flag(c, needed, current_limit(words, ANHYST_WORD_CURRENT_LOW),
                     current_limit(words, ANHYST_WORD_CURRENT_HIGH), 0, ANHYST_CURRENT_LIMITED);
  c->stage = ANHYST_STAGE_AHEAD;
  c->current = to_external_current(words, current);
  end_call(c);
}

/* Commits the solved current by a copy of the trial step. If the solved current was limited, or
   another current was applied, searches for the flux of the applied current. The trial step of a
   limited current is already at the limit, so that the search is short. An applied current that is
   not finite leaves the state unchanged. */
static void commit_current(compensator *c, number applied, number gap)
{
  const entry *words = c->words;
  const int is_ahead = c->stage == ANHYST_STAGE_AHEAD;
  const int is_at_gap = is_ahead && gap == c->gap;
  const int is_solved =
      is_at_gap && applied == c->current && (c->flags & ANHYST_CURRENT_LIMITED) == 0U;
  begin_call(c, (uint16_t)(c->flags & (is_ahead ? 0xFFFFU : ANHYST_CONDITIONING)));
  (void)clamp_and_flag(c, applied, word_to_signal(words[ANHYST_WORD_CURRENT_LOW]),
                       word_to_signal(words[ANHYST_WORD_CURRENT_HIGH]), CURRENT_TOLERANCE,
                       ANHYST_CURRENT_LIMITED);
  if (!is_at_gap) {
    c->arms = current_coefficients(c, store_gap(c, gap));
  }
  if (!is_finite(applied)) {
    c->stage = ANHYST_STAGE_UNKNOWN;
    end_call(c);
    return;
  }
  const number flux = is_solved ? c->flux : c->kernel->flux(c, to_internal_current(words, applied));
  c->ring_lead = multiply_fraction(add(c->ring_lead, subtract(c->flux_applied, flux)),
                                   words[ANHYST_WORD_LAG_KEEP]);
  c->flux_applied = flux;
  if (c->kernel->keep != 0) {
    c->kernel->keep(c);
  }
  c->memory = c->next.memory;
  c->applied = applied;
  c->stage = ANHYST_STAGE_HERE;
  end_call(c);
}

static number model_output(const compensator *c)
{
  const gap_position position = locate_gap(c->words, gap_fraction(c, c->gap));
  return add(flux_to_output(c->words, c->flux_applied, position), gap_offset(c->words, position));
}

/* Replaces the parameter block. Requires that both blocks have the same scales. */
static void swap_block(compensator *c, const entry *words)
{
  const number output_before = model_output(c);
  const gap_position position = locate_gap(words, gap_fraction(c, c->gap));
  begin_call(c, 0);
  number flux = to_internal_flux(
      words, output_to_flux(words, subtract(output_before, gap_offset(words, position)), position));
  if (words[ANHYST_WORD_POWER] == 2 && c->flux_applied < 0) {
    flux = -flux;
  }
  flux = limit_flux(flux);
  c->kernel = select_kernel(c->kernel, words);
  c->kernel->carry(c, words, flux);
  c->flux_applied = flux;
  c->words = words;
  read_scales(c);
  c->stage = ANHYST_STAGE_UNKNOWN;
  end_call(c);
}

static int32_t conditioning_ticks(const compensator *c)
{
  return (int32_t)c->words[ANHYST_WORD_CONDITION_CYCLES] * 2 *
         (int32_t)c->words[ANHYST_WORD_CONDITION_TICKS];
}

/* Returns the current at a tick of the conditioning sequence, as a word of the block. */
static entry conditioning_word(const compensator *c, int32_t tick)
{
  const int32_t ramp = (int32_t)c->words[ANHYST_WORD_CONDITION_TICKS];
  const number low = c->words[ANHYST_WORD_CURRENT_LOW];
  const number span = c->words[ANHYST_WORD_CURRENT_HIGH] - low;
  if (tick < 0 || tick >= conditioning_ticks(c)) {
    return 0;
  }
  const int32_t phase = tick % (2 * ramp);
  const int32_t ramp_ticks = phase < ramp ? phase : 2 * ramp - phase;
  return (entry)(low + (span * (number)ramp_ticks) / (number)ramp);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the parts of a pass through the layers of solid iron, for any fluxes, fields, slopes and
   targets, and any result of the play-cell law within its range. The replacement of the law shows
   that each call is allowed. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#include "compensator/lookup.h"

#define MAX_TARGET (ANHYST_Q30_ONE / 8 * 5) /* the scale of prove_cells.c */

static inline int32_t proof_quotient(int32_t numerator, int32_t denominator)
{
  SHOW(numerator > 0 && denominator > 0);
  return any_within(0, ANHYST_Q31_MAX);
}
#define anhyst_quotient proof_quotient

#include "compensator/cells.c"

static number solve_current(const entry *words, const cells_memory *from, const number *plays,
                            const arms_type *arms, number target, candidate *at, int is_known)
{
  SHOW(target >= -MAX_TARGET && target <= MAX_TARGET && arms->field_arm >= 0);
  SHOW(arms->flux_arm > -ANHYST_Q15_MAX - 1);
  at->memory.cells.x = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  at->of.cells.row_rise = (int16_t)any_within(0, ANHYST_Q15_MAX);
  at->of.cells.log2_width = (uint16_t)any_within(2, 13);
  return nondet_i32();
}

static number flux_of_trial(const entry *words, const candidate *at) { return nondet_i32(); }

/* Fills the words of a block that passed its check. */
static void any_block(int16_t *words)
{
  words[ANHYST_WORD_CELLS_AIR] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  ASSUME(are_solid_layers_valid(words));
}

/* Sets any state of the search of a compensator, with any shares and slopes. */
static void any_tick(solid_tick *tick, anhyst_compensator *c)
{
  const int16_t *words = c->words;
  c->arms.flux_arm = (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX);
  c->arms.field_arm = (int16_t)any_within(1, ANHYST_Q15_MAX);
  tick->c = c;
  tick->is_flux_given = nondet_i16() != 0;
  tick->layers = layer_count(words);
  tick->laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  tick->coupling_slope = read_coupling_slope(words);
  for (int16_t i = 0; i < ANHYST_MEMORIES; i++) {
    tick->area_fraction[i] = (int16_t)any_within(MIN_AREA_FRACTION, ANHYST_Q15_MAX);
    tick->diffusion_slope[i] = any_within(1, ANHYST_Q31_MAX);
    tick->field_slope[i] = any_within(1, ANHYST_Q31_MAX);
  }
}

static void prove_layer(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  solid_tick tick;
  load_line line = {nondet_i32(), any_within(0, ANHYST_Q31_MAX)};
  any_block(words);
  c.words = words;
  any_tick(&tick, &c);
  line = load_line_below_layer(&tick, 0, line);
  SHOW(line.slope >= 0);
  solve_layer_for_load_line(&tick, 1, line, nondet_i32());
  SHOW(tick.field_slope[1] >= 1);
}

static void prove_surface(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  solid_tick tick;
  any_block(words);
  c.words = words;
  any_tick(&tick, &c);
  solve_layer_for_flux(&tick, 0, divide_by_fraction(nondet_i32(), tick.area_fraction[0]));
  set_circuit_slopes(&tick);
  SHOW(load_line_at_surface(&tick).slope >= 0);
}

static void prove_owed_flux(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  solid_tick tick;
  any_block(words);
  c.words = words;
  any_tick(&tick, &c);
  const int32_t owed =
      outstanding_flux(tick.diffusion_slope[1], nondet_i32(), MAX_OUTSTANDING_FLUX);
  SHOW(owed >= -MAX_OUTSTANDING_FLUX && owed <= MAX_OUTSTANDING_FLUX);
  (void)are_equations_solved(&tick);
}

int main(void)
{
  PART();
  return 0;
}

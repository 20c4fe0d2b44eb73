/* SPDX-License-Identifier: Apache-2.0 */
#include "closed.h"

#include "block.h"

/* A step after which Newton's next would change nothing that matters: 2^-11. */
#define NEAR_WAY (ANHYST_Q30_ONE / 2048)

/* What is missing of a current and is nothing but rounding: the iron stays where it is. */
#define STILL 128

int anhyst_closed_is_valid(const int16_t *words)
{
  return words[ANHYST_WORD_SIMPLE_RATE] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_RATE_SHIFT], 0, 12) &&
         words[ANHYST_WORD_SIMPLE_HOLD] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_HOLD_SHIFT], 0, 12) &&
         words[ANHYST_WORD_SIMPLE_REST] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_ITERATIONS], 2, 16) &&
         anhyst_over_gap_is_valid(words, ANHYST_WORD_GAP_FLUX_ARM, 0);
}

void anhyst_closed_carry(anhyst_compensator *c, const int16_t *words, int32_t flux)
{
  (void)words;
  c->memory.simplified.flux = flux;
  c->memory.simplified.z = 0;
}

/* The memory in the direction of a path, within its bounds whatever it says. */
static anhyst_simplified_memory in_direction(const anhyst_simplified_memory *memory, int falling)
{
  const int32_t flux = anhyst_sat_q30(memory->flux);
  const int32_t u = anhyst_sat_q30(memory->u);
  const anhyst_simplified_memory same = {flux, u, memory->z};
  const anhyst_simplified_memory other = {-flux, -u, anhyst_sub_q31(0, memory->z)};
  return falling ? other : same;
}

int32_t anhyst_closed_field(anhyst_compensator *c, anhyst_advance *advance)
{
  const int32_t way = anhyst_sub_q31(c->flux, c->memory.simplified.flux);
  const int falling = way < 0;
  anhyst_simplified_memory start = in_direction(&c->memory.simplified, falling);
  anhyst_simplified_memory end;
  anhyst_candidate *to = &c->next;
  advance(c->words, &start, anhyst_abs_q31(way), &end);
  to->memory.simplified = in_direction(&end, falling);
  to->memory.simplified.flux = c->flux;
  to->m = start.z;
  to->way = falling ? -1 : 1;
  return to->memory.simplified.u;
}

static int32_t current_at(const anhyst_simplified_memory *at, const anhyst_arms *arms)
{
  return anhyst_scale(at->flux, arms->flux_arm) + anhyst_scale(at->u, arms->field_arm);
}

/* flux_arm*flux + field_arm*u = target on a rising path, from *to, which is a place on it. In the
   direction of travel the sum is a concave function of the flux, so Newton's steps from before the
   solution come nearer without ever passing it, and one from beyond leads before it. */
static void reach(const int16_t *words, anhyst_simplified_memory *start, const anhyst_arms *arms,
                  int32_t target, anhyst_simplified_memory *to, anhyst_advance *advance)
{
  for (int16_t i = words[ANHYST_WORD_SIMPLE_ITERATIONS]; i > 0; i--) {
    const int32_t missing = anhyst_sub_q31(target, current_at(to, arms));
    const int32_t slope =
        arms->flux_arm + anhyst_scale(anhyst_lag_slope(words, to->u) * 64, arms->field_arm);
    if (missing == 0 || slope <= 0) {
      break; /* as near as the numbers allow */
    }
    const int32_t way = anhyst_quotient(anhyst_abs_q31(missing), slope);
    const int32_t next =
        missing > 0 ? anhyst_add_q31(to->flux, way) : anhyst_sub_q31(to->flux, way);
    const int32_t flux = next < ANHYST_Q30_ONE ? next : ANHYST_Q30_ONE - 1;
    if (flux > start->flux) {
      advance(words, start, anhyst_sub_q31(flux, start->flux), to);
      to->flux = flux;
    } else {
      *to = *start;
    }
    if (way <= NEAR_WAY) {
      break;
    }
  }
}

int32_t anhyst_closed_flux(anhyst_compensator *c, int32_t current, anhyst_advance *advance)
{
  const anhyst_simplified_memory *from = &c->memory.simplified;
  const anhyst_arms *arms = &c->arms;
  anhyst_candidate *solved = &c->next;
  const int32_t target =
      anhyst_clamp(anhyst_sub_q31(current, arms->bias), -ANHYST_Q30_ONE + 1, ANHYST_Q30_ONE - 1);
  const int32_t missing = anhyst_sub_q31(target, current_at(from, arms));
  const int falling = missing < 0;
  if (missing <= STILL && missing >= -STILL) {
    solved->memory.simplified = *from;
    return from->flux;
  }
  anhyst_simplified_memory start = in_direction(from, falling);
  anhyst_simplified_memory end = start;
  if (solved->way == (falling ? -1 : 1)) {
    start.z = solved->m;
    end.z = solved->m;
    const int32_t left = anhyst_sub_q31(target, current_at(&solved->memory.simplified, arms));
    if (anhyst_abs_q31(left) < anhyst_abs_q31(missing)) {
      end = in_direction(&solved->memory.simplified, falling);
    }
  }
  reach(c->words, &start, arms, falling ? -target : target, &end, advance);
  solved->memory.simplified = in_direction(&end, falling);
  return solved->memory.simplified.flux;
}

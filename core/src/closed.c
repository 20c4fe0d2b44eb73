/* SPDX-License-Identifier: Apache-2.0 */
#include "closed.h"

#include "block.h"

int anhyst_closed_sound(const int16_t *words)
{
  return words[ANHYST_WORD_SIMPLE_RATE] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_RATE_SHIFT], 0, 12) &&
         words[ANHYST_WORD_SIMPLE_HOLD] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_HOLD_SHIFT], 0, 12) &&
         words[ANHYST_WORD_SIMPLE_REST] > 0 &&
         anhyst_within(words[ANHYST_WORD_SIMPLE_ITERATIONS], 2, 16) &&
         anhyst_over_gap_sound(words, ANHYST_WORD_GAP_FLUX_ARM, 0);
}

void anhyst_closed_carry(const int16_t *before, const int16_t *words, int32_t flux,
                         anhyst_memory *memory)
{
  (void)before;
  (void)words;
  memory->a = flux;
  memory->c = 0;
}

static anhyst_memory mirrored(const anhyst_memory *memory)
{
  const anhyst_memory other = {-memory->a, -memory->b, -memory->c, 0, 0};
  return other;
}

int32_t anhyst_closed_field(const int16_t *words, const anhyst_memory *from, int32_t flux,
                            anhyst_memory *to, anhyst_advance *advance)
{
  const int32_t way = anhyst_sub_q31(flux, from->a);
  if (way >= 0) {
    advance(words, from, way, to);
  } else {
    const anhyst_memory start = mirrored(from);
    anhyst_memory end;
    advance(words, &start, anhyst_abs_q31(way), &end);
    *to = mirrored(&end);
  }
  to->a = flux;
  return to->b;
}

/* flux_arm*flux + field_arm*u = target on a rising path. In the direction of travel the sum is a
   concave function of the flux, so Newton's steps from the start come nearer without ever passing
   the solution. */
static void reach(const int16_t *words, const anhyst_memory *start, const anhyst_arms *arms,
                  int32_t target, anhyst_memory *to, anhyst_advance *advance)
{
  int32_t flux = start->a;
  *to = *start;
  for (int16_t i = words[ANHYST_WORD_SIMPLE_ITERATIONS]; i > 0; i--) {
    const int32_t missing = anhyst_sub_q31(target, anhyst_scale(flux, arms->flux_arm) +
                                                       anhyst_scale(to->b, arms->field_arm));
    const int32_t slope =
        arms->flux_arm + anhyst_scale(anhyst_lag_slope(words, to->b) * 64, arms->field_arm);
    if (missing <= 0 || slope <= 0) {
      continue; /* as near as the numbers allow; the remaining rounds change nothing */
    }
    const int32_t next = anhyst_add_q31(flux, anhyst_quotient(missing, slope));
    flux = next < ANHYST_Q30_ONE ? next : ANHYST_Q30_ONE - 1;
    if (flux > start->a) {
      advance(words, start, anhyst_sub_q31(flux, start->a), to);
    }
    to->a = flux;
  }
}

int32_t anhyst_closed_flux(const int16_t *words, const anhyst_memory *from, const anhyst_arms *arms,
                           int32_t current, anhyst_memory *to, anhyst_advance *advance)
{
  const int32_t target =
      anhyst_clamp(anhyst_sub_q31(current, arms->bias), -ANHYST_Q30_ONE + 1, ANHYST_Q30_ONE - 1);
  const int32_t before =
      anhyst_scale(from->a, arms->flux_arm) + anhyst_scale(from->b, arms->field_arm);
  if (target >= before) {
    reach(words, from, arms, target, to, advance);
  } else {
    const anhyst_memory start = mirrored(from);
    anhyst_memory end;
    reach(words, &start, arms, -target, &end, advance);
    *to = mirrored(&end);
  }
  return to->a;
}

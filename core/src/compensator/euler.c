/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's way, as the baseline to beat: eqs. 13 to 15 with eqs. 19 and 20, integrated by
   Euler's explicit method in a fixed number of sub-steps a sample. u is a linear function of flux
   and magnetisation, so a step in u is the same step as one in M, without the paper's small
   difference of large numbers. */
#include "block.h"
#include "closed.h"

/* part*slope, slope in 1/1024, saturates: the slope as a weight of 15 bits and what it takes. */
static int32_t change(int32_t part, int32_t slope)
{
  const uint16_t beyond = slope > ANHYST_Q15_MAX ? (uint16_t)(16U - anhyst_headroom(slope)) : 0U;
  return anhyst_shl_q31(anhyst_scale(part, (int16_t)(slope >> beyond)), (uint16_t)(beyond + 6U));
}

static void advance(const int16_t *words, anhyst_simplified_memory *start, int32_t way,
                    anhyst_simplified_memory *to)
{
  const int16_t substeps = words[ANHYST_WORD_EULER_SUBSTEPS];
  const int32_t part = way / substeps;
  int32_t u = start->u;
  for (int16_t i = 0; i < substeps; i++) {
    u = anhyst_add_q31(u, change(part, anhyst_lag_slope(words, u)));
    u = anhyst_clamp(u, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  }
  to->flux = start->flux;
  to->u = u;
  to->z = 0;
}

static int32_t euler_field(anhyst_compensator *c) { return anhyst_closed_field(c, advance); }

static int32_t euler_flux(anhyst_compensator *c, int32_t current)
{
  return anhyst_closed_flux(c, current, advance);
}

static int euler_is_valid(const int16_t *words)
{
  return anhyst_closed_is_valid(words) && anhyst_within(words[ANHYST_WORD_EULER_SUBSTEPS], 1, 16);
}

const anhyst_kernel anhyst_kernel_euler = {
    ANHYST_KIND_EULER, euler_field, euler_flux, euler_is_valid, anhyst_closed_carry, 0, 0, 0};

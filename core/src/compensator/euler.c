/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's form of the simplified law, as a baseline: eqs. 13 to 15 with eqs. 19 and 20,
   integrated by Euler's explicit method in a fixed number of sub-steps a sample. The bounded state
   is a linear function of flux and magnetisation. Therefore, a step of it is the same step as one
   of the magnetisation, without the paper's small difference of large numbers. */
#include "simplified_fixed.h"

#include "generic/simplified.h"

/* A step begins at the bounded state itself: its path needs no start. */
static int32_t start_of(const int16_t *words, int32_t state)
{
  (void)words;
  (void)state;
  return 0;
}

/* part*slope, slope in 1/1024, saturates: the slope as a weight of 15 bits and an exponent. */
static int32_t change(int32_t part, int32_t slope)
{
  const uint16_t beyond = slope > ANHYST_Q15_MAX ? (uint16_t)(16U - anhyst_headroom(slope)) : 0U;
  return anhyst_shl_q31(anhyst_scale(part, (int16_t)(slope >> beyond)), (uint16_t)(beyond + 6U));
}

static int32_t state_beyond(const int16_t *words, const anhyst_simplified_memory *path,
                            int32_t flux)
{
  const int16_t substeps = words[ANHYST_WORD_EULER_SUBSTEPS];
  const int32_t part = anhyst_sub_q31(flux, path->peak) / substeps;
  int32_t u = path->u;
  for (int16_t i = 0; i < substeps; i++) {
    u = anhyst_add_q31(u, change(part, lag_slope(words, u)));
    u = anhyst_clamp(u, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  }
  return u;
}

static int euler_is_valid(const int16_t *words)
{
  return path_is_valid(words) && is_integer(words[ANHYST_WORD_EULER_SUBSTEPS], 1, 16);
}

const anhyst_kernel anhyst_kernel_euler = {ANHYST_KIND_EULER,
                                           simplified_field,
                                           simplified_flux,
                                           euler_is_valid,
                                           simplified_carry,
                                           0,
                                           0,
                                           0};

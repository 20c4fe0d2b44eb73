/* SPDX-License-Identifier: Apache-2.0 */
/* The published form of the simplified law, as a baseline: eqs. 13 to 15 with eqs. 19 and 20 of the
   paper. The law is integrated by the explicit Euler method with a fixed number of sub-steps per
   sample. The hysteresis field u is a linear function of flux and magnetisation. Therefore, a step
   of u is equivalent to a step of magnetisation, but avoids a small difference of large numbers. */
#include "simplified_fixed.h"

#include "generic/simplified.h"

/* Returns 0, because a step starts at u itself and needs no stored start. */
static int32_t stored_path_start(const int16_t *words, int32_t state)
{
  (void)words;
  (void)state;
  return 0;
}

/* Returns travel*slope, with the slope in units of 1/1024. The result saturates. The slope is
   converted to a 15-bit weight and an exponent. */
static int32_t multiply_by_slope(int32_t travel, int32_t slope)
{
  const uint16_t excess_bits =
      slope > ANHYST_Q15_MAX ? (uint16_t)(16U - anhyst_headroom(slope)) : 0U;
  return anhyst_shl_q31(anhyst_scale(travel, (int16_t)(slope >> excess_bits)),
                        (uint16_t)(excess_bits + 6U));
}

static int32_t state_at_flux(const int16_t *words, const anhyst_simplified_memory *path,
                             int32_t flux)
{
  const int16_t substeps = words[ANHYST_WORD_EULER_SUBSTEPS];
  const int32_t travel = anhyst_sub_q31(flux, path->peak_flux) / substeps;
  int32_t u = path->u;
  for (int16_t i = 0; i < substeps; i++) {
    u = anhyst_add_q31(u, multiply_by_slope(travel, state_slope(words, u)));
    u = anhyst_clamp(u, -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  }
  return u;
}

static int is_euler_block_valid(const int16_t *words)
{
  return are_path_words_valid(words) && is_integer(words[ANHYST_WORD_EULER_SUBSTEPS], 1, 16);
}

const anhyst_kernel anhyst_kernel_euler = {ANHYST_KIND_EULER,
                                           simplified_field_for_flux,
                                           simplified_flux_for_current,
                                           is_euler_block_valid,
                                           simplified_transfer_state,
                                           0,
                                           0,
                                           0};

/* SPDX-License-Identifier: Apache-2.0 */

/* transfer function (forward[0] + forward[1]/z + forward[2]/z^2)/(1 + back[0]/z + back[1]/z^2) */
typedef struct {
  ANHYST_REAL forward[3];
  ANHYST_REAL back[2];
} anhyst_biquad_x;

/* State of a filter; all members are 0 at standstill. */
typedef struct {
  ANHYST_REAL delayed[2];
} anhyst_biquad_state_x;

/* Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if a coefficient is not finite. */
anhyst_status anhyst_biquad_check_x(const anhyst_biquad_x *filter);

/* Returns the output for this tick, and advances the state. */
ANHYST_REAL anhyst_biquad_step_x(const anhyst_biquad_x *filter, anhyst_biquad_state_x *state,
                                 ANHYST_REAL in);

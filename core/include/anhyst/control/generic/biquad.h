/* SPDX-License-Identifier: Apache-2.0 */

/* (forward[0] + forward[1]/z + forward[2]/z^2)/(1 + back[0]/z + back[1]/z^2) */
typedef struct {
  ANHYST_REAL forward[3];
  ANHYST_REAL back[2];
} ANHYST_NAME(anhyst_biquad);

/* Zero is rest. */
typedef struct {
  ANHYST_REAL delayed[2];
} ANHYST_NAME(anhyst_biquad_state);

/* ANHYST_OK, or ANHYST_BAD_PARAMETER where a coefficient is not finite. */
anhyst_status ANHYST_NAME(anhyst_biquad_check)(const ANHYST_NAME(anhyst_biquad) *filter);

/* The output for this tick; the state goes on to the next. */
ANHYST_REAL ANHYST_NAME(anhyst_biquad_step)(const ANHYST_NAME(anhyst_biquad) *filter,
                                            ANHYST_NAME(anhyst_biquad_state) *state,
                                            ANHYST_REAL in);

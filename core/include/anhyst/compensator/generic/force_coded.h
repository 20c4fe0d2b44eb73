/* SPDX-License-Identifier: Apache-2.0 */

/* Full scales of the codes of the inner force controller; constant. */
typedef struct {
  ANHYST_REAL demand;   /* force, N */
  ANHYST_REAL current;  /* A */
  ANHYST_REAL flux;     /* flux density, T */
  ANHYST_REAL gap_low;  /* gap of 0, m */
  ANHYST_REAL gap_high; /* gap of 1.0, m */
} anhyst_code_scales_x;

typedef struct {
  anhyst_force_controller_q31 *inner;
  ANHYST_REAL force;   /* codes per N */
  ANHYST_REAL current; /* codes per A */
  ANHYST_REAL flux;    /* codes per T */
  ANHYST_REAL gap;     /* codes per m */
  ANHYST_REAL gap_low; /* m */
  ANHYST_REAL newton;  /* N per code */
  ANHYST_REAL ampere;  /* A per code */
} anhyst_coded_x;

/* Initialises a force controller that calls the inner one. Both must live as long as `coded`.
   Returns ANHYST_OK, or ANHYST_BAD_PARAMETER, without a change, if a scale or the gap range is not
   in 1e-12..1e12. */
anhyst_status anhyst_force_controller_init_coded_x(anhyst_force_controller_x *c,
                                                   anhyst_coded_x *coded,
                                                   const anhyst_code_scales_x *scales,
                                                   anhyst_force_controller_q31 *inner);

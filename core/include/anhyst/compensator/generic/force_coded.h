/* SPDX-License-Identifier: Apache-2.0 */

/* Full scales of the codes of the inner force controller; constant. */
typedef struct {
  ANHYST_REAL demand;   /* full-scale force, N */
  ANHYST_REAL current;  /* full-scale current, A */
  ANHYST_REAL flux;     /* full-scale flux density, T */
  ANHYST_REAL gap_low;  /* gap of code 0, m */
  ANHYST_REAL gap_high; /* gap of code 1.0, m */
} anhyst_code_scales_x;

typedef struct {
  anhyst_force_controller_q31 *inner;
  ANHYST_REAL force;   /* codes per N */
  ANHYST_REAL current; /* codes per A */
  ANHYST_REAL flux;    /* codes per T */
  ANHYST_REAL gap;     /* codes per m */
  ANHYST_REAL gap_low; /* gap of code 0, m */
  ANHYST_REAL newton;  /* force of one code, N */
  ANHYST_REAL ampere;  /* current of one code, A */
} anhyst_coded_x;

/* Initialises a force controller that calls the inner one. `coded` and `inner` must live as long as
   c. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if a full scale or the width of the gap range is
   not in 1e-12..1e12. After an error, nothing is changed. */
anhyst_status anhyst_force_controller_init_coded_x(anhyst_force_controller_x *c,
                                                   anhyst_coded_x *coded,
                                                   const anhyst_code_scales_x *scales,
                                                   anhyst_force_controller_q31 *inner);

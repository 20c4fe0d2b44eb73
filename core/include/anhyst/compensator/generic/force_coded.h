/* SPDX-License-Identifier: Apache-2.0 */

/* What the codes of the inner force controller stand for; constant. */
typedef struct {
  ANHYST_REAL demand;   /* full scales: N */
  ANHYST_REAL current;  /* A */
  ANHYST_REAL flux;     /* density, T */
  ANHYST_REAL gap_low;  /* gap of 0, m */
  ANHYST_REAL gap_high; /* gap of 1.0, m */
} anhyst_code_scales_x;

typedef struct {
  anhyst_force_controller_q31 *inner;
  ANHYST_REAL force;   /* codes of 1 N */
  ANHYST_REAL current; /* of 1 A */
  ANHYST_REAL flux;    /* of 1 T */
  ANHYST_REAL gap;     /* of 1 m */
  ANHYST_REAL gap_low; /* m */
  ANHYST_REAL newton;  /* N of a code */
  ANHYST_REAL ampere;  /* A of a code */
} anhyst_coded_x;

/* Makes a force controller that asks the inner one, which must live as long, as coded must.
   ANHYST_OK, or ANHYST_BAD_PARAMETER where a scale or the range of the gap is not within
   1e-12..1e12; nothing is changed then. */
anhyst_status anhyst_force_controller_init_coded_x(anhyst_force_controller_x *c,
                                                   anhyst_coded_x *coded,
                                                   const anhyst_code_scales_x *scales,
                                                   anhyst_force_controller_q31 *inner);

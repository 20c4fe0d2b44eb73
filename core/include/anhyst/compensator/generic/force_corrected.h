/* SPDX-License-Identifier: Apache-2.0 */

/* What was found; constant. */
typedef struct {
  ANHYST_REAL scale;   /* ampere-turns of a current over those that the method counts on */
  ANHYST_REAL zero;    /* by which the gap is read too large */
  ANHYST_REAL density; /* true flux density over what is read */
  ANHYST_REAL lead;    /* current for a root of the force that rises by 1 in a tick */
} anhyst_correction_x;

typedef struct {
  anhyst_correction_x correction;
  anhyst_force_controller_x *inner;
  ANHYST_REAL root;   /* of the force solved for */
  ANHYST_REAL before; /* the same a tick earlier */
} anhyst_corrected_x;

/* Makes a force controller that asks another one, which must live as long. ANHYST_OK, or
   ANHYST_BAD_PARAMETER where a number is none, or a scale not above zero; nothing is changed then.
 */
anhyst_status anhyst_force_controller_init_corrected_x(anhyst_force_controller_x *c,
                                                       anhyst_corrected_x *corrected,
                                                       const anhyst_correction_x *correction,
                                                       anhyst_force_controller_x *inner);

/* SPDX-License-Identifier: Apache-2.0 */

/* Result of a calibration; constant. */
typedef struct {
  ANHYST_REAL scale;   /* true ampere-turns divided by those of the inner controller, > 0 */
  ANHYST_REAL zero;    /* offset of the gap reading; > 0 if it reads too large */
  ANHYST_REAL density; /* true flux density divided by the measured one, > 0 */
  ANHYST_REAL lead;    /* current for a rise of the square root of the force by 1 in one tick */
} anhyst_correction_x;

typedef struct {
  anhyst_correction_x correction;
  anhyst_force_controller_x *inner;
  ANHYST_REAL root;          /* square root of the force of the last solve */
  ANHYST_REAL previous_root; /* square root of the force one tick earlier */
} anhyst_corrected_x;

/* Initialises a force controller that calls an inner one, which must live as long as c. Returns
   ANHYST_OK, or ANHYST_BAD_PARAMETER if a number is not finite, or `scale` or `density` is not
   above zero. After an error, nothing is changed. */
anhyst_status anhyst_force_controller_init_corrected_x(anhyst_force_controller_x *c,
                                                       anhyst_corrected_x *corrected,
                                                       const anhyst_correction_x *correction,
                                                       anhyst_force_controller_x *inner);

/* SPDX-License-Identifier: Apache-2.0 */

#define anhyst_coil_flux_x ANHYST_NAME(anhyst_coil_flux)
#define anhyst_coil_flux_settings_x ANHYST_NAME(anhyst_coil_flux_settings)
#define anhyst_coil_sum_x ANHYST_NAME(anhyst_coil_sum)
#define anhyst_force_controller_init_coil_x ANHYST_NAME(anhyst_force_controller_init_coil)

#define ANHYST_COIL_HASTE 16 /* factor of the pull then */
#define ANHYST_COIL_DOUBT_TICKS                                                                    \
  32U /* ticks with a large deviation after which the law is taken                                 \
       */

typedef struct {
  anhyst_coil_flux_settings_x settings;
  anhyst_force_controller_x *inner;
  anhyst_coil_sum_x deviation;  /* estimated flux minus flux of the law */
  anhyst_coil_sum_x offset;     /* estimated offset of the voltage: flux per tick */
  anhyst_coil_sum_x resistance; /* estimated resistance: flux per tick and unit of current */
  ANHYST_REAL current;          /* mean current during the last tick */
  ANHYST_REAL law;              /* flux of the law in the last tick */
  ANHYST_REAL pull;             /* present fraction of the deviation that is removed per tick */
  uint16_t doubt;               /* consecutive ticks with a deviation of `reach` or more */
  uint16_t is_running;          /* whether the last tick had a solve */
  uint16_t is_solved;           /* whether solve was called after the last commit */
} anhyst_coil_flux_x;

/* Initialises a force controller that estimates the flux, and gives it to an inner one with the
   method `flux` or `fused`, which must live as long as c. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the inner controller has no flux loop or a setting is out of its range.
   After an error, nothing is changed. */
anhyst_status anhyst_force_controller_init_coil_x(anhyst_force_controller_x *c,
                                                  anhyst_coil_flux_x *coil,
                                                  const anhyst_coil_flux_settings_x *settings,
                                                  anhyst_force_controller_x *inner);

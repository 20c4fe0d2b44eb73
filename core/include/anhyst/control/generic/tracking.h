/* SPDX-License-Identifier: Apache-2.0 */

/* How an axis is controlled; constant. */
typedef struct {
  anhyst_pid_x pid;
  anhyst_allocation_x allocation;
  ANHYST_REAL current_low; /* limits of what the amplifiers accept */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* of their converters: currents are low, low + step, ...; 0: none */
  const anhyst_biquad_x *filter; /* of the error, `filters` of them, one after another */
  uint16_t filters;
} anhyst_tracking_settings_x;

/* What is known at one tick. */
typedef struct {
  ANHYST_REAL error;       /* over which the net force is to pull */
  ANHYST_REAL forward;     /* net force that is fed forward */
  const ANHYST_REAL *gap;  /* of each drive */
  const ANHYST_REAL *flux; /* density in each, measured, or none: see force_controller.h */
} anhyst_tracking_sample_x;

/* What follows. */
typedef struct {
  ANHYST_REAL *current; /* to drive, one for each drive */
  ANHYST_REAL demand;   /* wanted net force */
  uint16_t flags;       /* see flags.h, or-ed over the drives */
} anhyst_tracking_answer_x;

/* One controller. Drives 0, 2, ... pull along the net force, 1, 3, ... against it. */
typedef struct {
  const anhyst_tracking_settings_x *settings;
  anhyst_force_controller_x *const *drive;
  anhyst_biquad_state_x *filtered; /* one for each filter */
  anhyst_pid_state_x state;
  uint16_t drives;
} anhyst_tracking_x;

/* Starts at rest: zero error for ever. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not
   valid, or drives of pairs are not paired; nothing is changed then. What is pointed to must live
   as long as the controller; filtered may be 0 without filters. */
anhyst_status anhyst_tracking_init_x(anhyst_tracking_x *c,
                                     const anhyst_tracking_settings_x *settings,
                                     anhyst_force_controller_x *const *drive, uint16_t drives,
                                     anhyst_biquad_state_x *filtered);

/* One tick. The currents stay within the limits whatever the sample says. */
void anhyst_tracking_tick_x(anhyst_tracking_x *c, const anhyst_tracking_sample_x *sample,
                            anhyst_tracking_answer_x *out);

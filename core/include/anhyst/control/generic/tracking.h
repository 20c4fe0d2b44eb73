/* SPDX-License-Identifier: Apache-2.0 */

/* How an axis is controlled; constant. */
typedef struct {
  ANHYST_NAME(anhyst_pid) pid;
  ANHYST_NAME(anhyst_allocation) allocation;
  ANHYST_REAL current_low; /* limits of what the amplifiers accept */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* of their converters: currents are low, low + step, ...; 0: none */
  const ANHYST_NAME(anhyst_biquad) *filter; /* of the error, `filters` of them, one after another */
  uint16_t filters;
} ANHYST_NAME(anhyst_tracking_settings);

/* What is known at one tick. */
typedef struct {
  ANHYST_REAL error;       /* over which the net force is to pull */
  ANHYST_REAL forward;     /* net force that is fed forward */
  const ANHYST_REAL *gap;  /* of each drive */
  const ANHYST_REAL *flux; /* density in each, measured, or none: see force_controller.h */
} ANHYST_NAME(anhyst_tracking_sample);

/* What follows. */
typedef struct {
  ANHYST_REAL *current; /* to drive, one for each drive */
  ANHYST_REAL demand;   /* wanted net force */
  uint16_t flags;       /* see flags.h, or-ed over the drives */
} ANHYST_NAME(anhyst_tracking_answer);

/* One controller. Drives 0, 2, ... pull along the net force, 1, 3, ... against it. */
typedef struct {
  const ANHYST_NAME(anhyst_tracking_settings) *settings;
  ANHYST_NAME(anhyst_force_controller) *const *drive;
  ANHYST_NAME(anhyst_biquad_state) *filtered; /* one for each filter */
  ANHYST_NAME(anhyst_pid_state) state;
  uint16_t drives;
} ANHYST_NAME(anhyst_tracking);

/* Starts at rest: zero error for ever. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not
   valid, or drives of pairs are not paired; nothing is changed then. What is pointed to must live
   as long as the controller; filtered may be 0 without filters. */
anhyst_status ANHYST_NAME(anhyst_tracking_init)(
    ANHYST_NAME(anhyst_tracking) *c, const ANHYST_NAME(anhyst_tracking_settings) *settings,
    ANHYST_NAME(anhyst_force_controller) *const *drive, uint16_t drives,
    ANHYST_NAME(anhyst_biquad_state) *filtered);

/* One tick. The currents stay within the limits whatever the sample says. */
void ANHYST_NAME(anhyst_tracking_tick)(ANHYST_NAME(anhyst_tracking) *c,
                                       const ANHYST_NAME(anhyst_tracking_sample) *sample,
                                       ANHYST_NAME(anhyst_tracking_answer) *out);

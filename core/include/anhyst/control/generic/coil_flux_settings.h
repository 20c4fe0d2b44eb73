/* SPDX-License-Identifier: Apache-2.0 */

#define anhyst_coil_flux_settings_x ANHYST_NAME(anhyst_coil_flux_settings)
#define anhyst_coil_sum_x ANHYST_NAME(anhyst_coil_sum)

typedef struct {
  ANHYST_REAL gain;       /* flux per volt and tick: the length of a tick, s, > 0 */
  ANHYST_REAL resistance; /* flux per ampere and tick, ohm s, >= 0 */
  ANHYST_REAL spread;     /* largest change of `resistance`, 0..resistance */
  ANHYST_REAL offset;     /* largest estimated offset, Wb per tick, >= 0 */
  ANHYST_REAL inductance; /* flux per current, Wb/A, >= 0 */
  ANHYST_REAL lag;        /* fraction of a current step in the mean of the next tick, 0 < .. <= 1 */
  ANHYST_REAL range;      /* voltage at and above which a reading is limited, V, > 0 */
  ANHYST_REAL reach;      /* largest deviation from the law, Wb, > 0 */
  ANHYST_REAL full;       /* full scale of the flux, Wb, > 0 */
  ANHYST_REAL pull;       /* final pull per tick, 0 < .. <= 1/16 */
  ANHYST_REAL learning;   /* speed of the resistance relative to that of the offset, 1/A^2 */
  ANHYST_REAL large;      /* smallest current at which the resistance is learned, A */
} anhyst_coil_flux_settings_x;

typedef ANHYST_REAL anhyst_coil_sum_x;

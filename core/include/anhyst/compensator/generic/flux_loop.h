/* SPDX-License-Identifier: Apache-2.0 */

/* Parameters of the flux loop, which corrects the current by the measured flux density; constant. T
   is the length of a tick. If a magnet only pulls, the flux density is proportional to the square
   root of the force. The axis of the `flux_table` is then sqrt(force*force_high), from 0 to
   force_high, and two columns suffice. */
typedef struct {
  anhyst_map_x flux_table;  /* flux density as a function of the force */
  ANHYST_REAL proportional; /* proportional gain k_p, current per unit of flux density */
  ANHYST_REAL integral;     /* integral gain k_i*T */
  ANHYST_REAL back;         /* back-calculation gain: if the current is limited, this fraction of
                               `applied - unlimited_current` is added to the integral, 0..1 */
  ANHYST_REAL smoothing;    /* expected fraction of a flux step after one tick, > 0 and <= 1 */
  ANHYST_REAL most;         /* largest current that is added to that of a compensator, >= 0 */
} anhyst_flux_loop_x;

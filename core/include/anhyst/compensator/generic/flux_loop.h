/* SPDX-License-Identifier: Apache-2.0 */

/* Gains of the correction of the current by the measured flux; constant. T is the length of a tick.
   If a magnet only pulls, the flux density is proportional to the square root of the force. The
   axis of the table is then sqrt(force*force_high), 0 to force_high, and two columns suffice. */
typedef struct {
  anhyst_map_x wanted;      /* flux density for a force */
  ANHYST_REAL proportional; /* k_p, current per unit of flux density */
  ANHYST_REAL integral;     /* k_i*T */
  ANHYST_REAL back;         /* back-calculation gain: part of applied - solved, 0..1 */
  ANHYST_REAL smoothing;    /* share of a flux step expected after one tick, 0 < .. <= 1 */
  ANHYST_REAL most;         /* maximum current that is added to that of a compensator, >= 0 */
} anhyst_flux_loop_x;

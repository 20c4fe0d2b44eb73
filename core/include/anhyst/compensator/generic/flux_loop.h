/* SPDX-License-Identifier: Apache-2.0 */

/* How the measured flux corrects the current; constant. T is the length of a tick. The flux density
   of a force goes with its root where a magnet pulls alone: the axis of the table is then the root
   of force*force_high, of the same ends, and two columns say it all. */
typedef struct {
  anhyst_map_x wanted;      /* flux density of a force */
  ANHYST_REAL proportional; /* k_p, current for a unit of flux density */
  ANHYST_REAL integral;     /* k_i*T */
  ANHYST_REAL back;         /* share of applied - solved that the integral takes, 0..1 */
  ANHYST_REAL smoothing;    /* share of a step that is expected to show in a tick, 0 < .. <= 1 */
  ANHYST_REAL most;         /* current that is added to that of a compensator at most, >= 0 */
} anhyst_flux_loop_x;

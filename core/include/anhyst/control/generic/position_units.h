/* SPDX-License-Identifier: Apache-2.0 */

/* Gap of a magnet from a position: offset + factor*position. */
typedef struct {
  ANHYST_REAL offset;
  ANHYST_REAL factor; /* -1, or 1 for the second magnet of a pair */
} anhyst_gap_line_x;

/* Conversion of positions and demands to the integers of levitation.h. */
typedef struct {
  anhyst_gap_line_x gap[ANHYST_POSITION_MAGNETS];
  ANHYST_REAL position; /* full scale of the position, > 0 */
  ANHYST_REAL demand;   /* full scale of the demand, > 0 */
} anhyst_position_units_x;

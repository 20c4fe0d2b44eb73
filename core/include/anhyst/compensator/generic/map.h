/* SPDX-License-Identifier: Apache-2.0 */

/* A table of equal segments; constant. Never falls along the force. */
typedef struct {
  const ANHYST_REAL *entries; /* gap_segments + 1 rows, one a gap, of force_segments + 1 entries */
  uint16_t force_segments;    /* 1..4096 */
  uint16_t gap_segments;      /* 1..64 */
  ANHYST_REAL force_low;      /* force of the first column; 0 where a magnet only pulls */
  ANHYST_REAL force_high;     /* and of the last, above it */
  ANHYST_REAL gap_low;        /* gap of the first row */
  ANHYST_REAL gap_high;       /* and of the last, above it */
} anhyst_map_x;

/* The functions are those of map.h; a signal that is not a number counts as its lowest value. */

anhyst_status anhyst_map_check_x(const anhyst_map_x *map);

ANHYST_REAL anhyst_map_value_x(const anhyst_map_x *map, ANHYST_REAL force, ANHYST_REAL gap);

ANHYST_REAL anhyst_map_force_x(const anhyst_map_x *map, ANHYST_REAL value, ANHYST_REAL gap);

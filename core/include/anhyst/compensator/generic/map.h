/* SPDX-License-Identifier: Apache-2.0 */

/* A table with equal segments; constant. Values never fall along the force. */
typedef struct {
  const ANHYST_REAL *entries; /* gap_segments + 1 rows (gaps) of force_segments + 1 entries */
  uint16_t force_segments;    /* 1..4096 */
  uint16_t gap_segments;      /* 1..64 */
  ANHYST_REAL force_low;      /* force of the first column; 0 if the magnet only pulls */
  ANHYST_REAL force_high;     /* force of the last column, above force_low */
  ANHYST_REAL gap_low;        /* gap of the first row */
  ANHYST_REAL gap_high;       /* gap of the last row, above gap_low */
} anhyst_map_x;

/* The functions work as those of map.h. A signal that is NaN counts as its lowest value. */

anhyst_status anhyst_map_check_x(const anhyst_map_x *map);

ANHYST_REAL anhyst_map_value_x(const anhyst_map_x *map, ANHYST_REAL force, ANHYST_REAL gap);

ANHYST_REAL anhyst_map_force_x(const anhyst_map_x *map, ANHYST_REAL value, ANHYST_REAL gap);

/* SPDX-License-Identifier: Apache-2.0 */
/* A number over force and gap without memory, in fixed point: the current where no hysteresis is
   known, or the flux density that belongs to a force.

   A table of equal segments, 2^n over a force of 0..1.0 and 2^m over a gap of 0..1.0, interpolated
   in straight lines along both. It never falls along the force. Error against exact arithmetic with
   the same entries: 8 units in the last place of a q31; the entries themselves are 16 bits wide.

   Nothing here allocates, waits, or loops a number of times that depends on a signal. */
#ifndef ANHYST_MAP_H
#define ANHYST_MAP_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_MAP_FORCE_SEGMENTS 8 /* largest n */
#define ANHYST_MAP_GAP_SEGMENTS 6   /* largest m */

/* A table; constant. Neighbours along force or gap differ by at most 32767. */
typedef struct {
  const int16_t *entries;  /* q15: 2^m + 1 rows, one a gap, of 2^n + 1 entries */
  uint16_t force_segments; /* n: 0..8 */
  uint16_t gap_segments;   /* m: 0..6 */
} anhyst_map_q31;

/* Whether a map is valid: ANHYST_OK or ANHYST_BAD_PARAMETER. Reads every entry; not for an
   interrupt. */
anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map);

/* The value, q31; a signal below 0 counts as 0. */
int32_t anhyst_map_value_q31(const anhyst_map_q31 *map, int32_t force, int32_t gap);

/* The inverse along the force: the largest force whose value is not above the given one, q31
   within 0..1.0; 0 where there is none. */
int32_t anhyst_map_force_q31(const anhyst_map_q31 *map, int32_t value, int32_t gap);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* A single-valued map over force and gap in fixed point. The map contains the current without a
   hysteresis model, or the flux density for a force.

   The table has equal segments: 2^n over a force of 0..1.0 and 2^m over a gap of 0..1.0. Values are
   interpolated bilinearly and never fall along the force. The error is at most 8 LSB of q31 against
   exact arithmetic with the same 16-bit entries. No function allocates memory or waits. The length
   of each loop depends only on the size of the table. */
#ifndef ANHYST_MAP_H
#define ANHYST_MAP_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_MAP_FORCE_SEGMENTS 8 /* maximum of n */
#define ANHYST_MAP_GAP_SEGMENTS 6   /* maximum of m */

/* A table; constant. Neighbouring entries along force or gap differ by at most 32767. */
typedef struct {
  const int16_t *entries;  /* q15: 2^m + 1 rows (gaps) of 2^n + 1 entries (forces) */
  uint16_t force_segments; /* n, 0..8 */
  uint16_t gap_segments;   /* m, 0..6 */
} anhyst_map_q31;

/* Returns ANHYST_OK for a valid map, otherwise ANHYST_BAD_PARAMETER. Must not be called from an
   ISR. */
anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map);

/* Returns the value of the map, q31. A force or a gap below 0 counts as 0. */
int32_t anhyst_map_value_q31(const anhyst_map_q31 *map, int32_t force, int32_t gap);

/* Inverts the map along the force. Returns the largest force whose value is at most the given one,
   q31 in 0..1.0; 0 if there is no such force. */
int32_t anhyst_map_force_q31(const anhyst_map_q31 *map, int32_t value, int32_t gap);

#ifdef __cplusplus
}
#endif
#endif

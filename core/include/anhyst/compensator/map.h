/* SPDX-License-Identifier: Apache-2.0 */
/* A single-valued map over force and gap in fixed point: the current without a hysteresis model, or
   the flux density of a force.

   The table has equal segments, 2^n over a force of 0..1.0 and 2^m over a gap of 0..1.0, with
   bilinear interpolation. It never falls along the force. The error against exact arithmetic with
   the same entries is at most 8 LSB of q31; the entries themselves have 16 bits. No function
   allocates memory, waits, or has a loop whose length depends on a signal. */
#ifndef ANHYST_MAP_H
#define ANHYST_MAP_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_MAP_FORCE_SEGMENTS 8 /* maximum n */
#define ANHYST_MAP_GAP_SEGMENTS 6   /* maximum m */

/* A table; constant. Neighbours along force or gap differ by at most 32767. */
typedef struct {
  const int16_t *entries;  /* q15: 2^m + 1 rows, one for each gap, of 2^n + 1 entries */
  uint16_t force_segments; /* n: 0..8 */
  uint16_t gap_segments;   /* m: 0..6 */
} anhyst_map_q31;

/* Returns ANHYST_OK or ANHYST_BAD_PARAMETER. Reads every entry: must not be called from an ISR. */
anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map);

/* Returns the value, q31. A signal below 0 counts as 0. */
int32_t anhyst_map_value_q31(const anhyst_map_q31 *map, int32_t force, int32_t gap);

/* Inverts the map along the force: returns the largest force whose value is at most the given one,
   q31 in 0..1.0, or 0 if there is none. */
int32_t anhyst_map_force_q31(const anhyst_map_q31 *map, int32_t value, int32_t gap);

#ifdef __cplusplus
}
#endif
#endif

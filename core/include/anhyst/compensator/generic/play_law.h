/* SPDX-License-Identifier: Apache-2.0 */

/* What a map with a play knows; constant. Along the force neither map + half nor map - half
   falls. */
typedef struct {
  ANHYST_NAME(anhyst_map) map;  /* i */
  ANHYST_NAME(anhyst_map) half; /* on the same steps, none below 0; may fall */
  ANHYST_REAL radius;           /* of the play, above 0 */
} ANHYST_NAME(anhyst_play_law);

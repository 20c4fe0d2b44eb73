/* SPDX-License-Identifier: Apache-2.0 */

/* What a map with a play knows; constant. Along the force neither map + half nor map - half
   falls. */
typedef struct {
  anhyst_map_x map;   /* i */
  anhyst_map_x half;  /* on the same steps, none below 0; may fall */
  ANHYST_REAL radius; /* of the play, above 0 */
} anhyst_play_law_x;

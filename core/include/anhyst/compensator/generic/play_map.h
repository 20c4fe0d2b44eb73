/* SPDX-License-Identifier: Apache-2.0 */

/* One map with a play. */
typedef struct {
  const anhyst_play_law_x *law;
  ANHYST_REAL low; /* limits of the current */
  ANHYST_REAL high;
  ANHYST_REAL play;    /* b: the memory; every number is one */
  ANHYST_REAL demand;  /* solved for, within limits */
  ANHYST_REAL gap;     /* for which was solved */
  ANHYST_REAL value;   /* i of the solve */
  ANHYST_REAL wanted;  /* current of the solve, before its limits */
  ANHYST_REAL current; /* and within */
  uint16_t flags;      /* of the last solve, see flags.h */
  uint16_t solved;     /* whether there was a solve since the last commit */
} anhyst_play_map_x;

/* Whether a law is valid: ANHYST_OK or ANHYST_BAD_PARAMETER. Reads every entry; not for an
   interrupt. */
anhyst_status anhyst_play_law_check_x(const anhyst_play_law_x *law);

/* Starts with a play of 0. ANHYST_OK, or ANHYST_BAD_PARAMETER where law or limits are not valid;
   nothing is changed then. The law must live as long as the map. */
anhyst_status anhyst_play_map_init_x(anhyst_play_map_x *c, const anhyst_play_law_x *law,
                                     ANHYST_REAL low, ANHYST_REAL high);

/* The current that gives the demanded force now, within the limits. The play is not touched. */
ANHYST_REAL anhyst_play_map_solve_x(anhyst_play_map_x *c, ANHYST_REAL demand, ANHYST_REAL gap);

/* Moves the play with the current that was applied, at the gap there was; the force that it is
   expected to give: the demand itself, to the bit, where both are those of the solve. */
ANHYST_REAL anhyst_play_map_commit_x(anhyst_play_map_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

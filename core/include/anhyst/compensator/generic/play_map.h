/* SPDX-License-Identifier: Apache-2.0 */

/* A force on a segment of the map, and its current. */
typedef struct {
  ANHYST_REAL part;    /* of the segment, 0..1 */
  ANHYST_REAL value;   /* i */
  ANHYST_REAL half;    /* half-width of the loop */
  ANHYST_REAL side;    /* bounded((i - b)/radius), -1..1 */
  ANHYST_REAL current; /* i + half*side */
} anhyst_play_point_x;

/* A map with one play. */
typedef struct {
  anhyst_play_law_x law; /* parameters; its tables are those of the block */
  ANHYST_REAL low;       /* limits of the current */
  ANHYST_REAL high;
  ANHYST_REAL least; /* both limits, extended by 2^-15 of full scale */
  ANHYST_REAL most;
  ANHYST_REAL play;       /* b: the hysteresis state; every number is valid */
  ANHYST_REAL demand;     /* of the last solve, within limits; after a commit, the expected force */
  ANHYST_REAL gap;        /* of the last solve */
  anhyst_play_point_x at; /* at the demand; its current is before the limits */
  uint16_t column;        /* index of the column of the map below the demand */
  uint16_t flags;         /* of the last tick; see flags.h */
  uint16_t solved;        /* whether there was a solve since the last commit */
} anhyst_play_map_x;

/* Returns the current for the demanded force, within the limits. Does not move the play. Sets
   flags: ANHYST_DEMAND_LIMITED and ANHYST_CURRENT_LIMITED if a limit applies, ANHYST_GAP_LIMITED if
   the gap is out of the range (floating point: by more than 2^-15 of the range). */
ANHYST_REAL anhyst_play_map_solve_x(anhyst_play_map_x *c, ANHYST_REAL demand, ANHYST_REAL gap);

/* Moves the play with the applied current at the actual gap. Returns the expected force: exactly
   the demand, if both equal those of the solve. Adds to the flags of the solve:
   ANHYST_CURRENT_LIMITED if the current exceeds the limits by more than 2^-15 of full scale or is
   NaN, ANHYST_GAP_LIMITED as above. The flags are those of the commit alone if there was no solve
   before it. */
ANHYST_REAL anhyst_play_map_commit_x(anhyst_play_map_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

/* SPDX-License-Identifier: Apache-2.0 */

/* A force within a segment of the map, and the current there. */
typedef struct {
  ANHYST_REAL part;    /* of the segment, 0..1 */
  ANHYST_REAL value;   /* i */
  ANHYST_REAL half;    /* half-width of the loop */
  ANHYST_REAL side;    /* bounded((i - b)/radius), -1..1 */
  ANHYST_REAL current; /* i + half*side */
} anhyst_play_point_x;

/* One map with a play. */
typedef struct {
  anhyst_play_law_x law; /* its tables are those of the block */
  ANHYST_REAL low;       /* limits of the current */
  ANHYST_REAL high;
  ANHYST_REAL least; /* the same limits, 2^-15 of full scale wider */
  ANHYST_REAL most;
  ANHYST_REAL play;   /* b: the memory; every number is valid */
  ANHYST_REAL demand; /* for which was solved, within limits; after a commit the force expected */
  ANHYST_REAL gap;    /* for which was solved */
  anhyst_play_point_x at; /* of the demand; its current is before the limits */
  uint16_t column;        /* of the map, below the demand */
  uint16_t flags;         /* of the last tick, see flags.h */
  uint16_t solved;        /* whether there was a solve since the last commit */
} anhyst_play_map_x;

/* Returns the current that gives the demanded force now, within the limits. The play stays. Sets
   flags: ANHYST_DEMAND_LIMITED and ANHYST_CURRENT_LIMITED if a limit applies, ANHYST_GAP_LIMITED if
   the gap is out of the range, or beyond it by more than 2^-15 of it in floating point. */
ANHYST_REAL anhyst_play_map_solve_x(anhyst_play_map_x *c, ANHYST_REAL demand, ANHYST_REAL gap);

/* Moves the play with the current that was applied, at the gap there was. Returns the force that
   the current is expected to give: the demand itself, to the bit, if both are those of the solve.
   Adds to the flags of the solve: ANHYST_CURRENT_LIMITED if the current is beyond the limits by
   more than 2^-15 of full scale or is not a number, ANHYST_GAP_LIMITED as above. The flags are
   those of the commit alone if there was no solve before it. */
ANHYST_REAL anhyst_play_map_commit_x(anhyst_play_map_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

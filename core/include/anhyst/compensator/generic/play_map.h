/* SPDX-License-Identifier: Apache-2.0 */

/* A force in a segment of the map, and its current. */
typedef struct {
  ANHYST_REAL fraction;   /* position of the force in the segment, 0..1 */
  ANHYST_REAL value;      /* value of the map, i */
  ANHYST_REAL half_width; /* half the width of the loop */
  ANHYST_REAL side;       /* bounded((i - b)/radius); -1: descending branch, 1: ascending branch */
  ANHYST_REAL current;    /* current i + half_width*side */
} anhyst_play_point_x;

/* A map with one play operator. */
typedef struct {
  anhyst_play_law_x law; /* parameters; its tables are those of the block */
  ANHYST_REAL low;       /* lowest and highest current */
  ANHYST_REAL high;
  ANHYST_REAL tolerated_low; /* both limits, extended by 2^-15 of full scale */
  ANHYST_REAL tolerated_high;
  ANHYST_REAL play;       /* position b of the play: the hysteresis state; every number is valid */
  ANHYST_REAL demand;     /* limited demand of the last solve; after a commit, the expected force */
  ANHYST_REAL gap;        /* gap of the last solve */
  anhyst_play_point_x at; /* point of the limited demand; its current is not limited */
  uint16_t column;        /* index of the map column at or below the demand */
  uint16_t flags;         /* flags of the last tick, see flags.h */
  uint16_t solved;        /* whether solve was called after the last commit */
} anhyst_play_map_x;

/* Returns the current for the demanded force, within the limits. Does not move the play. Sets
   c->flags: ANHYST_DEMAND_LIMITED and ANHYST_CURRENT_LIMITED if a limit applies, ANHYST_GAP_LIMITED
   if the gap is out of its range (floating point: by more than 2^-15 of the range). */
ANHYST_REAL anhyst_play_map_solve_x(anhyst_play_map_x *c, ANHYST_REAL demand, ANHYST_REAL gap);

/* Moves the play with the applied current at the actual gap. Returns the expected force: exactly
   the demand, if current and gap equal those of the solve. Adds to the flags of the solve:
   ANHYST_CURRENT_LIMITED if the current exceeds the limits by more than 2^-15 of full scale or is
   NaN, ANHYST_GAP_LIMITED as in solve. Without a solve before, only this function sets the
   flags. */
ANHYST_REAL anhyst_play_map_commit_x(anhyst_play_map_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

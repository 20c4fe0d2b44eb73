/* SPDX-License-Identifier: Apache-2.0 */
/* A path of the full law: its tables, what is known at its start, and how m is made up; full.c
   follows it. Inside, everything is q28. */
#ifndef ANHYST_FULL_PATH_H
#define ANHYST_FULL_PATH_H

#include "anhyst/compensator/compensator.h"
#include "block.h"
#include "lookup.h"

#define ONE ((int32_t)268435456)

/* A step along the tangents that needs no evaluation after it: a 64th of the field in which the
   memory fades, kappa, so that slopes change by about as much; but at most 1/256. */
#define NEAR_WAY (ONE / 256)
#define NEAR_PART (ONE / 64 * 256)

/* A table over 0..1, ready for use. */
typedef struct {
  const int16_t *at;
  uint16_t n; /* it has 2^n segments */
} table;

/* A rising path, prepared for evaluation at many places. */
typedef struct {
  const int16_t *words;
  table curve;
  table branch; /* as inverse and rate, once it has departed */
  table inverse;
  int32_t x; /* where it goes on */
  int32_t y;
  int32_t p;
  int32_t turn;      /* where the play turned into this direction ... */
  int32_t level;     /* ... and what y was there */
  int32_t play;      /* half-width */
  int32_t departure; /* of the irreversible part, from there */
  int32_t offset;    /* level - A(departure) */
  int16_t lead;      /* weight: (A(departure) - level)/4 */
  int16_t rate;
  uint16_t rate_shift;
  int16_t steepness;
  int16_t reversible;
  int32_t near; /* a step that needs no evaluation after it */
} path;

/* The value of a table at u, 0 <= u < 1; *rise is that of the segment, in q15. */
static inline int32_t value(table t, int32_t u, int32_t *rise)
{
  const int32_t fine = u >> (15U - t.n); /* segment and 13 bits of its part */
  const int16_t *at = t.at + (fine >> 13);
  const int32_t low = at[0];
  *rise = at[1] - low;
  return low * 8192 + *rise * (fine & 8191);
}

/* An odd table, -1 <= u < 1. */
static inline int32_t odd_value(table t, int32_t u, int32_t *rise)
{
  return u < 0 ? ~value(t, ~u, rise) : value(t, u, rise);
}

/* The rise of a segment of curve or branch, which are equally wide, as a slope in 1/1024. */
static inline int32_t slope_of(const path *along, int32_t rise)
{
  return (int32_t)((uint32_t)rise << along->curve.n) >> 5;
}

/* m = y + c*(L - y). */
static inline int32_t magnetisation(const path *along, int32_t y, int32_t anhysteretic)
{
  return y + anhyst_scale(anhysteretic - y, along->reversible) * 2;
}

static inline int32_t slope_of_m(const path *along, int32_t y_slope, int32_t x_slope)
{
  return y_slope + (((x_slope - y_slope) * along->reversible) >> 15);
}

/* The field over the anhysteretic. */
static inline table inverse_of(const int16_t *words)
{
  const table inverse = {words + words[ANHYST_WORD_FULL_INVERSE],
                         (uint16_t)words[ANHYST_WORD_FULL_INVERSE_SEGMENTS]};
  return inverse;
}

/* A path that starts from a memory, its direction not known yet. */
static inline void prepare(path *along, const int16_t *words, const anhyst_full_memory *from)
{
  along->words = words;
  along->curve.at = words + words[ANHYST_WORD_FULL_CURVE];
  along->curve.n = (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  along->play = (int32_t)words[ANHYST_WORD_FULL_PLAY] * 8192;
  along->steepness = words[ANHYST_WORD_FULL_STEEPNESS];
  along->reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  along->near = NEAR_PART / along->steepness;
  along->near = along->near < NEAR_WAY ? along->near : NEAR_WAY;
  along->x = anhyst_sat_q28(from->x >> 2);
  along->y = anhyst_sat_q28(from->y >> 2);
  along->p = anhyst_sat_q28(from->p >> 2);
  along->turn = anhyst_sat_q28(from->turn >> 2);
  along->level = anhyst_sat_q28(from->level >> 2);
}

/* As anhyst_kernel says of them. */
int anhyst_full_is_valid(const int16_t *words);
void anhyst_full_carry(anhyst_compensator *c, const int16_t *words, int32_t flux);

#endif

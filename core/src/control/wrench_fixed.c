/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/wrench_fixed.h"

#include <stddef.h>

#define DRIVES ANHYST_WRENCH_DRIVES

/* Least pivot, q30: a drive with less is one that the others cannot do without. */
#define LEAST_PIVOT ((int32_t)262144)

/* By how much rounding may miss the least force, q28. */
#define ROUNDING 64

/* Units are what has a force of its own: a drive alone, or the first of a pair with the net force
   of both. */
typedef struct {
  const anhyst_wrench_way_q31 *way;
  int32_t apart[DRIVES][DRIVES]; /* q30, of what is free; made when the first is held */
  int32_t force[DRIVES];         /* of each unit, q28 */
  uint16_t free;                 /* units whose force is still to be found, bit by bit */
  int changed;                   /* whether apart is made */
} sharing;

static int bit_of(uint32_t set, int j) { return (int)(set >> j & 1U); }

static int is_unit(const anhyst_wrench_q31 *w, int j) { return (int)w->layout->against[j] >= j; }

static int is_gone(const anhyst_wrench_q31 *w, int j)
{
  return bit_of(w->lost, j) && bit_of(w->lost, (int)w->layout->against[j]);
}

/* Which way a unit pulls: 1 along its force, -1 against it, 0 both. */
static int way_of(const anhyst_wrench_q31 *w, int j)
{
  const int other = (int)w->layout->against[j];
  if (other != j && bit_of(w->lost, j)) {
    return -1;
  }
  return other == j || bit_of(w->lost, other);
}

/* The largest exponent for which numbers over a pivot, sized at most the root of it, fit. */
static uint16_t digits(int32_t pivot)
{
  return (uint16_t)(30U - (anhyst_headroom(pivot) + 1U) / 2U);
}

/* number/pivot*2^n, saturates. Precondition: |number| <= 2^30, pivot > 0, n <= 30. */
static int32_t ratio(int32_t number, int32_t pivot, uint16_t n)
{
  const int64_t above = (int64_t)number * ((int64_t)1 << n);
  const int32_t half = pivot / 2;
  const int64_t rounded = above < 0 ? above - half : above + half;
  return anhyst_sat_wide(rounded / pivot);
}

/* What is left of a number of q30 where a share of another is taken off. */
static int32_t rest(int32_t number, int32_t share, int32_t other, uint16_t n)
{
  const int64_t taken = anhyst_part_wide(anhyst_wide(other, share), n);
  return anhyst_clamp(anhyst_sat_wide(number - taken), -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static void copy_apart(const anhyst_wrench_q31 *w, sharing *s)
{
  const int n = (int)w->layout->drives;
  int i;
  int j;
  for (i = 0; i < n; i++) {
    for (j = 0; j < n; j++) {
      s->apart[i][j] = s->way->apart[i * n + j];
    }
  }
  s->changed = 1;
}

/* Takes what was held of one unit off what is free of the others. */
static void eliminate(const anhyst_wrench_q31 *w, sharing *s, const int32_t *share, int held,
                      uint16_t n)
{
  int i;
  int k;
  for (i = 0; i < (int)w->layout->drives; i++) {
    for (k = 0; bit_of(s->free, i) && k <= i; k++) {
      if (bit_of(s->free, k)) {
        s->apart[i][k] = rest(s->apart[i][k], share[i], s->apart[k][held], n);
        s->apart[k][i] = s->apart[i][k];
      }
    }
  }
}

/* Holds a free unit at a force, the others go on making the wrench; 0 where they cannot. */
static int hold(const anhyst_wrench_q31 *w, sharing *s, int j, int32_t at)
{
  const int drives = (int)w->layout->drives;
  const int32_t pivot = s->changed ? s->apart[j][j] : s->way->apart[j * drives + j];
  const int32_t missing = anhyst_sub_q31(at, s->force[j]);
  int32_t share[DRIVES] = {0};
  uint16_t n;
  int i;
  if (pivot < LEAST_PIVOT) {
    return 0;
  }
  if (!s->changed) {
    copy_apart(w, s);
  }
  n = digits(pivot);
  s->free = (uint16_t)(s->free & ~(1U << j));
  for (i = 0; i < drives; i++) {
    if (bit_of(s->free, i)) {
      share[i] = ratio(s->apart[i][j], pivot, n);
      s->force[i] =
          anhyst_sat_wide(s->force[i] + anhyst_part_wide(anhyst_wide(share[i], missing), n));
    }
  }
  eliminate(w, s, share, j, n);
  s->force[j] = at;
  return 1;
}

/* Forces of least squares with what is not lost; 0 where they do not make every wrench. */
static int start(const anhyst_wrench_q31 *w, sharing *s, const anhyst_wrench_way_q31 *way,
                 const int32_t *wrench)
{
  const uint16_t axes = w->layout->axes;
  int whole = 1;
  int j;
  s->way = way;
  s->free = 0;
  s->changed = 0;
  for (j = 0; j < DRIVES; j++) {
    s->force[j] = 0;
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (is_unit(w, j)) {
      s->force[j] = anhyst_row_product_q31(&way->make.number[(ptrdiff_t)j * axes],
                                           way->make.shift[j], axes, wrench);
      s->free = (uint16_t)(s->free | (1U << j));
    }
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    int held = 1;
    if (is_unit(w, j) && is_gone(w, j)) {
      held = hold(w, s, j, 0);
    }
    if (!held) {
      s->force[j] = 0;
      s->free = (uint16_t)(s->free & ~(1U << j));
      whole = 0;
    }
  }
  return whole;
}

/* Forces within their bounds, and by how much those that are free are beyond. What pulls one way
   has a least; with both, everything has a most too, of a pair either way. */
static void look(const anhyst_wrench_q31 *w, const sharing *s, int both, int32_t *bound,
                 int32_t *off)
{
  const int32_t least = w->layout->least >> 3;
  const int32_t most = both ? w->layout->most >> 3 : ANHYST_Q31_MAX;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const int way = way_of(w, j);
    bound[j] = anhyst_clamp(s->force[j], way > 0 ? least : -most, way < 0 ? -least : most);
    off[j] = bit_of(s->free, j) ? anhyst_abs_q31(anhyst_sub_q31(s->force[j], bound[j])) : 0;
  }
}

/* Which is furthest beyond, by more than rounding; or -1. */
static int worst(const int32_t *off, int drives)
{
  int32_t most = ROUNDING;
  int found = -1;
  int j;
  for (j = 0; j < drives; j++) {
    if (off[j] > most) {
      most = off[j];
      found = j;
    }
  }
  return found;
}

/* Holds at its bound what is beyond it and the others can do without, in so many passes; whether
   nothing is beyond any more. What is free then comes within its bounds. */
static int hold_back(const anhyst_wrench_q31 *w, sharing *s, int both, int passes)
{
  const int drives = (int)w->layout->drives;
  int32_t bound[DRIVES] = {0};
  int32_t off[DRIVES] = {0};
  int held = 1;
  int pass;
  int j;
  for (pass = 0; pass < passes && held > 0; pass++) {
    held = 0;
    look(w, s, both, bound, off);
    for (j = worst(off, drives); j >= 0; j = worst(off, drives)) {
      off[j] = 0;
      held += hold(w, s, j, bound[j]);
    }
  }
  look(w, s, both, bound, off);
  for (j = 0; both && j < drives; j++) {
    s->force[j] = bit_of(s->free, j) ? bound[j] : s->force[j];
  }
  return worst(off, drives) < 0;
}

/* What the drives of a unit pull with. */
static void share_out(const anhyst_wrench_q31 *w, const sharing *s, int j, int32_t *force)
{
  const anhyst_wrench_layout_q31 *layout = w->layout;
  const int other = (int)layout->against[j];
  const int way = way_of(w, j);
  int32_t both[2];
  force[other] = 0;
  force[j] = 0;
  if (way == 0) {
    anhyst_allocate_q31(&layout->pair, anhyst_shl_q31(s->force[j], 3), both);
    force[j] = both[0];
    force[other] = both[1];
  } else if (!is_gone(w, j)) {
    const int32_t pull = way > 0 ? s->force[j] : anhyst_sub_q31(0, s->force[j]);
    const int32_t wanted = anhyst_shl_q31(pull, 3);
    force[way > 0 ? j : other] = wanted > layout->least ? wanted : layout->least;
  }
}

static int is_way(const anhyst_wrench_layout_q31 *layout, const anhyst_wrench_way_q31 *way)
{
  int valid = anhyst_rows_are_valid_q31(way->make, layout->drives, layout->axes);
  int i;
  for (i = 0; i < (int)layout->drives * (int)layout->drives; i++) {
    valid = valid && way->apart[i] >= -ANHYST_Q30_ONE && way->apart[i] <= ANHYST_Q30_ONE;
  }
  return valid;
}

anhyst_status anhyst_wrench_init_q31(anhyst_wrench_q31 *w, const anhyst_wrench_layout_q31 *layout)
{
  int valid = layout->axes > 0U && layout->axes <= ANHYST_WRENCH_AXES && layout->drives > 0U &&
              layout->drives <= DRIVES && layout->least > -ANHYST_Q31_MAX &&
              layout->least < layout->most && layout->most > 0 &&
              anhyst_allocation_is_valid_q31(&layout->pair);
  int i;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    valid = layout->against[i] < layout->drives &&
            layout->against[layout->against[i]] == (uint16_t)i &&
            (layout->against[i] == (uint16_t)i || layout->pair.kind != ANHYST_ALLOCATE_SINGLE);
  }
  if (!valid || !is_way(layout, &layout->whole) || !is_way(layout, &layout->yields)) {
    return ANHYST_BAD_PARAMETER;
  }
  w->layout = layout;
  w->lost = 0;
  return ANHYST_OK;
}

void anhyst_wrench_lose_q31(anhyst_wrench_q31 *w, int drive)
{
  if (drive >= 0 && drive < (int)w->layout->drives) {
    w->lost |= 1U << drive;
  }
}

int anhyst_wrench_share_q31(const anhyst_wrench_q31 *w, const int32_t *wrench, int32_t *force)
{
  sharing s;
  int made = start(w, &s, &w->layout->whole, wrench);
  int j;
  if (made) {
    made = hold_back(w, &s, 0, ANHYST_WRENCH_PASSES);
  }
  if (made && w->lost != 0U) {
    made = hold_back(w, &s, 1, 0);
  }
  if (!made && w->lost != 0U) { /* as little as may be is missed, axes by what they yield */
    (void)start(w, &s, &w->layout->yields, wrench);
    (void)hold_back(w, &s, 1, ANHYST_WRENCH_PASSES);
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (is_unit(w, j)) {
      made = made && s.force[j] <= ANHYST_Q28_MAX && s.force[j] >= ANHYST_Q28_MIN;
      share_out(w, &s, j, force);
    }
  }
  return made;
}

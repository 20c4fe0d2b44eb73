/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/wrench_fixed.h"

#include <stddef.h>

#define MAX_DRIVES ANHYST_WRENCH_DRIVES

/* Smallest pivot, q30. The other units cannot compensate a unit with a smaller pivot. */
#define MIN_PIVOT ((int32_t)262144)

/* Rounding error of a force at its bound, q28. */
#define FORCE_BOUND_TOLERANCE 64

/* State of the search. A unit has one unknown force: the force of a single drive, or the net force
   of a pair. The first drive of a pair represents the unit. */
typedef struct {
  const anhyst_wrench_way_q31 *method;
  int32_t projection[MAX_DRIVES][MAX_DRIVES]; /* projection of the free units, q30 */
  int32_t force[MAX_DRIVES];                  /* force of each unit, q28 */
  uint16_t free_units;                        /* units with unknown force, bit mask */
  int is_copied;                              /* whether `projection` is set */
} wrench_search;

static int has_bit(uint32_t set, int j) { return (int)(set >> j & 1U); }
static int is_unit(const anhyst_wrench_q31 *w, int j) { return (int)w->layout->against[j] >= j; }

static int is_unit_lost(const anhyst_wrench_q31 *w, int j)
{
  return has_bit(w->lost, j) && has_bit(w->lost, (int)w->layout->against[j]);
}

/* Returns the direction of a unit: 1 along the force of drive j, -1 against it, 0 both. */
static int pull_direction(const anhyst_wrench_q31 *w, int j)
{
  const int other = (int)w->layout->against[j];
  if (other != j && has_bit(w->lost, j)) {
    return -1;
  }
  return other == j || has_bit(w->lost, other);
}

/* Returns the largest shift for quotients with this pivot and numerators up to its square root. */
static uint16_t quotient_shift(int32_t pivot)
{
  return (uint16_t)(30U - (anhyst_headroom(pivot) + 1U) / 2U);
}

/* Returns number/pivot*2^shift. Requires |number| <= 2^30, pivot > 0 and shift <= 30. Saturates. */
static int32_t scaled_quotient(int32_t number, int32_t pivot, uint16_t shift)
{
  const int64_t shifted = (int64_t)number * ((int64_t)1 << shift);
  const int32_t half = pivot / 2;
  const int64_t rounded = shifted < 0 ? shifted - half : shifted + half;
  return anhyst_sat_wide(rounded / pivot);
}

/* Returns number - other*factor/2^shift, q30. */
static int32_t subtract_multiple(int32_t number, int32_t factor, int32_t other, uint16_t shift)
{
  const int64_t product = anhyst_rounded_shift(anhyst_wide(other, factor), shift);
  return anhyst_clamp(anhyst_sat_wide(number - product), -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static void copy_projection(const anhyst_wrench_q31 *w, wrench_search *s)
{
  const int n = (int)w->layout->drives;
  int i;
  int j;
  for (i = 0; i < n; i++) {
    for (j = 0; j < n; j++) {
      s->projection[i][j] = s->method->apart[i * n + j];
    }
  }
  s->is_copied = 1;
}

/* Eliminates a fixed unit from the projection of the free units. */
static void eliminate_unit(const anhyst_wrench_q31 *w, wrench_search *s, const int32_t *factor,
                           int fixed_unit, uint16_t shift)
{
  int i;
  int k;
  for (i = 0; i < (int)w->layout->drives; i++) {
    for (k = 0; has_bit(s->free_units, i) && k <= i; k++) {
      if (has_bit(s->free_units, k)) {
        s->projection[i][k] =
            subtract_multiple(s->projection[i][k], factor[i], s->projection[k][fixed_unit], shift);
        s->projection[k][i] = s->projection[i][k];
      }
    }
  }
}

/* Fixes a free unit at a force, and changes the other forces so that the wrench stays the same.
   Returns 0 if the other units cannot compensate for the change. */
static int fix_unit(const anhyst_wrench_q31 *w, wrench_search *s, int j, int32_t force)
{
  const int drives = (int)w->layout->drives;
  const int32_t pivot = s->is_copied ? s->projection[j][j] : s->method->apart[j * drives + j];
  const int32_t change = anhyst_sub_q31(force, s->force[j]);
  int32_t factor[MAX_DRIVES] = {0};
  uint16_t shift;
  int i;
  if (pivot < MIN_PIVOT) {
    return 0;
  }
  if (!s->is_copied) {
    copy_projection(w, s);
  }
  shift = quotient_shift(pivot);
  s->free_units = (uint16_t)(s->free_units & ~(1U << j));
  for (i = 0; i < drives; i++) {
    if (has_bit(s->free_units, i)) {
      factor[i] = scaled_quotient(s->projection[i][j], pivot, shift);
      s->force[i] = anhyst_sat_wide(s->force[i] +
                                    anhyst_rounded_shift(anhyst_wide(factor[i], change), shift));
    }
  }
  eliminate_unit(w, s, factor, j, shift);
  s->force[j] = force;
  return 1;
}

/* Sets least-squares forces of all usable drives. Returns 0 if some wrench is impossible. */
static int start_search(const anhyst_wrench_q31 *w, wrench_search *s,
                        const anhyst_wrench_way_q31 *way, const int32_t *wrench)
{
  const uint16_t axes = w->layout->axes;
  int can_make_all = 1;
  int j;
  s->method = way;
  s->free_units = 0;
  s->is_copied = 0;
  for (j = 0; j < MAX_DRIVES; j++) {
    s->force[j] = 0;
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (is_unit(w, j)) {
      s->force[j] = anhyst_row_product_q31(&way->make.number[(ptrdiff_t)j * axes],
                                           way->make.shift[j], axes, wrench);
      s->free_units = (uint16_t)(s->free_units | (1U << j));
    }
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    int is_fixed = 1;
    if (is_unit(w, j) && is_unit_lost(w, j)) {
      is_fixed = fix_unit(w, s, j, 0);
    }
    if (!is_fixed) {
      s->force[j] = 0;
      s->free_units = (uint16_t)(s->free_units & ~(1U << j));
      can_make_all = 0;
    }
  }
  return can_make_all;
}

/* Sets the forces limited to their bounds, and the excess of each free unit over its bound. A unit
   that pulls in one direction has a minimum force. If has_maximum is set, all units also have a
   maximum force, and pairs have one in both directions. */
static void find_bounds(const anhyst_wrench_q31 *w, const wrench_search *s, int has_maximum,
                        int32_t *bound, int32_t *excess)
{
  const int32_t min_force = w->layout->least >> 3;
  const int32_t max_force = has_maximum ? w->layout->most >> 3 : ANHYST_Q31_MAX;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const int direction = pull_direction(w, j);
    bound[j] = anhyst_clamp(s->force[j], direction > 0 ? min_force : -max_force,
                            direction < 0 ? -min_force : max_force);
    excess[j] =
        has_bit(s->free_units, j) ? anhyst_abs_q31(anhyst_sub_q31(s->force[j], bound[j])) : 0;
  }
}

/* Returns the unit whose excess is largest and above rounding errors, or -1. */
static int find_largest_excess(const int32_t *excess, int drives)
{
  int32_t largest = FORCE_BOUND_TOLERANCE;
  int found = -1;
  int j;
  for (j = 0; j < drives; j++) {
    if (excess[j] > largest) {
      largest = excess[j];
      found = j;
    }
  }
  return found;
}

/* Fixes units at the bounds that their forces exceed, if the other units can compensate, in a
   limited number of passes. Returns whether no unit exceeds its bound. If has_maximum is set, the
   remaining free units are limited to their bounds. */
static int fix_at_bounds(const anhyst_wrench_q31 *w, wrench_search *s, int has_maximum, int passes)
{
  const int drives = (int)w->layout->drives;
  int32_t bound[MAX_DRIVES] = {0};
  int32_t excess[MAX_DRIVES] = {0};
  int fixed_count = 1;
  int pass;
  int j;
  for (pass = 0; pass < passes && fixed_count > 0; pass++) {
    fixed_count = 0;
    find_bounds(w, s, has_maximum, bound, excess);
    for (j = find_largest_excess(excess, drives); j >= 0; j = find_largest_excess(excess, drives)) {
      excess[j] = 0;
      fixed_count += fix_unit(w, s, j, bound[j]);
    }
  }
  find_bounds(w, s, has_maximum, bound, excess);
  for (j = 0; has_maximum && j < drives; j++) {
    s->force[j] = has_bit(s->free_units, j) ? bound[j] : s->force[j];
  }
  return find_largest_excess(excess, drives) < 0;
}

static void set_drive_forces(const anhyst_wrench_q31 *w, const wrench_search *s, int j,
                             int32_t *force)
{
  const anhyst_wrench_layout_q31 *layout = w->layout;
  const int other = (int)layout->against[j];
  const int direction = pull_direction(w, j);
  int32_t pair_forces[2];
  force[other] = 0;
  force[j] = 0;
  if (direction == 0) {
    anhyst_allocate_q31(&layout->pair, anhyst_shl_q31(s->force[j], 3), pair_forces);
    force[j] = pair_forces[0];
    force[other] = pair_forces[1];
  } else if (!is_unit_lost(w, j)) {
    const int32_t pull = direction > 0 ? s->force[j] : anhyst_sub_q31(0, s->force[j]);
    const int32_t demanded = anhyst_shl_q31(pull, 3);
    force[direction > 0 ? j : other] = demanded > layout->least ? demanded : layout->least;
  }
}

static int is_method_valid(const anhyst_wrench_layout_q31 *layout, const anhyst_wrench_way_q31 *way)
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
              layout->drives <= MAX_DRIVES && layout->least > -ANHYST_Q31_MAX &&
              layout->least < layout->most && layout->most > 0 &&
              anhyst_allocation_is_valid_q31(&layout->pair);
  int i;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    valid = layout->against[i] < layout->drives &&
            layout->against[layout->against[i]] == (uint16_t)i &&
            (layout->against[i] == (uint16_t)i || layout->pair.kind != ANHYST_ALLOCATE_SINGLE);
  }
  if (!valid || !is_method_valid(layout, &layout->whole) ||
      !is_method_valid(layout, &layout->yields)) {
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
  wrench_search s;
  int is_made = start_search(w, &s, &w->layout->whole, wrench);
  int j;
  if (is_made) {
    is_made = fix_at_bounds(w, &s, 0, ANHYST_WRENCH_PASSES);
  }
  if (is_made && w->lost != 0U) {
    is_made = fix_at_bounds(w, &s, 1, 0);
  }
  if (!is_made && w->lost != 0U) { /* bounded forces with the smallest weighted missing wrench */
    (void)start_search(w, &s, &w->layout->yields, wrench);
    (void)fix_at_bounds(w, &s, 1, ANHYST_WRENCH_PASSES);
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (is_unit(w, j)) {
      is_made = is_made && s.force[j] <= ANHYST_Q28_MAX && s.force[j] >= ANHYST_Q28_MIN;
      set_drive_forces(w, &s, j, force);
    }
  }
  return is_made;
}

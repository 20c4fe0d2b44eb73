/* SPDX-License-Identifier: Apache-2.0 */

#define MAX_AXES ANHYST_WRENCH_AXES
#define MAX_DRIVES ANHYST_WRENCH_DRIVES

/* Smallest accepted pivot as a fraction of its row's diagonal. With a smaller pivot, an axis
   depends on other axes, or rounding dominates the forces in single precision. A diagonal below
   MIN_DIAGONAL counts as MIN_DIAGONAL, because its remainder may be rounding error. */
#define MIN_PIVOT (ANHYST_EPS > R(1e-10) ? R(1e-2) : R(1e-6))
#define MIN_DIAGONAL R(1e-2)

/* Rounding error of a force at its minimum, as a fraction of the minimum. */
#define MIN_FORCE_TOLERANCE (ANHYST_EPS > R(1e-10) ? R(1e-4) : R(1e-12))

typedef struct {
  uint16_t free_drives;           /* drives with unknown force, bit mask; a pair has one bit */
  ANHYST_REAL residual[MAX_AXES]; /* scaled wrench minus the wrench of the fixed drives */
  ANHYST_REAL *force;             /* forces of all drives */
} force_search;

/* ---- factorisation of a drive layout ---- */

/* Scales every axis to a row of length 1 in the drive matrix. Returns 0 if an axis has no drive. */
static int scale_axes(anhyst_wrench_x *w)
{
  const anhyst_wrench_layout_x *layout = w->layout;
  const int n = (int)layout->axes;
  int j;
  int k;
  for (k = 0; k < n; k++) {
    ANHYST_REAL sum = R(0.0);
    for (j = 0; j < (int)layout->drives; j++) {
      const ANHYST_REAL pull = layout->pull[j * n + k];
      sum += pull * pull;
    }
    if (!(sum > R(0.0) && sum < R(1e30))) {
      return 0;
    }
    w->scale[k] = R(1.0) / ANHYST_SQRT(sum);
    for (j = 0; j < (int)layout->drives; j++) {
      w->pull[j][k] = w->scale[k] * layout->pull[j * n + k];
    }
  }
  return 1;
}

/* Factorises the matrix of the usable drives. Returns 0 if the drives cannot produce every wrench.
   If the axes may yield, every wrench has a solution. */
static int factorise(const anhyst_wrench_x *w, const ANHYST_REAL *yields,
                     anhyst_wrench_factor_x *result)
{
  const int n = (int)w->layout->axes;
  int i;
  int j;
  int k;
  result->free_drives = w->free_drives;
  for (i = 0; i < n; i++) {
    for (k = i; k < n; k++) {
      ANHYST_REAL sum = yields && i == k ? yields[i] : R(0.0);
      for (j = 0; j < (int)w->layout->drives; j++) {
        sum += (w->free_drives >> j & 1) ? w->pull[j][i] * w->pull[j][k] : R(0.0);
      }
      result->upper[i][k] = sum;
    }
    result->row[i] = result->upper[i][i];
  }
  for (i = 0; i < n; i++) {
    ANHYST_REAL *row = result->upper[i];
    if (!yields && !(row[i] > MIN_PIVOT * result->row[i])) {
      return 0;
    }
    row[i] = R(1.0) / row[i];
    for (j = i + 1; j < n; j++) {
      const ANHYST_REAL part = row[j] * row[i];
      for (k = j; k < n; k++) {
        result->upper[j][k] -= part * row[k];
      }
      row[j] = part;
    }
  }
  return 1;
}

/* Removes a drive from a factorisation. Returns 0 if the others cannot produce every wrench. If
   axes may yield, returns 1: except for rounding, no pivot is below the yield of its axis. */
static int remove_drive(const anhyst_wrench_x *w, int j, const ANHYST_REAL *yields,
                        anhyst_wrench_factor_x *factor)
{
  const int n = (int)w->layout->axes;
  ANHYST_REAL pull[MAX_AXES];
  ANHYST_REAL update_factor = R(-1.0);
  int i;
  int k;
  for (i = 0; i < n; i++) {
    pull[i] = w->pull[j][i];
    factor->row[i] -= pull[i] * pull[i];
  }
  factor->free_drives = (uint16_t)(factor->free_drives & ~(1U << j));
  for (i = 0; i < n; i++) {
    ANHYST_REAL *row = factor->upper[i];
    const ANHYST_REAL old_pivot = R(1.0) / row[i];
    const ANHYST_REAL row_left = factor->row[i] > MIN_DIAGONAL ? factor->row[i] : MIN_DIAGONAL;
    const ANHYST_REAL min_pivot = yields ? yields[i] : MIN_PIVOT * row_left;
    ANHYST_REAL pivot = old_pivot + update_factor * pull[i] * pull[i];
    ANHYST_REAL change;
    if (!(pivot > min_pivot)) {
      if (!yields) {
        return 0;
      }
      pivot = min_pivot;
    }
    row[i] = R(1.0) / pivot;
    change = update_factor * pull[i] * row[i];
    update_factor *= old_pivot * row[i];
    for (k = i + 1; k < n; k++) {
      pull[k] -= pull[i] * row[k];
      row[k] += change * pull[k];
    }
  }
  return 1;
}

/* Sets the bit masks of usable drives (one of each pair) and of drives without a partner. */
static void classify_drives(anhyst_wrench_x *w)
{
  int j;
  w->free_drives = 0;
  w->single_drives = 0;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const unsigned bit = (w->lost >> j & 1) ? 0U : 1U << j;
    w->free_drives = (uint16_t)(w->free_drives | (w->against[j] >= (uint16_t)j ? bit : 0U));
    w->single_drives = (uint16_t)(w->single_drives | (w->against[j] == (uint16_t)j ? bit : 0U));
  }
}

static void start_search(const anhyst_wrench_x *w, const ANHYST_REAL *wrench, force_search *s)
{
  int i;
  s->free_drives = w->free_drives;
  for (i = 0; i < (int)w->layout->axes; i++) {
    s->residual[i] = w->scale[i] * wrench[i];
  }
  for (i = 0; i < (int)w->layout->drives; i++) {
    s->force[i] = R(0.0);
  }
}

/* Returns the scalar product over all axes, without a loop, because it dominates a tick's time. */
static ANHYST_REAL dot_product(const ANHYST_REAL *pull, const ANHYST_REAL *x)
{
  return pull[0] * x[0] + pull[1] * x[1] + pull[2] * x[2] + pull[3] * x[3] + pull[4] * x[4] +
         pull[5] * x[5];
}

/* Sets the least-squares forces of the free drives that produce the residual wrench. Requires that
   s->free_drives are the drives of the factorisation. */
static void solve_least_squares(const anhyst_wrench_x *w, const anhyst_wrench_factor_x *factor,
                                const force_search *s)
{
  const int n = (int)w->layout->axes;
  ANHYST_REAL x[MAX_AXES] = {R(0.0)};
  int i;
  int j;
  int k;
  for (i = 0; i < n; i++) {
    x[i] = s->residual[i];
  }
  for (i = 0; i < n; i++) {
    for (k = i + 1; k < n; k++) {
      x[k] -= factor->upper[i][k] * x[i];
    }
  }
  for (i = n - 1; i >= 0; i--) {
    ANHYST_REAL sum = x[i] * factor->upper[i][i];
    for (k = i + 1; k < n; k++) {
      sum -= factor->upper[i][k] * x[k];
    }
    x[i] = sum;
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (s->free_drives >> j & 1) {
      s->force[j] = dot_product(w->pull[j], x);
    }
  }
}

/* Fixes a free drive at a force, and subtracts its wrench from the residual wrench. */
static void fix_drive(const anhyst_wrench_x *w, force_search *s, int j, ANHYST_REAL force)
{
  int i;
  s->free_drives = (uint16_t)(s->free_drives & ~(1U << j));
  s->force[j] = force;
  for (i = 0; i < (int)w->layout->axes; i++) {
    s->residual[i] -= w->pull[j][i] * force;
  }
}

/* Returns the candidate drive whose force is furthest below the minimum, or -1. */
static int find_lowest_drive(const anhyst_wrench_x *w, const force_search *s, unsigned candidates)
{
  const ANHYST_REAL least = w->layout->least;
  const ANHYST_REAL tolerance = least < R(0.0) ? -MIN_FORCE_TOLERANCE : MIN_FORCE_TOLERANCE;
  ANHYST_REAL lowest = least * (R(1.0) - tolerance);
  int lowest_drive = -1;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    if ((candidates >> j & 1U) && s->force[j] < lowest) {
      lowest = s->force[j];
      lowest_drive = j;
    }
  }
  return lowest_drive;
}

/* Produces the whole wrench. Sets drives below their minimum force to the minimum, if the other
   drives can compensate. Returns whether no drive remains below its minimum. */
static int solve_wrench(const anhyst_wrench_x *w, const ANHYST_REAL *wrench, force_search *s)
{
  anhyst_wrench_factor_x factors[2];
  const anhyst_wrench_factor_x *factor = &w->factor;
  int pass;
  start_search(w, wrench, s);
  for (pass = 0;; pass++) {
    const uint16_t free_before = s->free_drives;
    unsigned candidates = s->free_drives & w->single_drives;
    int j;
    solve_least_squares(w, factor, s);
    j = find_lowest_drive(w, s, candidates);
    if (j < 0 || pass == ANHYST_WRENCH_PASSES) {
      return j < 0;
    }
    for (; j >= 0; j = find_lowest_drive(w, s, candidates)) {
      anhyst_wrench_factor_x *next = factor == &factors[0] ? &factors[1] : &factors[0];
      candidates &= ~(1U << j);
      *next = *factor;
      if (remove_drive(w, j, NULL, next)) {
        fix_drive(w, s, j, w->layout->least);
        factor = next;
      }
    }
    if (s->free_drives == free_before) {
      return 0;
    }
  }
}

/* Fixes drives at bounds that their forces exceed. Returns the number of these drives. The net
   force of a pair is bounded in both directions. */
static int fix_at_bounds(const anhyst_wrench_x *w, force_search *s)
{
  const ANHYST_REAL max_force = w->layout->most;
  int fixed_count = 0;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const ANHYST_REAL min_force = (w->single_drives >> j & 1) ? w->layout->least : -max_force;
    if ((s->free_drives >> j & 1) && (s->force[j] < min_force || s->force[j] > max_force)) {
      fix_drive(w, s, j, s->force[j] > max_force ? max_force : min_force);
      fixed_count++;
    }
  }
  return fixed_count;
}

/* Computes bounded forces that minimise the missing wrench, with axes weighted by their yields. */
static void solve_with_yields(anhyst_wrench_x *w, const ANHYST_REAL *wrench, force_search *s)
{
  int pass;
  int j;
  start_search(w, wrench, s);
  for (pass = 0; pass <= ANHYST_WRENCH_PASSES; pass++) {
    anhyst_wrench_factor_x *factor = &w->yield_factor[pass];
    if (factor->free_drives != s->free_drives) {
      *factor = w->yield_factor[pass - 1];
      for (j = 0; j < (int)w->layout->drives; j++) {
        if ((factor->free_drives & ~s->free_drives) >> j & 1) {
          (void)remove_drive(w, j, w->layout->yields, factor);
        }
      }
    }
    solve_least_squares(w, factor, s);
    if (!fix_at_bounds(w, s)) {
      return;
    }
  }
}

anhyst_status anhyst_wrench_init_x(anhyst_wrench_x *w, const anhyst_wrench_layout_x *layout)
{
  const anhyst_wrench_x initial = {.layout = layout};
  int valid = layout->axes > 0U && layout->axes <= MAX_AXES && layout->drives > 0U &&
              layout->drives <= MAX_DRIVES && layout->least > R(-1e30) &&
              layout->least < layout->most && layout->most > R(0.0) && layout->most < R(1e30) &&
              anhyst_allocation_is_valid_x(&layout->pair);
  int i;
  *w = initial;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    w->against[i] = layout->against[i];
    valid = layout->against[i] < layout->drives &&
            layout->against[layout->against[i]] == (uint16_t)i &&
            (layout->against[i] == (uint16_t)i || layout->pair.kind != ANHYST_ALLOCATE_SINGLE);
  }
  for (i = 0; valid && i < (int)layout->axes; i++) {
    valid = layout->yields[i] > R(0.0) && layout->yields[i] <= R(1.0);
  }
  if (!valid || !scale_axes(w)) {
    return ANHYST_BAD_PARAMETER;
  }
  classify_drives(w);
  w->makes_every_wrench = factorise(w, NULL, &w->factor);
  (void)factorise(w, layout->yields, &w->yield_factor[0]);
  return w->makes_every_wrench ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

void anhyst_wrench_lose_x(anhyst_wrench_x *w, int drive)
{
  int pass;
  if (drive < 0 || drive >= (int)w->layout->drives || (w->lost >> drive & 1)) {
    return;
  }
  w->lost = (uint16_t)(w->lost | (1U << drive));
  if (w->against[drive] == (uint16_t)drive) {
    w->makes_every_wrench = w->makes_every_wrench && remove_drive(w, drive, NULL, &w->factor);
    (void)remove_drive(w, drive, w->layout->yields, &w->yield_factor[0]);
  }
  w->against[w->against[drive]] = w->against[drive]; /* the remaining drive represents the pair */
  w->against[drive] = (uint16_t)drive;
  classify_drives(w);
  w->factor.free_drives = w->free_drives;
  w->yield_factor[0].free_drives = w->free_drives;
  for (pass = 1; pass <= ANHYST_WRENCH_PASSES; pass++) {
    w->yield_factor[pass].free_drives = 0; /* a factorisation without drives is not valid */
  }
}

int anhyst_wrench_share_x(anhyst_wrench_x *w, const ANHYST_REAL *wrench, ANHYST_REAL *force)
{
  const anhyst_wrench_layout_x *layout = w->layout;
  force_search s;
  int is_made;
  int j;
  s.force = force;
  is_made = w->makes_every_wrench && solve_wrench(w, wrench, &s);
  if (w->lost && (!is_made || fix_at_bounds(w, &s))) {
    is_made = 0;
    solve_with_yields(w, wrench, &s);
  }
  for (j = 0; j < (int)layout->drives; j++) {
    const int other = (int)w->against[j];
    if (!(force[j] > R(-1e30) && force[j] < R(1e30))) { /* a force of NaN produces no wrench */
      is_made = 0;
      force[j] = R(0.0);
    }
    if (other > j) {
      ANHYST_REAL pair_forces[2];
      anhyst_allocate_x(&layout->pair, force[j], pair_forces);
      force[j] = pair_forces[0];
      force[other] = pair_forces[1];
    } else if ((w->single_drives >> j & 1) && !(force[j] > layout->least)) {
      force[j] = layout->least;
    }
  }
  return is_made;
}

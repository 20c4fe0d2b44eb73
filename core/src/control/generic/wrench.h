/* SPDX-License-Identifier: Apache-2.0 */

#define AXES ANHYST_WRENCH_AXES
#define DRIVES ANHYST_WRENCH_DRIVES

/* Least part of its row that a pivot keeps: less is no axis of its own, or in single precision
   noise of the forces. A row that has lost nearly all counts as if it had kept so much of its 1:
   what is left of it may be rounding. */
#define LEAST_PIVOT (ANHYST_EPS > R(1e-10) ? R(1e-2) : R(1e-6))
#define LEAST_ROW R(1e-2)

/* Part of the least force by which rounding may miss it. */
#define ROUNDING (ANHYST_EPS > R(1e-10) ? R(1e-4) : R(1e-12))

typedef struct {
  uint16_t free;             /* drives whose force is to be found; of a pair the first */
  ANHYST_REAL missing[AXES]; /* of the scaled wrench beside what the others make */
  ANHYST_REAL *force;        /* of all */
} search;

/* ---- what a layout makes ---- */

/* Every axis of length one over the drives; 0 where one has none. */
static int weigh(anhyst_wrench_x *w)
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

/* The factor of all open drives; 0 where they cannot push along every axis, which with yields they
   always can. */
static int factorise(const anhyst_wrench_x *w, const ANHYST_REAL *yields,
                     anhyst_wrench_factor_x *found)
{
  const int n = (int)w->layout->axes;
  int i;
  int j;
  int k;
  found->free = w->open;
  for (i = 0; i < n; i++) {
    for (k = i; k < n; k++) {
      ANHYST_REAL sum = yields && i == k ? yields[i] : R(0.0);
      for (j = 0; j < (int)w->layout->drives; j++) {
        sum += (w->open >> j & 1) ? w->pull[j][i] * w->pull[j][k] : R(0.0);
      }
      found->upper[i][k] = sum;
    }
    found->row[i] = found->upper[i][i];
  }
  for (i = 0; i < n; i++) {
    ANHYST_REAL *row = found->upper[i];
    if (!yields && !(row[i] > LEAST_PIVOT * found->row[i])) {
      return 0;
    }
    row[i] = R(1.0) / row[i];
    for (j = i + 1; j < n; j++) {
      const ANHYST_REAL part = row[j] * row[i];
      for (k = j; k < n; k++) {
        found->upper[j][k] -= part * row[k];
      }
      row[j] = part;
    }
  }
  return 1;
}

/* Takes a drive out of a factor; 0 where the others cannot push along every axis. With yields they
   always can: no pivot is below what its axis yields but by rounding. */
static int take_out(const anhyst_wrench_x *w, int j, const ANHYST_REAL *yields,
                    anhyst_wrench_factor_x *factor)
{
  const int n = (int)w->layout->axes;
  ANHYST_REAL pull[AXES];
  ANHYST_REAL share = R(-1.0);
  int i;
  int k;
  for (i = 0; i < n; i++) {
    pull[i] = w->pull[j][i];
    factor->row[i] -= pull[i] * pull[i];
  }
  factor->free = (uint16_t)(factor->free & ~(1U << j));
  for (i = 0; i < n; i++) {
    ANHYST_REAL *row = factor->upper[i];
    const ANHYST_REAL before = R(1.0) / row[i];
    const ANHYST_REAL left = factor->row[i] > LEAST_ROW ? factor->row[i] : LEAST_ROW;
    const ANHYST_REAL least = yields ? yields[i] : LEAST_PIVOT * left;
    ANHYST_REAL pivot = before + share * pull[i] * pull[i];
    ANHYST_REAL change;
    if (!(pivot > least)) {
      if (!yields) {
        return 0;
      }
      pivot = least;
    }
    row[i] = R(1.0) / pivot;
    change = share * pull[i] * row[i];
    share *= before * row[i];
    for (k = i + 1; k < n; k++) {
      pull[k] -= pull[i] * row[k];
      row[k] += change * pull[k];
    }
  }
  return 1;
}

/* Which drives are open and which stand alone. */
static void sort(anhyst_wrench_x *w)
{
  int j;
  w->open = 0;
  w->alone = 0;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const unsigned bit = (w->lost >> j & 1) ? 0U : 1U << j;
    w->open = (uint16_t)(w->open | (w->against[j] >= (uint16_t)j ? bit : 0U));
    w->alone = (uint16_t)(w->alone | (w->against[j] == (uint16_t)j ? bit : 0U));
  }
}

/* ---- a search ---- */

static void start(const anhyst_wrench_x *w, const ANHYST_REAL *wrench, search *s)
{
  int i;
  s->free = w->open;
  for (i = 0; i < (int)w->layout->axes; i++) {
    s->missing[i] = w->scale[i] * wrench[i];
  }
  for (i = 0; i < (int)w->layout->drives; i++) {
    s->force[i] = R(0.0);
  }
}

/* What a drive makes for a force along every axis; without a loop, since this is most of a tick. */
static ANHYST_REAL along(const ANHYST_REAL *pull, const ANHYST_REAL *x)
{
  return pull[0] * x[0] + pull[1] * x[1] + pull[2] * x[2] + pull[3] * x[3] + pull[4] * x[4] +
         pull[5] * x[5];
}

/* Forces of the free drives with the least sum of squares that make what is missing; s->free are
   those of the factor. */
static void least_squares(const anhyst_wrench_x *w, const anhyst_wrench_factor_x *by,
                          const search *s)
{
  const int n = (int)w->layout->axes;
  ANHYST_REAL x[AXES] = {R(0.0)};
  int i;
  int j;
  int k;
  for (i = 0; i < n; i++) {
    x[i] = s->missing[i];
  }
  for (i = 0; i < n; i++) {
    for (k = i + 1; k < n; k++) {
      x[k] -= by->upper[i][k] * x[i];
    }
  }
  for (i = n - 1; i >= 0; i--) {
    ANHYST_REAL sum = x[i] * by->upper[i][i];
    for (k = i + 1; k < n; k++) {
      sum -= by->upper[i][k] * x[k];
    }
    x[i] = sum;
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    if (s->free >> j & 1) {
      s->force[j] = along(w->pull[j], x);
    }
  }
}

/* Sets a free drive to a force; the others make the rest. */
static void hold(const anhyst_wrench_x *w, search *s, int j, ANHYST_REAL force)
{
  int i;
  s->free = (uint16_t)(s->free & ~(1U << j));
  s->force[j] = force;
  for (i = 0; i < (int)w->layout->axes; i++) {
    s->missing[i] -= w->pull[j][i] * force;
  }
}

/* The drive of these that is furthest below its least, or -1. */
static int worst(const anhyst_wrench_x *w, const search *s, unsigned of)
{
  const ANHYST_REAL least = w->layout->least;
  const ANHYST_REAL missed = least < R(0.0) ? -ROUNDING : ROUNDING;
  ANHYST_REAL low = least * (R(1.0) - missed);
  int found = -1;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    if ((of >> j & 1U) && s->force[j] < low) {
      low = s->force[j];
      found = j;
    }
  }
  return found;
}

/* Makes a wrench of all there are, setting to their least those below it that the others can do
   without; whether no drive is left below its least. */
static int make_all(const anhyst_wrench_x *w, const ANHYST_REAL *wrench, search *s)
{
  anhyst_wrench_factor_x room[2];
  const anhyst_wrench_factor_x *by = &w->factor;
  int pass;
  start(w, wrench, s);
  for (pass = 0;; pass++) {
    const uint16_t before = s->free;
    unsigned left = s->free & w->alone;
    int j;
    least_squares(w, by, s);
    j = worst(w, s, left);
    if (j < 0 || pass == ANHYST_WRENCH_PASSES) {
      return j < 0;
    }
    for (; j >= 0; j = worst(w, s, left)) {
      anhyst_wrench_factor_x *next = by == &room[0] ? &room[1] : &room[0];
      left &= ~(1U << j);
      *next = *by;
      if (take_out(w, j, NULL, next)) {
        hold(w, s, j, w->layout->least);
        by = next;
      }
    }
    if (s->free == before) {
      return 0;
    }
  }
}

/* Sets to its bound what is beyond one; how many. Of a pair the net force is bounded both ways. */
static int bound(const anhyst_wrench_x *w, search *s)
{
  const ANHYST_REAL most = w->layout->most;
  int bounded = 0;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const ANHYST_REAL least = (w->alone >> j & 1) ? w->layout->least : -most;
    if ((s->free >> j & 1) && (s->force[j] < least || s->force[j] > most)) {
      hold(w, s, j, s->force[j] > most ? most : least);
      bounded++;
    }
  }
  return bounded;
}

/* Forces within bounds that miss as little as may be, axes by what they yield. */
static void give_up(anhyst_wrench_x *w, const ANHYST_REAL *wrench, search *s)
{
  int pass;
  int j;
  start(w, wrench, s);
  for (pass = 0; pass <= ANHYST_WRENCH_PASSES; pass++) {
    anhyst_wrench_factor_x *by = &w->given_up[pass];
    if (by->free != s->free) {
      *by = w->given_up[pass - 1];
      for (j = 0; j < (int)w->layout->drives; j++) {
        if ((by->free & ~s->free) >> j & 1) {
          (void)take_out(w, j, w->layout->yields, by);
        }
      }
    }
    least_squares(w, by, s);
    if (!bound(w, s)) {
      return;
    }
  }
}

anhyst_status anhyst_wrench_init_x(anhyst_wrench_x *w, const anhyst_wrench_layout_x *layout)
{
  const anhyst_wrench_x fresh = {.layout = layout};
  int valid = layout->axes > 0U && layout->axes <= AXES && layout->drives > 0U &&
              layout->drives <= DRIVES && layout->least > R(-1e30) &&
              layout->least < layout->most && layout->most > R(0.0) && layout->most < R(1e30) &&
              anhyst_allocation_is_valid_x(&layout->pair);
  int i;
  *w = fresh;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    w->against[i] = layout->against[i];
    valid = layout->against[i] < layout->drives &&
            layout->against[layout->against[i]] == (uint16_t)i &&
            (layout->against[i] == (uint16_t)i || layout->pair.kind != ANHYST_ALLOCATE_SINGLE);
  }
  for (i = 0; valid && i < (int)layout->axes; i++) {
    valid = layout->yields[i] > R(0.0) && layout->yields[i] <= R(1.0);
  }
  if (!valid || !weigh(w)) {
    return ANHYST_BAD_PARAMETER;
  }
  sort(w);
  w->whole = factorise(w, NULL, &w->factor);
  (void)factorise(w, layout->yields, &w->given_up[0]);
  return w->whole ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

void anhyst_wrench_lose_x(anhyst_wrench_x *w, int drive)
{
  int pass;
  if (drive < 0 || drive >= (int)w->layout->drives || (w->lost >> drive & 1)) {
    return;
  }
  w->lost = (uint16_t)(w->lost | (1U << drive));
  if (w->against[drive] == (uint16_t)drive) {
    w->whole = w->whole && take_out(w, drive, NULL, &w->factor);
    (void)take_out(w, drive, w->layout->yields, &w->given_up[0]);
  }
  w->against[w->against[drive]] = w->against[drive]; /* which stands for both in every product */
  w->against[drive] = (uint16_t)drive;
  sort(w);
  w->factor.free = w->open;
  w->given_up[0].free = w->open;
  for (pass = 1; pass <= ANHYST_WRENCH_PASSES; pass++) {
    w->given_up[pass].free = 0; /* of no drive a factor says nothing */
  }
}

int anhyst_wrench_share_x(anhyst_wrench_x *w, const ANHYST_REAL *wrench, ANHYST_REAL *force)
{
  const anhyst_wrench_layout_x *layout = w->layout;
  search s;
  int made;
  int j;
  s.force = force;
  made = w->whole && make_all(w, wrench, &s);
  if (w->lost && (!made || bound(w, &s))) {
    made = 0;
    give_up(w, wrench, &s);
  }
  for (j = 0; j < (int)layout->drives; j++) {
    const int other = (int)w->against[j];
    if (!(force[j] > R(-1e30) && force[j] < R(1e30))) { /* of no number nothing is made */
      made = 0;
      force[j] = R(0.0);
    }
    if (other > j) {
      ANHYST_REAL both[2];
      anhyst_allocate_x(&layout->pair, force[j], both);
      force[j] = both[0];
      force[other] = both[1];
    } else if ((w->alone >> j & 1) && !(force[j] > layout->least)) {
      force[j] = layout->least;
    }
  }
  return made;
}

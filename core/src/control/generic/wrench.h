/* SPDX-License-Identifier: Apache-2.0 */

typedef struct {
  uint16_t free;             /* drives whose force is to be found; of a pair the first */
  ANHYST_REAL missing[AXES]; /* of the scaled wrench beside what the others make */
  ANHYST_REAL *force;        /* of all */
} ANHYST_NAME(search);

/* ---- what a layout makes ---- */

/* Every axis of length one over the drives; 0 where one has none. */
static int ANHYST_NAME(weigh)(ANHYST_NAME(anhyst_wrench) *w)
{
  const ANHYST_NAME(anhyst_wrench_layout) *layout = w->layout;
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
static int ANHYST_NAME(factorise)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *yields,
                                  ANHYST_NAME(anhyst_wrench_factor) *found)
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
static int ANHYST_NAME(take_out)(const ANHYST_NAME(anhyst_wrench) *w, int j,
                                 const ANHYST_REAL *yields,
                                 ANHYST_NAME(anhyst_wrench_factor) *factor)
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
static void ANHYST_NAME(sort)(ANHYST_NAME(anhyst_wrench) *w)
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

static void ANHYST_NAME(start)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                               ANHYST_NAME(search) *s)
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
static ANHYST_REAL ANHYST_NAME(along)(const ANHYST_REAL *pull, const ANHYST_REAL *x)
{
  return pull[0] * x[0] + pull[1] * x[1] + pull[2] * x[2] + pull[3] * x[3] + pull[4] * x[4] +
         pull[5] * x[5];
}

/* Forces of the free drives with the least sum of squares that make what is missing; s->free are
   those of the factor. */
static void ANHYST_NAME(least_squares)(const ANHYST_NAME(anhyst_wrench) *w,
                                       const ANHYST_NAME(anhyst_wrench_factor) *by,
                                       const ANHYST_NAME(search) *s)
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
      s->force[j] = ANHYST_NAME(along)(w->pull[j], x);
    }
  }
}

/* Sets a free drive to a force; the others make the rest. */
static void ANHYST_NAME(hold)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s, int j,
                              ANHYST_REAL force)
{
  int i;
  s->free = (uint16_t)(s->free & ~(1U << j));
  s->force[j] = force;
  for (i = 0; i < (int)w->layout->axes; i++) {
    s->missing[i] -= w->pull[j][i] * force;
  }
}

/* The drive of these that is furthest below its least, or -1. */
static int ANHYST_NAME(worst)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_NAME(search) *s,
                              unsigned of)
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
static int ANHYST_NAME(make_all)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                                 ANHYST_NAME(search) *s)
{
  ANHYST_NAME(anhyst_wrench_factor) room[2];
  const ANHYST_NAME(anhyst_wrench_factor) *by = &w->factor;
  int pass;
  ANHYST_NAME(start)(w, wrench, s);
  for (pass = 0;; pass++) {
    const uint16_t before = s->free;
    unsigned left = s->free & w->alone;
    int j;
    ANHYST_NAME(least_squares)(w, by, s);
    j = ANHYST_NAME(worst)(w, s, left);
    if (j < 0 || pass == ANHYST_WRENCH_PASSES) {
      return j < 0;
    }
    for (; j >= 0; j = ANHYST_NAME(worst)(w, s, left)) {
      ANHYST_NAME(anhyst_wrench_factor) *next = by == &room[0] ? &room[1] : &room[0];
      left &= ~(1U << j);
      *next = *by;
      if (ANHYST_NAME(take_out)(w, j, NULL, next)) {
        ANHYST_NAME(hold)(w, s, j, w->layout->least);
        by = next;
      }
    }
    if (s->free == before) {
      return 0;
    }
  }
}

/* Sets to its bound what is beyond one; how many. Of a pair the net force is bounded both ways. */
static int ANHYST_NAME(bound)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s)
{
  const ANHYST_REAL most = w->layout->most;
  int bounded = 0;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const ANHYST_REAL least = (w->alone >> j & 1) ? w->layout->least : -most;
    if ((s->free >> j & 1) && (s->force[j] < least || s->force[j] > most)) {
      ANHYST_NAME(hold)(w, s, j, s->force[j] > most ? most : least);
      bounded++;
    }
  }
  return bounded;
}

/* Forces within bounds that miss as little as may be, axes by what they yield. */
static void ANHYST_NAME(give_up)(ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                                 ANHYST_NAME(search) *s)
{
  int pass;
  int j;
  ANHYST_NAME(start)(w, wrench, s);
  for (pass = 0; pass <= ANHYST_WRENCH_PASSES; pass++) {
    ANHYST_NAME(anhyst_wrench_factor) *by = &w->given_up[pass];
    if (by->free != s->free) {
      *by = w->given_up[pass - 1];
      for (j = 0; j < (int)w->layout->drives; j++) {
        if ((by->free & ~s->free) >> j & 1) {
          (void)ANHYST_NAME(take_out)(w, j, w->layout->yields, by);
        }
      }
    }
    ANHYST_NAME(least_squares)(w, by, s);
    if (!ANHYST_NAME(bound)(w, s)) {
      return;
    }
  }
}

anhyst_status ANHYST_NAME(anhyst_wrench_init)(ANHYST_NAME(anhyst_wrench) *w,
                                              const ANHYST_NAME(anhyst_wrench_layout) *layout)
{
  const ANHYST_NAME(anhyst_wrench) fresh = {.layout = layout};
  int valid = layout->axes > 0U && layout->axes <= AXES && layout->drives > 0U &&
              layout->drives <= DRIVES && layout->least > R(-1e30) &&
              layout->least < layout->most && layout->most > R(0.0) && layout->most < R(1e30) &&
              ANHYST_NAME(anhyst_allocation_is_valid)(&layout->pair);
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
  if (!valid || !ANHYST_NAME(weigh)(w)) {
    return ANHYST_BAD_PARAMETER;
  }
  ANHYST_NAME(sort)(w);
  w->whole = ANHYST_NAME(factorise)(w, NULL, &w->factor);
  (void)ANHYST_NAME(factorise)(w, layout->yields, &w->given_up[0]);
  return w->whole ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

void ANHYST_NAME(anhyst_wrench_lose)(ANHYST_NAME(anhyst_wrench) *w, int drive)
{
  int pass;
  if (drive < 0 || drive >= (int)w->layout->drives || (w->lost >> drive & 1)) {
    return;
  }
  w->lost = (uint16_t)(w->lost | (1U << drive));
  if (w->against[drive] == (uint16_t)drive) {
    w->whole = w->whole && ANHYST_NAME(take_out)(w, drive, NULL, &w->factor);
    (void)ANHYST_NAME(take_out)(w, drive, w->layout->yields, &w->given_up[0]);
  }
  w->against[w->against[drive]] = w->against[drive]; /* which stands for both in every product */
  w->against[drive] = (uint16_t)drive;
  ANHYST_NAME(sort)(w);
  w->factor.free = w->open;
  w->given_up[0].free = w->open;
  for (pass = 1; pass <= ANHYST_WRENCH_PASSES; pass++) {
    w->given_up[pass].free = 0; /* of no drive a factor says nothing */
  }
}

int ANHYST_NAME(anhyst_wrench_share)(ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                                     ANHYST_REAL *force)
{
  const ANHYST_NAME(anhyst_wrench_layout) *layout = w->layout;
  ANHYST_NAME(search) s;
  int made;
  int j;
  s.force = force;
  made = w->whole && ANHYST_NAME(make_all)(w, wrench, &s);
  if (w->lost && (!made || ANHYST_NAME(bound)(w, &s))) {
    made = 0;
    ANHYST_NAME(give_up)(w, wrench, &s);
  }
  for (j = 0; j < (int)layout->drives; j++) {
    const int other = (int)w->against[j];
    if (!(force[j] > R(-1e30) && force[j] < R(1e30))) { /* of no number nothing is made */
      made = 0;
      force[j] = R(0.0);
    }
    if (other > j) {
      ANHYST_REAL both[2];
      ANHYST_NAME(anhyst_allocate)(&layout->pair, force[j], both);
      force[j] = both[0];
      force[other] = both[1];
    } else if ((w->alone >> j & 1) && !(force[j] > layout->least)) {
      force[j] = layout->least;
    }
  }
  return made;
}

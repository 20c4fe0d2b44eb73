/* SPDX-License-Identifier: Apache-2.0 */

typedef struct {
  ANHYST_NAME(anhyst_wrench_factor) factor; /* of the matrix of the free drives */
  unsigned char free[DRIVES]; /* drives whose force is still to be found; of a pair the first */
  ANHYST_REAL held[DRIVES];   /* of the others */
  const ANHYST_REAL *yields;  /* of each axis; NULL: nothing is given up */
} ANHYST_NAME(search);

static int ANHYST_NAME(is_lost)(const ANHYST_NAME(anhyst_wrench) *w, int j)
{
  return (int)(w->lost >> j) & 1;
}

static int ANHYST_NAME(is_alone)(const ANHYST_NAME(anhyst_wrench) *w, int j)
{
  return w->against[j] == (uint16_t)j && !ANHYST_NAME(is_lost)(w, j);
}

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

/* What the free drives make along one axis for what they make along another. */
static ANHYST_REAL ANHYST_NAME(product)(const ANHYST_NAME(anhyst_wrench) *w,
                                        const ANHYST_NAME(search) *s, int i, int k)
{
  ANHYST_REAL sum = R(0.0);
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    sum += s->free[j] ? w->pull[j][i] * w->pull[j][k] : R(0.0);
  }
  return sum;
}

/* The factor of Cholesky; 0 where the free drives cannot push along every axis. */
static int ANHYST_NAME(factorise)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s)
{
  const int n = (int)w->layout->axes;
  int i;
  int j;
  int k;
  for (i = 0; i < n; i++) {
    for (k = 0; k <= i; k++) {
      ANHYST_REAL sum = ANHYST_NAME(product)(w, s, i, k);
      const ANHYST_REAL whole = s->yields ? R(0.0) : sum;
      sum += s->yields && i == k ? s->yields[i] : R(0.0);
      for (j = 0; j < k; j++) {
        sum -= s->factor.lower[i][j] * s->factor.lower[k][j];
      }
      if (k < i) {
        s->factor.lower[i][k] = sum / s->factor.lower[k][k];
      } else if (!(sum > LEAST_PIVOT * whole)) {
        return 0;
      } else {
        s->factor.lower[i][i] = ANHYST_SQRT(sum);
      }
    }
  }
  return 1;
}

/* Forces of the free drives with the least sum of squares that make a scaled wrench with the
   others. */
static void ANHYST_NAME(least_squares)(const ANHYST_NAME(anhyst_wrench) *w,
                                       const ANHYST_NAME(search) *s, const ANHYST_REAL *wrench,
                                       ANHYST_REAL *force)
{
  const int n = (int)w->layout->axes;
  const int drives = (int)w->layout->drives;
  ANHYST_REAL x[AXES];
  int i;
  int j;
  for (i = 0; i < n; i++) {
    x[i] = w->scale[i] * wrench[i];
    for (j = 0; j < drives; j++) {
      x[i] -= s->free[j] ? R(0.0) : w->pull[j][i] * s->held[j];
    }
    for (j = 0; j < i; j++) {
      x[i] -= s->factor.lower[i][j] * x[j];
    }
    x[i] /= s->factor.lower[i][i];
  }
  for (i = n - 1; i >= 0; i--) {
    for (j = i + 1; j < n; j++) {
      x[i] -= s->factor.lower[j][i] * x[j];
    }
    x[i] /= s->factor.lower[i][i];
  }
  for (j = 0; j < drives; j++) {
    ANHYST_REAL sum = R(0.0);
    for (i = 0; i < n; i++) {
      sum += w->pull[j][i] * x[i];
    }
    force[j] = s->free[j] ? sum : s->held[j];
  }
}

/* The drive of those not tried that is furthest below its least, or -1. */
static int ANHYST_NAME(worst)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_NAME(search) *s,
                              const ANHYST_REAL *force, const unsigned char *tried)
{
  const ANHYST_NAME(anhyst_wrench_layout) *layout = w->layout;
  const ANHYST_REAL missed = layout->least < R(0.0) ? -ROUNDING : ROUNDING;
  ANHYST_REAL low = layout->least * (R(1.0) - missed);
  int found = -1;
  int j;
  for (j = 0; j < (int)layout->drives; j++) {
    if (ANHYST_NAME(is_alone)(w, j) && s->free[j] && !tried[j] && force[j] < low) {
      low = force[j];
      found = j;
    }
  }
  return found;
}

/* Sets to their least those below it that the others can do without; how many. */
static int ANHYST_NAME(hold_back)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s,
                                  const ANHYST_REAL *force)
{
  unsigned char tried[DRIVES] = {0};
  int held = 0;
  int whole = 1; /* whether the factor is that of the free drives */
  int j;
  for (j = ANHYST_NAME(worst)(w, s, force, tried); j >= 0;
       j = ANHYST_NAME(worst)(w, s, force, tried)) {
    tried[j] = 1;
    s->free[j] = 0;
    whole = ANHYST_NAME(factorise)(w, s);
    held += whole;
    s->free[j] = whole ? 0 : 1;
  }
  if (!whole) {
    (void)ANHYST_NAME(factorise)(w, s);
  }
  return held;
}

static void ANHYST_NAME(start)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s)
{
  int i;
  for (i = 0; i < (int)w->layout->drives; i++) {
    s->free[i] = w->against[i] >= (uint16_t)i && !ANHYST_NAME(is_lost)(w, i);
    s->held[i] = ANHYST_NAME(is_alone)(w, i) ? w->layout->least : R(0.0);
  }
  s->yields = NULL;
  s->factor = w->factor;
}

/* Sets to its bound what is beyond one; how many. Of a pair the net force is bounded both ways. */
static int ANHYST_NAME(bound)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s,
                              const ANHYST_REAL *force)
{
  const ANHYST_REAL most = w->layout->most;
  int bounded = 0;
  int j;
  for (j = 0; j < (int)w->layout->drives; j++) {
    const ANHYST_REAL least = ANHYST_NAME(is_alone)(w, j) ? w->layout->least : -most;
    if (s->free[j] && (force[j] < least || force[j] > most)) {
      s->free[j] = 0;
      s->held[j] = force[j] > most ? most : least;
      bounded++;
    }
  }
  return bounded;
}

/* Forces within bounds that miss as little as may be, axes by what they yield. */
static void ANHYST_NAME(give_up)(const ANHYST_NAME(anhyst_wrench) *w, ANHYST_NAME(search) *s,
                                 const ANHYST_REAL *wrench, ANHYST_REAL *force)
{
  int pass;
  int j;
  ANHYST_NAME(start)(w, s);
  s->yields = w->layout->yields;
  for (pass = 0; pass <= ANHYST_WRENCH_PASSES && ANHYST_NAME(factorise)(w, s); pass++) {
    ANHYST_NAME(least_squares)(w, s, wrench, force);
    if (!ANHYST_NAME(bound)(w, s, force)) {
      return;
    }
  }
  for (j = 0; j < (int)w->layout->drives; j++) {
    force[j] = s->free[j] ? force[j] : s->held[j];
  }
}

anhyst_status ANHYST_NAME(anhyst_wrench_init)(ANHYST_NAME(anhyst_wrench) *w,
                                              const ANHYST_NAME(anhyst_wrench_layout) *layout)
{
  const ANHYST_NAME(anhyst_wrench) fresh = {.layout = layout};
  ANHYST_NAME(search) s;
  int valid = layout->axes > 0U && layout->axes <= AXES && layout->drives > 0U &&
              layout->drives <= DRIVES && layout->least > R(-1e30) &&
              layout->least < layout->most && layout->most > R(0.0) && layout->most < R(1e30) &&
              ANHYST_NAME(anhyst_allocation_is_valid)(&layout->pair);
  int i;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    valid = layout->against[i] < layout->drives &&
            layout->against[layout->against[i]] == (uint16_t)i &&
            (layout->against[i] == (uint16_t)i || layout->pair.kind != ANHYST_ALLOCATE_SINGLE);
  }
  for (i = 0; valid && i < (int)layout->axes; i++) {
    valid = layout->yields[i] > R(0.0) && layout->yields[i] <= R(1.0);
  }
  *w = fresh;
  for (i = 0; valid && i < (int)layout->drives; i++) {
    w->against[i] = layout->against[i];
  }
  if (!valid || !ANHYST_NAME(weigh)(w)) {
    return ANHYST_BAD_PARAMETER;
  }
  ANHYST_NAME(start)(w, &s);
  if (!ANHYST_NAME(factorise)(w, &s)) {
    return ANHYST_BAD_PARAMETER;
  }
  w->factor = s.factor;
  w->whole = 1;
  return ANHYST_OK;
}

void ANHYST_NAME(anhyst_wrench_lose)(ANHYST_NAME(anhyst_wrench) *w, int drive)
{
  ANHYST_NAME(search) s;
  if (drive < 0 || drive >= (int)w->layout->drives || ANHYST_NAME(is_lost)(w, drive)) {
    return;
  }
  w->against[w->against[drive]] = w->against[drive];
  w->against[drive] = (uint16_t)drive;
  w->lost = (uint16_t)(w->lost | (1U << drive));
  ANHYST_NAME(start)(w, &s);
  w->whole = ANHYST_NAME(factorise)(w, &s);
  w->factor = s.factor;
}

int ANHYST_NAME(anhyst_wrench_share)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                                     ANHYST_REAL *force)
{
  const ANHYST_NAME(anhyst_wrench_layout) *layout = w->layout;
  const unsigned char none[DRIVES] = {0};
  ANHYST_NAME(search) s;
  int pass;
  int made = w->whole;
  int j;
  ANHYST_NAME(start)(w, &s);
  if (made) {
    ANHYST_NAME(least_squares)(w, &s, wrench, force);
    for (pass = 0; pass < ANHYST_WRENCH_PASSES && ANHYST_NAME(hold_back)(w, &s, force) > 0;
         pass++) {
      ANHYST_NAME(least_squares)(w, &s, wrench, force);
    }
    made = ANHYST_NAME(worst)(w, &s, force, none) < 0;
  }
  if (w->lost && (!made || ANHYST_NAME(bound)(w, &s, force))) {
    made = 0;
    ANHYST_NAME(give_up)(w, &s, wrench, force);
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
    } else if (ANHYST_NAME(is_alone)(w, j) && !(force[j] > layout->least)) {
      force[j] = layout->least;
    }
  }
  return made;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/wrench.h"

#include <math.h>

#define AXES ANHYST_WRENCH_AXES
#define DRIVES ANHYST_WRENCH_DRIVES

/* Least part of its row that a pivot keeps: less is no axis of its own. */
#define LEAST_PIVOT 1e-6

/* Part of the least force by which rounding may miss it. */
#define ROUNDING 1e-12

typedef struct {
  double scale[AXES];         /* of each axis, so that all weigh alike */
  double factor[AXES][AXES];  /* lower, of the matrix of the free drives */
  unsigned char free[DRIVES]; /* drives whose force is still to be found; of a pair the first */
} search;

static int is_alone(const anhyst_wrench_layout *layout, int j)
{
  return layout->against[j] == (uint16_t)j;
}

static double pull_of(const anhyst_wrench_layout *layout, const search *s, int j, int k)
{
  return s->scale[k] * layout->pull[j * (int)layout->axes + k];
}

/* Every axis of length one over the drives; 0 where one has none. */
static int weigh(const anhyst_wrench_layout *layout, search *s)
{
  int j;
  int k;
  for (k = 0; k < (int)layout->axes; k++) {
    double sum = 0.0;
    for (j = 0; j < (int)layout->drives; j++) {
      const double pull = layout->pull[j * (int)layout->axes + k];
      sum += pull * pull;
    }
    if (!(sum > 0.0 && sum < 1e30)) {
      return 0;
    }
    s->scale[k] = 1.0 / sqrt(sum);
  }
  return 1;
}

/* The factor of Cholesky; 0 where the free drives cannot push along every axis. */
static int factorise(const anhyst_wrench_layout *layout, search *s)
{
  const int n = (int)layout->axes;
  int i;
  int j;
  int k;
  for (i = 0; i < n; i++) {
    for (k = 0; k <= i; k++) {
      double sum = 0.0;
      double whole;
      for (j = 0; j < (int)layout->drives; j++) {
        sum += s->free[j] ? pull_of(layout, s, j, i) * pull_of(layout, s, j, k) : 0.0;
      }
      whole = sum;
      for (j = 0; j < k; j++) {
        sum -= s->factor[i][j] * s->factor[k][j];
      }
      if (k < i) {
        s->factor[i][k] = sum / s->factor[k][k];
      } else if (!(sum > LEAST_PIVOT * whole)) {
        return 0;
      } else {
        s->factor[i][i] = sqrt(sum);
      }
    }
  }
  return 1;
}

/* Forces of the free drives with the least sum of squares that make a scaled wrench with the
   others. */
static void least_squares(const anhyst_wrench_layout *layout, const search *s, const double *wrench,
                          double *force)
{
  const int n = (int)layout->axes;
  double x[AXES];
  int i;
  int j;
  for (i = 0; i < n; i++) {
    x[i] = s->scale[i] * wrench[i];
    for (j = 0; j < (int)layout->drives; j++) {
      x[i] -= is_alone(layout, j) && !s->free[j] ? pull_of(layout, s, j, i) * layout->least : 0.0;
    }
    for (j = 0; j < i; j++) {
      x[i] -= s->factor[i][j] * x[j];
    }
    x[i] /= s->factor[i][i];
  }
  for (i = n - 1; i >= 0; i--) {
    for (j = i + 1; j < n; j++) {
      x[i] -= s->factor[j][i] * x[j];
    }
    x[i] /= s->factor[i][i];
  }
  for (j = 0; j < (int)layout->drives; j++) {
    double sum = 0.0;
    for (i = 0; i < n; i++) {
      sum += pull_of(layout, s, j, i) * x[i];
    }
    force[j] = s->free[j] ? sum : layout->least;
  }
}

/* The drive of those not tried that is furthest below its least, or -1. */
static int worst(const anhyst_wrench_layout *layout, const search *s, const double *force,
                 const unsigned char *tried)
{
  double low = layout->least * (1.0 - ROUNDING);
  int found = -1;
  int j;
  for (j = 0; j < (int)layout->drives; j++) {
    if (is_alone(layout, j) && s->free[j] && !tried[j] && force[j] < low) {
      low = force[j];
      found = j;
    }
  }
  return found;
}

/* Sets to their least those below it that the others can do without; how many. */
static int hold_back(const anhyst_wrench_layout *layout, search *s, const double *force)
{
  unsigned char tried[DRIVES] = {0};
  int held = 0;
  int j;
  for (j = worst(layout, s, force, tried); j >= 0; j = worst(layout, s, force, tried)) {
    tried[j] = 1;
    s->free[j] = 0;
    if (factorise(layout, s)) {
      held++;
    } else {
      s->free[j] = 1;
    }
  }
  (void)factorise(layout, s); /* of what is left free, whatever was tried last */
  return held;
}

static int start(const anhyst_wrench_layout *layout, search *s)
{
  int j;
  for (j = 0; j < (int)layout->drives; j++) {
    s->free[j] = layout->against[j] >= (uint16_t)j;
  }
  return weigh(layout, s) && factorise(layout, s);
}

anhyst_status anhyst_wrench_check(const anhyst_wrench_layout *layout)
{
  search s;
  int valid = layout->axes > 0U && layout->axes <= AXES && layout->drives > 0U &&
              layout->drives <= DRIVES && layout->least >= 0.0 && layout->least < 1e30 &&
              layout->pair.kind != ANHYST_ALLOCATE_SINGLE &&
              anhyst_allocation_is_valid_f64(&layout->pair);
  int j;
  for (j = 0; valid && j < (int)layout->drives; j++) {
    valid =
        layout->against[j] < layout->drives && layout->against[layout->against[j]] == (uint16_t)j;
  }
  return valid && start(layout, &s) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

int anhyst_wrench_share(const anhyst_wrench_layout *layout, const double *wrench, double *force)
{
  const unsigned char none[DRIVES] = {0};
  search s;
  int pass;
  int made;
  int j;
  if (!start(layout, &s)) {
    return 0;
  }
  least_squares(layout, &s, wrench, force);
  for (pass = 0; pass < ANHYST_WRENCH_PASSES && hold_back(layout, &s, force) > 0; pass++) {
    least_squares(layout, &s, wrench, force);
  }
  made = worst(layout, &s, force, none) < 0;
  for (j = 0; j < (int)layout->drives; j++) {
    const int other = (int)layout->against[j];
    made = made && force[j] > -1e30 && force[j] < 1e30; /* of no number nothing is made */
    if (other > j) {
      double both[2];
      anhyst_allocate_f64(&layout->pair, force[j], both);
      force[j] = both[0];
      force[other] = both[1];
    } else if (other == j && !(force[j] > layout->least)) {
      force[j] = layout->least;
    }
  }
  return made;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Claims: each compares a measured value with its limit, and prints both in any case. */
#ifndef TEST_CHECK_H
#define TEST_CHECK_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static int failures = 0;

/* Counts a claim that is not true. In tests of seeded faults, stops at the first of these. */
static inline void fail(void)
{
  failures++;
#ifdef TEST_STOP_AT_FIRST_FAILURE
  exit(1);
#endif
}

#define CHECK(condition) check_that((condition) ? 1 : 0, #condition, __LINE__)
#define CHECK_BELOW(what, measured, limit)                                                         \
  check_below(what, (double)(measured), (double)(limit), __LINE__)

static inline void check_that(int holds, const char *text, int line)
{
  if (!holds) {
    printf("FAILED line %d: %s\n", line, text);
    fail();
  }
}

static inline void check_below(const char *what, double measured, double limit, int line)
{
  const int holds = measured <= limit;
  printf("%s line %d: %s: %.3g, claimed %.3g\n", holds ? "ok    " : "FAILED", line, what, measured,
         limit);
  (void)fflush(stdout);
  if (!holds) {
    fail();
  }
}

/* Keeps the largest value; NaN counts as infinite. */
static inline void keep_largest(double *worst, double value)
{
  if (!(value <= *worst)) {
    *worst = isnan(value) ? (double)INFINITY : value;
  }
}

static inline int verdict(void)
{
  printf("%s\n", failures == 0 ? "all claims hold" : "some claims do not hold");
  return failures == 0 ? 0 : 1;
}

#endif

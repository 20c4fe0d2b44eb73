/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator of a controller: from demand and gap to current, with the fixed-point C of the
 * controller. */
#include <math.h>

#include "anhyst/compensator/compensator.h"
#include "compensator_numbers.h"
#include "part.h"

enum { DEMAND = 1, GAP = 2, CURRENT = COMPENSATOR_HAS_GAP ? 3 : 2 };

#define ONE_Q31 2147483648.0

static void relink(const void *tables, void *state)
{
  anhyst_compensator *compensator = (anhyst_compensator *)state;
  (void)tables;
  compensator->kernel = &COMPENSATOR_KERNEL;
  compensator->words = compensator_parameters;
}

static int start(const void *tables, void *state, double *values)
{
  (void)tables;
  values[CURRENT] = 0.0;
  return anhyst_compensator_init((anhyst_compensator *)state, &COMPENSATOR_KERNEL,
                                 compensator_parameters, COMPENSATOR_WORDS) == ANHYST_OK
             ? 0
             : -1;
}

/* Returns the nearest q31 code of a fraction; larger values saturate. */
static int32_t to_q31(double fraction)
{
  const double scaled = rint(fraction * ONE_Q31);
  if (!(scaled > -ONE_Q31)) {
    return INT32_MIN;
  }
  return scaled < ONE_Q31 ? (int32_t)scaled : INT32_MAX;
}

static int32_t gap_code(const double *values)
{
  const double span = COMPENSATOR_GAP_HIGH - COMPENSATOR_GAP_LOW;
  const double gap = COMPENSATOR_HAS_GAP ? values[GAP] : COMPENSATOR_GAP_LOW;
  return to_q31(span > 0.0 ? (gap - COMPENSATOR_GAP_LOW) / span : 0.0);
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  anhyst_compensator *compensator = (anhyst_compensator *)state;
  const int32_t gap = gap_code(values);
  const int32_t demand = to_q31(values[DEMAND] / COMPENSATOR_FULL_SCALE_DEMAND);
  int32_t current = 0;
  (void)tables;
  (void)seconds;
  current = anhyst_compensator_solve_q31(compensator, demand, gap);
  anhyst_compensator_commit_q31(compensator, current, gap);
  values[CURRENT] = (double)current / ONE_Q31 * COMPENSATOR_FULL_SCALE_CURRENT;
  return NULL;
}

const anhyst_part anhyst_the_part = {0,   sizeof(anhyst_compensator), NULL, NULL, relink, start,
                                     tick};

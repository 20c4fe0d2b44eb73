/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/langevin.h"

#include <math.h>

#include "anhyst/elementary.h"

/* L(z)/z by t = z^2: the continued fraction 1/(3 + t/(5 + t/(7 + ...))), multiplied out. */
static double langevin_per_z_f64(double t)
{
  const double top = 4583103525.0 + t * (349188840.0 + t * (6891885.0 + t * (42900.0 + t * 65.0)));
  const double bottom =
      13749310575.0 + t * (1964187225.0 + t * (64324260.0 + t * (675675.0 + t * (2145.0 + t))));
  return top / bottom;
}

static float langevin_per_z_f32(float t)
{
  return (3465.0f + t * (189.0f + t)) / (10395.0f + t * (1260.0f + t * 21.0f));
}

#include "anhyst/f64.h"
#include "generic/langevin.h"
#include "anhyst/f32.h"
#include "generic/langevin.h"

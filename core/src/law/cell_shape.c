/* SPDX-License-Identifier: Apache-2.0 */
#include "cell_shape.h"

#include <math.h>

#include "anhyst/law/langevin.h"
#include "anhyst/numeric/elementary.h"

static cell_jet tanh_jet(double z)
{
  cell_jet at;
  const double kept = anhyst_exp_f64(-2.0 * fabs(z));
  const double below = 1.0 / (1.0 + kept);
  const double size = (1.0 - kept) * below;
  at.f = z < 0.0 ? -size : size;
  at.f1 = 4.0 * kept * below * below;
  at.f2 = -2.0 * at.f * at.f1;
  return at;
}

static cell_jet langevin_jet(double z)
{
  cell_jet at;
  at.f = anhyst_langevin_f64(z, &at.f1);
  if (fabs(z) < 0.1) {
    const double t = z * z;
    at.f2 = -z * (2.0 / 15.0 - t * (8.0 / 189.0 - t * (2.0 / 225.0 - t * (16.0 / 10395.0))));
  } else {
    at.f2 = 2.0 * ((at.f / z - at.f1) / z - at.f * at.f1);
  }
  return at;
}

cell_jet anhyst_cell_shape(anhyst_shape shape, double z)
{
  return shape == ANHYST_SHAPE_TANH ? tanh_jet(z) : langevin_jet(z);
}

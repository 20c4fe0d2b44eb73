/* SPDX-License-Identifier: Apache-2.0 */
#include "cell_shape.h"

#include <math.h>
#include <stddef.h>

#include "anhyst/law/langevin.h"
#include "anhyst/numeric/elementary.h"

static cell_jet tanh_jet(double z)
{
  cell_jet at;
  const double decay = anhyst_exp_f64(-2.0 * fabs(z));
  const double denominator = 1.0 / (1.0 + decay);
  const double size = (1.0 - decay) * denominator;
  at.f = z < 0.0 ? -size : size;
  at.f1 = 4.0 * decay * denominator * denominator;
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

cell_jet anhyst_cell_curve(const anhyst_cell_weights_f64 *weights, int j, double play, double *z)
{
  const double inverse = 1.0 / weights->width[j];
  const double centre = weights->centre == NULL ? 0.0 : weights->centre[j];
  *z = play * inverse;
  if (!(centre > 0.0)) {
    return anhyst_cell_shape(weights->shape, *z);
  }
  const double upper_z = (play - centre) * inverse;
  const double lower_z = (play + centre) * inverse;
  const cell_jet first = anhyst_cell_shape(weights->shape, upper_z);
  const cell_jet second = anhyst_cell_shape(weights->shape, lower_z);
  const cell_jet mean = {0.5 * (first.f + second.f), 0.5 * (first.f1 + second.f1),
                         0.5 * (first.f2 + second.f2)};
  *z = mean.f1 > 0.0 ? 0.5 * (upper_z * first.f1 + lower_z * second.f1) / mean.f1 : 0.0;
  return mean;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* A Duhem iron after Coleman and Hodgdon: the field depends on the polarisation, on the way there
   and on which way it goes.

     H = x + h,   J = curve(x),   dh = q(J)*dJ - rate*h*|dJ|,   B = mu0*H + J
     q = rate*coercivity*(1 - fading*(J/saturation)^2)

   In closed form along every straight way: h goes exponentially over J to a parabola. Free of the
   speed and of how a way is cut. What such an iron has not: it keeps no turning points. A small
   loop about a bias is not closed but walks towards the curve, by exp(-2*rate*height) a cycle, and
   a larger way does not wipe a smaller one out exactly.

   With f = fading, n = rate*saturation: where f*(1 + 2/n + 2/n^2) <= 1, h stays between the two
   parabolas and every way costs energy: H*dJ - d(stored) >= 0, stored = integral of x dJ +
   h^2/(2*q). */
#ifndef ANHYST_PLANT_DUHEM_H
#define ANHYST_PLANT_DUHEM_H

#include "anhyst_plant/curve.h"

typedef struct {
  anhyst_plant_curve curve;
  double coercivity; /* A/m */
  double rate;       /* 1/T */
  double fading;     /* 0 <= fading < 1 */
} anhyst_plant_duhem_steel;

typedef struct {
  double polarisation; /* J, T */
  double friction;     /* h, A/m */
} anhyst_plant_duhem;

#endif

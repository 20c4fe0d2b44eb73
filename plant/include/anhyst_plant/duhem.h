/* SPDX-License-Identifier: Apache-2.0 */
/* A Duhem iron after Coleman and Hodgdon: the field depends on the polarisation, its path and its
   direction.

        H = x + h,   J = curve(x),   dh = q(J)*dJ - rate*h*|dJ|,   B = mu0*H + J
        q = rate*coercivity*(1 - fading*(J/saturation)^2)

   On every monotone path, the solution has a closed form: h approaches a parabola exponentially
   over J. The result does not depend on the speed or on the division of a path into steps. This
   iron has no return-point memory. A minor loop about a bias does not close. It drifts towards the
   curve by a factor of exp(-2*rate*height) per cycle, where `height` is the height of the loop. A
   larger loop does not delete a smaller one exactly. With f = fading and n = rate*saturation: if
   f*(1 + 2/n + 2/n^2) <= 1, h stays between the two parabolas, and paths dissipate energy:

        H*dJ - d(stored) >= 0,   stored = integral of x dJ + h^2/(2*q). */
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

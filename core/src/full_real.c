/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with its exact step, in floating point.

   In the law's own units the iron obeys h*x + m = flux, and a current gives
   flux_arm*flux + field_arm*x. Both are one equation, air*x + iron*m = target. Iron that couples
   to itself more than the gap parts it makes the flux arm, and so iron, negative; air stays above
   0, and the sum rises with x as long as m is nowhere steeper than air/-iron, which the check of
   the parameters asks for. So the solution is unique. Everything happens on a path that rises: a
   falling one is mirrored, which the law does not notice. Along a path

     m = (1-c)*y + c*L(x),   y = A(x) + (y0 - A(b))*exp(-(x - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. */
#include "anhyst/compensator_real.h"

#include "lookup_real.h"

/* Steps of the guess that follows the anhysteretic curve against the iron. */
#define CHORDS 4U

#include "anhyst/f64.h"
#include "generic/full.h"
#include "anhyst/f32.h"
#include "generic/full.h"

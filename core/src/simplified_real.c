/* SPDX-License-Identifier: Apache-2.0 */
/* The law with a straight anhysteretic curve in its closed form, in floating point: exact for a
   step of any size. Reduced to one state u in -1..1 that follows the flux; in the direction of
   travel, with p = u and v = 1 - p,

     dp/dflux = hold = rate/(1-nu)          while p < 0
     dp/dflux = rate*v/(1 - nu*v)           after that

   so that z = -ln v + nu*v - nu, the distance from p = 0, grows in proportion to the flux. A table
   over z gives p back; its segments double from octave to octave, since the curve is sharp at z = 0
   and flat far out. */
#include "anhyst/compensator_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/simplified.h"
#include "anhyst/f32.h"
#include "generic/simplified.h"

/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation of a net force to drives that only pull, in fixed point.

     single    every drive gets the net force
     by halves class A: one drive of a pair gets a bias plus half the net force F, the other the
   bias minus half of F class AB  both drives of a pair always pull, and the product of their forces
   is constant:

         F_1*F_2 = idle^2,   F_1 - F_2 = F

               Without a net force, both pull with the idle force. For a large net force, the other
               drive is released smoothly. A constant linearisation instead of a curve needs class
   A.

   Forces are q31 over the full scale of the drives' force, and saturate. The error of class AB
   against exact arithmetic without saturation is less than ANHYST_ALLOCATION_ERROR LSB of either
   force. No loops; nine divisions. */
#ifndef ANHYST_ALLOCATION_H
#define ANHYST_ALLOCATION_H

#include <stdint.h>

#include "anhyst/control/allocation_kinds.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_ALLOCATION_ERROR 64

#include "anhyst/numeric/q31.h"
#include "anhyst/control/generic/allocation.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif

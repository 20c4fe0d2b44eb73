/* SPDX-License-Identifier: Apache-2.0 */
/* How a net force is shared out to drives that only pull, in fixed point.

     single    every drive gets the net force
     by halves class A: one of a pair gets half of it more than a bias, the other half of it less
     class AB  both of a pair always pull, and the product of what they pull is constant:

                 F_1*F_2 = idle^2,   F_1 - F_2 = F

               At rest both pull with the idle force; for a large force the other one is let go of
               smoothly. Constants instead of a curve need class A.

   Forces are q31 over the full scale of the drives' force; what is beyond it saturates. Error of
   class AB against exact arithmetic, nothing saturated: less than ANHYST_ALLOCATION_ERROR units in
   the last place of either force. No loops; nine divisions. */
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

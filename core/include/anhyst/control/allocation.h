/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation of a net force to drives that only pull, in fixed point. A pair is two drives that
   pull against each other, with the net force F = F_1 - F_2. There are three kinds:

     single     There are no pairs. Each drive gets its net force.
     by halves  Class A: F_1 = idle + F/2, F_2 = idle - F/2. A constant linearisation instead of a
                curve requires this kind.
     class AB   Both drives always pull, and F_1*F_2 = idle^2. For a large net force, the smaller of
                the two forces decreases smoothly towards zero.

   Without a net force, both drives of a pair pull with the idle force. Forces are q31 of the full
   scale of the drives' force, and saturate. The error of class AB against exact arithmetic without
   saturation is less than ANHYST_ALLOCATION_ERROR LSB of either force. An allocation takes nine
   divisions and no loop. */
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

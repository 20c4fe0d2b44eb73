/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator of a controller in floating point: wanted output (force) in, drive (current) out,
   in the units of the model.

   At every tick: solve once or more, limit and apply the current, then commit what was really
   applied. solve does not touch the memory of the iron; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(memory, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   The laws, their tables and the number of evaluations are those of the fixed-point compensator:
   what differs between the two is rounding. Nothing here allocates, waits, or loops a number of
   times that depends on data.

   Made of + - * / and comparisons, without a library: the same bits on every target that rounds to
   nearest as IEEE 754 says and does not fuse products into sums (-ffp-contract=off); neither
   -ffast-math nor flushing to zero. A signal that is not a number counts as its lowest value; an
   applied current that is not finite leaves the memory alone. */
#ifndef ANHYST_COMPENSATOR_REAL_H
#define ANHYST_COMPENSATOR_REAL_H

#include <stdint.h>

#include "anhyst/flags.h"
#include "anhyst/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/compensator.h"
#include "anhyst/f32.h"
#include "anhyst/generic/compensator.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif

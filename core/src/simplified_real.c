/* SPDX-License-Identifier: Apache-2.0 */
/* The law with a straight anhysteretic curve in its closed form, in floating point; closed.h and
   simplified.c tell the mathematics. */
#include "anhyst/compensator_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/simplified.h"
#include "anhyst/f32.h"
#include "generic/simplified.h"

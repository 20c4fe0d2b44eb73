/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolation in the tables of the floating-point compensator, and what its parts share. */
#ifndef ANHYST_LOOKUP_REAL_H
#define ANHYST_LOOKUP_REAL_H

#include <stdint.h>

#include "anhyst/f64.h"
#include "generic/lookup.h"
#include "anhyst/f32.h"
#include "generic/lookup.h"
#include "anhyst/no_format.h"

#endif

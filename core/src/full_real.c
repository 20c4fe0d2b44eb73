/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with its exact step in floating point; full.c tells the mathematics. */
#include "anhyst/compensator_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/full.h"
#include "anhyst/f32.h"
#include "generic/full.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/axes.h"

#include "anhyst/compensator/flags.h"

/* Least part of a reading that the other heads do not foretell with which they tell it at all. */
#define SEEN R(1e-2)

#include "anhyst/numeric/f64.h"
#include "generic/axes.h"
#include "anhyst/numeric/f32.h"
#include "generic/axes.h"

/* SPDX-License-Identifier: Apache-2.0 */
/* Sum and difference in floating point, under the names that fixed.h uses for q31. */
#ifndef ANHYST_REAL_H
#define ANHYST_REAL_H

#include "anhyst/numeric/f64.h"
#include "anhyst/numeric/generic/real.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/numeric/generic/real.h"
#include "anhyst/numeric/no_format.h"

#endif

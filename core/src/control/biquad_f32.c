/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/biquad.h"

#include <math.h>

#include "anhyst/numeric/f32.h"
#include "generic/biquad.h"

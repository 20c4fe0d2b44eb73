/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/allocation_real.h"

#include <math.h>

#include "anhyst/numeric/real.h"

#include "anhyst/numeric/f32.h"
#include "generic/allocation_real.h"
#include "generic/allocation.h"

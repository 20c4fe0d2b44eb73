/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/pidd2_real.h"

#include <math.h>

#include "anhyst/numeric/f64.h"
#include "generic/pidd2.h"

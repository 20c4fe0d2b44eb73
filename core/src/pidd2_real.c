/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/pidd2_real.h"

#include <math.h>

#include "anhyst/f64.h"
#include "generic/pidd2.h"
#include "anhyst/f32.h"
#include "generic/pidd2.h"

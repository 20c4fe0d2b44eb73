/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_corrected_real.h"

#include <math.h>

#include "anhyst/numeric/f64.h"
#include "generic/force_corrected.h"

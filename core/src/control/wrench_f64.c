/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/wrench.h"

#include <math.h>
#include <stddef.h>

#include "anhyst/numeric/f64.h"
#include "generic/wrench.h"

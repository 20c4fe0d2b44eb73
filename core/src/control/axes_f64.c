/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/axes.h"

#include <stddef.h>

#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/real.h"

#include "anhyst/numeric/f64.h"
#include "generic/axes_real.h"
#include "generic/axes.h"

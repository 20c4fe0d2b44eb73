/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/position_real.h"

#include "anhyst/numeric/real.h"

#include <stddef.h>

#include "anhyst/numeric/f32.h"
#include "generic/position_real.h"
#include "generic/position.h"

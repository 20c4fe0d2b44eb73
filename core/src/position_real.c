/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/position_real.h"

#include <stddef.h>

#include "anhyst/f64.h"
#include "generic/position_real.h"
#include "generic/position.h"
#include "anhyst/f32.h"
#include "generic/position_real.h"
#include "generic/position.h"

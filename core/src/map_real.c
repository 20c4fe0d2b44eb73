/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/map_real.h"

#include <stddef.h>

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/map.h"
#include "anhyst/f32.h"
#include "generic/map.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map_real.h"

#include "anhyst/numeric/real.h"

#include <stddef.h>

#include "lookup_f64.h"

#include "anhyst/numeric/f64.h"
#include "generic/play_map_real.h"
#include "generic/play_map.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map_real.h"

#include "anhyst/numeric/real.h"

#include <stddef.h>

#include "lookup_f32.h"

#include "anhyst/numeric/f32.h"
#include "generic/play_map_real.h"
#include "generic/play_map.h"

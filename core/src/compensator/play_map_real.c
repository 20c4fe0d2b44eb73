/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map_real.h"

#include "anhyst/numeric/real.h"

#include <stddef.h>

#include "lookup_real.h"

#define ANHYST_PLAY_STEPS 12 /* within a segment: more digits than fixed point */

#include "anhyst/numeric/f64.h"
#include "generic/play_map_real.h"
#include "generic/play_map.h"
#include "anhyst/numeric/f32.h"
#include "generic/play_map_real.h"
#include "generic/play_map.h"

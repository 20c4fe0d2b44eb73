/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map_real.h"

#include <stddef.h>

#include "lookup_f32.h"

#include "anhyst/numeric/f32.h"
#include "generic/map.h"

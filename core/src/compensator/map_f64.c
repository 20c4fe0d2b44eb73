/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map_real.h"

#include <stddef.h>

#include "lookup_f64.h"

#include "anhyst/numeric/f64.h"
#include "generic/map.h"

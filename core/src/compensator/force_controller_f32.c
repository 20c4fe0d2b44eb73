/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_controller_real.h"

#include "anhyst/numeric/real.h"

#include <math.h>
#include <stddef.h>

#include "lookup_f32.h"

#include "anhyst/numeric/f32.h"
#include "generic/force_controller_real.h"
#include "generic/force_controller.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/force_controller_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/force_controller_real.h"
#include "generic/force_controller.h"
#include "anhyst/f32.h"
#include "generic/force_controller_real.h"
#include "generic/force_controller.h"

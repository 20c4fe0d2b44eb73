/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/tracking_real.h"

#include "anhyst/numeric/f64.h"
#include "generic/tracking_real.h"
#include "generic/tracking.h"

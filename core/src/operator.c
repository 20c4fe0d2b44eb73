/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/operator.h"

#include <math.h>

#include "anhyst/elementary.h"
#include "anhyst/langevin.h"

#include "anhyst/f64.h"
#include "generic/weights.h"
#include "generic/operator.h"
#include "anhyst/f32.h"
#include "generic/weights.h"
#include "generic/operator.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/compensator.h"
#include "anhyst/f32.h"
#include "generic/compensator.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/solver.h"

#include <math.h>

#include "anhyst/langevin.h"

#include "anhyst/f64.h"
#include "generic/solver.h"
#include "anhyst/f32.h"
#include "generic/solver.h"

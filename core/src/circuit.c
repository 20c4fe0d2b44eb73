/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/circuit.h"

#include <math.h>

#include "anhyst/f64.h"
#include "generic/circuit.h"
#include "anhyst/f32.h"
#include "generic/circuit.h"

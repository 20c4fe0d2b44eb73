/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/compensator_f64.h"

#include "lookup_f64.h"

#include "anhyst/numeric/f64.h"
#include "generic/cells.h"

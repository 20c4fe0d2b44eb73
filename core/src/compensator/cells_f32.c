/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/compensator_f32.h"

#include "lookup_f32.h"

#include "anhyst/numeric/f32.h"
#include "generic/cells.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator_f32.h"

#include "lookup_f32.h"

#include "anhyst/f32.h"
#include "generic/full.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator_f64.h"

#include "lookup_f64.h"

#include "anhyst/f64.h"
#include "generic/compensator.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_coded_real.h"

#include "anhyst/numeric/f64.h"
#include "generic/force_coded.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_by_play.h"

#include "anhyst/numeric/q31.h"
#include "generic/force_by_play.h"

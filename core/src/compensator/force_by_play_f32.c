/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_by_play_real.h"

#include "anhyst/numeric/f32.h"
#include "generic/force_by_play.h"

/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/drive_real.h"

#include "lookup_real.h"

#include "anhyst/f64.h"
#include "generic/drive.h"
#include "anhyst/f32.h"
#include "generic/drive.h"

/* SPDX-License-Identifier: Apache-2.0 */
/* The drive of drive.h in floating point, in the units of the model. Declarations are in
   generic/drive.h. */
#ifndef ANHYST_DRIVE_REAL_H
#define ANHYST_DRIVE_REAL_H

#include "anhyst/compensator_real.h"
#include "anhyst/drive_kind.h"
#include "anhyst/map_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/drive.h"
#include "anhyst/f32.h"
#include "anhyst/generic/drive.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif

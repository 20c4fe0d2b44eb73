/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in single precision. Declarations are in generic/compensator.h. */
#ifndef ANHYST_COMPENSATOR_F32_H
#define ANHYST_COMPENSATOR_F32_H

#include <stdint.h>

#include "anhyst/flags.h"
#include "anhyst/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f32.h"
#include "anhyst/generic/compensator.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
